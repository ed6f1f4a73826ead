"""The command `fjh`: what a robot needs, and the paper's studies below `fjh paper`."""

import logging
import os
import sys
from collections.abc import Callable, Iterable
from itertools import pairwise
from typing import Annotated

import typer

from experiments.app.command import as_command, command
from experiments.app.commands import animate, render, results, review
from experiments.app.live import live
from experiments.app.refusals import INTERRUPTED, WRONG_INPUT, ending_of
from experiments.app.report import report
from experiments.studies import PAPER, ROBOT, study
from fjh.study.interrupts import INTERRUPTION, interrupted, notice

HELP = """Keep a robot on task when its actuators fail; simulated in MuJoCo.

`fjh track` simulates failures of your robot, or of the hexapod of Chen, McInroy and Yi (2003);
`fjh survey` says what each failure would leave; `fjh paper` lists the studies of the paper.
A study writes into results/COMMAND/, or the folder given by --out: all numbers (.json, with units
in the names), tables (.md), data (.npz), figures and recordings (.rrd; `rerun FILE.rrd` opens one).
Start with `fjh table1`, which is `fjh paper table1`: a minute on two cores.
"""
PAPER_HELP = """Reproduce the paper, and validate what this package adds to it.

Each study simulates one experiment in MuJoCo and prints its tables; `fjh paper report` runs most
of them. `python -m experiments STUDY` is the same as `fjh paper STUDY`.
"""
EXIT_CODES = """\b
Exit codes:
  0    all checks of the results passed
  1    a check failed, a simulation diverged, no picture could be drawn, or a mistake of the
       program: with FJH_TRACEBACK=1 in the environment it comes with its traceback
  2    wrong input
  130  interrupted (143 and 129 if told to end or to hang up); no file is left half-written
"""

# What a warning of MuJoCo's means for a run, a sentence of the command's own says.
logging.getLogger(f"{__name__.removesuffix('experiments.app.cli')}sim").addHandler(
    logging.NullHandler()
)


def _print_version(wanted: bool) -> None:
    if wanted:
        from argument_checks import __version__  # late: completion does not wait for numpy

        print(f"fjh {__version__}")
        raise typer.Exit


_VERSION = typer.Option(
    "--version", callback=_print_version, is_eager=True, help="Print the version and exit."
)


def _options(version: Annotated[bool, _VERSION] = False) -> None: ...


def app_of(*names: str) -> typer.Typer:
    """The command `fjh` with all its commands; of the studies those of these names can be run.

    The others are not imported: a study takes a second.
    """
    app = _group("fjh", HELP)
    app.callback()(_options)
    paper = _group("paper", PAPER_HELP)
    _add_studies(app, ROBOT, names)
    _add(app, as_command(live), *map(as_command, (review, render, animate, results)))
    app.add_typer(paper)
    _add_studies(paper, PAPER, names)
    _add(paper, as_command(report))
    # A study is found without `paper`, too, and `python -m experiments` needs none.
    _add_studies(app, PAPER, names, hidden=True)
    return app


def _group(name: str, text: str) -> typer.Typer:
    return typer.Typer(name=name, help=text, epilog=EXIT_CODES, rich_markup_mode=None)


def _add_studies(
    group: typer.Typer, lines: dict[str, str], names: Iterable[str], *, hidden: bool = False
) -> None:
    for name, line in lines.items():
        run = command(study(name)) if name in names else _listed
        group.command(name, short_help=line, hidden=hidden)(run)


def _add(group: typer.Typer, *commands: Callable[..., None]) -> None:
    for each in commands:
        # The first line whole: Typer itself would cut it at any full stop.
        group.command(short_help=(each.__doc__ or "").partition("\n")[0])(each)


def _listed() -> None: ...


def main(arguments: list[str] | None = None) -> int:
    """Run `fjh`; returns the exit code, as its help lists them."""
    words = sys.argv[1:] if arguments is None else arguments
    if words in ([], ["paper"]):
        words = [*words, "--help"]
    if empty := _empty_option(words):
        return _failed(f"{empty} is empty, expected a value", WRONG_INPUT)
    try:
        # What a shell completes stands in the environment.
        completed = os.environ.get("COMP_WORDS") or os.environ.get("_TYPER_COMPLETE_ARGS", "")
        code = app_of(*words[:2], *completed.split()[1:3])(
            args=words, prog_name="fjh", standalone_mode=False
        )
    except Exception as error:
        return _failed(*ending_of(error))
    if code == INTERRUPTED:  # Typer has already caught the Ctrl-C
        return _failed(INTERRUPTION, interrupted() or INTERRUPTED)
    return code or 0


def _empty_option(words: list[str]) -> str | None:
    """The first option or argument that is empty; an empty path would be this folder."""
    for former, word in pairwise(["the first argument", *words]):
        if not word:
            return former if former.startswith("-") else f"an argument after {former}"
        if word.startswith("--") and word.endswith("="):
            return word[:-1]
    return None


def _failed(sentence: str, code: int) -> int:
    if sentence:
        notice(sentence)
    return code
