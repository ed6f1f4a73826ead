"""How every study meets its user: tables for a person, JSON for a script, or nothing at all."""

import functools
import inspect
from collections.abc import Callable
from typing import Annotated, Any

import typer

from experiments.app.command import machine_refused
from experiments.output.files import json_text
from experiments.output.findings import Findings
from experiments.output.study import Unsound
from experiments.output.terminal import print_notes, print_table, progress

Quiet = Annotated[
    bool, typer.Option("--quiet", help="No tables and no progress: files and exit code only.")
]
AsJson = Annotated[
    bool,
    typer.Option(
        "--json",
        help="The contents of the JSON file on standard output instead of tables; --quiet then "
        "leaves out the progress only.",
    ),
]


def presented(study: Callable[..., Findings]) -> Callable[..., None]:
    """The study as a command: with `--quiet` and `--json`, and printing what the study returns.

    Args:
        study: Takes its options, and `progress` by keyword.

    Returns:
        A command that raises `Unsound` when there is a complaint, and `WrongInput` when a
        machine file will not do.
    """

    @functools.wraps(study)
    def command(*, quiet: bool, as_json: bool, **options: Any) -> None:
        with machine_refused():
            findings = study(**options, progress=functools.partial(progress, shown=not quiet))
        if as_json:
            print(json_text(findings.summary), end="")
        elif not quiet:
            _print(findings)
        if findings.complaint:
            raise Unsound(f"the experiment is not sound: {findings.complaint}")

    _declare(command, study)
    return command


def _declare(command: Callable[..., None], study: Callable[..., Findings]) -> None:
    """Give the command the study's options and the two of its own, where Typer looks for them."""
    signature = inspect.signature(study)
    own = [each for name, each in signature.parameters.items() if name != "progress"]
    how = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=False, annotation=kind)
        for name, kind in (("quiet", Quiet), ("as_json", AsJson))
    ]
    options = [*own, *how]
    command.__dict__["__signature__"] = signature.replace(
        parameters=options, return_annotation=None
    )
    command.__annotations__ = {each.name: each.annotation for each in options}


def _print(findings: Findings) -> None:
    for table in findings.tables:
        print_table(table)
    print_notes(findings.notes)
