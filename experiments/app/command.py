"""A study as a command: its options, its progress, its files, its verdict."""

import inspect
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from experiments.output.files import json_text, published, usable_folder, write_arrays
from experiments.output.results import Results, publish
from experiments.output.study import Option, Progress, Study, Unsound, WrongInput
from experiments.output.terminal import print_notes, print_table, progress

_QUIET = Option("quiet", bool, False, "No tables and no progress: files and exit code only.")
_JSON = Option(
    "json",
    bool,
    False,
    "The contents of the JSON file on standard output instead of tables; --quiet then leaves out "
    "the progress only.",
)


def command(study: Study) -> Callable[..., None]:
    """The study as Typer takes it.

    Returns:
        A command that raises `Unsound` when a check failed, and `WrongInput` when a machine file
        will not do.
    """

    def run(*, out: Path, quiet: bool, json: bool, **options: Any) -> None:
        with machine_refused():
            results = conduct(study, out, partial(progress, shown=not quiet), **options)
        if json:
            print(json_text(results.summary), end="")
        elif not quiet:
            for table in results.tables:
                print_table(table)
            print_notes(results.notes)
        if failed := results.failed_check:
            raise Unsound(f"the experiment is not sound: {failed}")

    parameters = [_parameter(option) for option in _options(study)]
    run.__name__, run.__doc__ = study.name, study.help
    run.__dict__["__signature__"] = inspect.Signature(parameters)
    run.__annotations__ = {each.name: each.annotation for each in parameters}
    return run


def conduct(study: Study, folder: Path, progress: Progress, **options: Any) -> Results:
    """Run a study and publish it in the folder.

    Raises:
        OutputError: The disk or the folder refuses.
        Unsound: A simulation diverged; its state is in the folder.
    """
    usable_folder(folder)
    if study.streams:
        options["folder"] = folder
    with (
        progress(study.name) as on_progress,
        diverged_into(folder),
        study.perform(on_progress=on_progress, **options) as results,
    ):
        return publish(folder, study.name, results)


def _options(study: Study) -> list[Option]:
    seed = Option("seed", int, 0, f"Seed of {study.seed}.", metavar="N")
    return [
        Option("out", Path, Path("results", study.name), "Folder for results, made if need be."),
        seed,
        Option("quick", bool, False, study.quick),
        *study.options,
        _QUIET,
        _JSON,
    ]


def _parameter(option: Option) -> inspect.Parameter:
    bounds: dict[str, Any] = {}
    if option.name == "seed":
        bounds = {"min": 0, "max": 2**32 - 1}
    metavar = "FOLDER" if option.name == "out" else option.metavar
    names = () if option.kind is not bool else (f"--{option.name.replace('_', '-')}",)
    info = typer.Option(*names, help=option.help, metavar=metavar, **bounds)
    return inspect.Parameter(
        option.name,
        inspect.Parameter.KEYWORD_ONLY,
        default=option.default,
        annotation=Annotated[option.kind, info],
    )


@contextmanager
def machine_refused() -> Iterator[None]:
    """Turn the refusal of a machine file into that of the command line.

    Raises:
        WrongInput: A machine file will not do.
    """
    from sim import ModelError  # late: the help text need not wait for MuJoCo's import

    try:
        yield
    except ModelError as error:
        raise WrongInput(str(error)) from error


@contextmanager
def diverged_into(folder: Path) -> Iterator[None]:
    """Leave the state of a diverging simulation in the folder.

    Raises:
        Unsound: A simulation inside diverged.
    """
    # Late: the help text need not wait for MuJoCo's import.
    import numpy as np

    from sim import SimulationDiverged

    try:
        yield
    except SimulationDiverged as diverged:
        state = {"time_s": np.array(diverged.time_s), "state": diverged.state}
        with published(folder, index="diverged.npz") as staging:
            write_arrays(staging / "diverged.npz", state)
        raise Unsound(f"{diverged}; the state is in {folder / 'diverged.npz'}") from None
