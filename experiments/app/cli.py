"""Command `fjh`: commands for a user's robot, and the paper's studies as `fjh paper`."""

import logging
import os
import sys
from collections.abc import Callable, Iterable
from itertools import pairwise
from typing import Annotated

import typer

from experiments.app.command import as_command, command
from experiments.app.commands import animate, render, results, review
from experiments.app.exit_codes import INTERRUPTED, WRONG_INPUT, exit_message
from experiments.app.live import live
from experiments.app.report import report
from experiments.studies import LINES, PAPER, ROBOT, study
from fjh.study.interrupts import INTERRUPTION, interrupted, notice

HELP = """Keep robots on task when actuators fail, in simulations with MuJoCo.

`fjh track` simulates failures of your robot, or of the hexapod of Chen, McInroy and Yi (2003);
`fjh survey` analyzes what remains possible after each; `fjh paper` lists the studies of the paper.
A study writes into results/COMMAND/, or the folder given by --out: all numbers (.json, with units
in the names), tables (.md), data (.npz), figures and recordings (.rrd; `rerun FILE.rrd` opens one).
Start with `fjh table1`, which is `fjh paper table1`: a minute on two cores.
"""
PAPER_HELP = """Reproduce the paper, and validate what this package adds to it.

Each study simulates one experiment in MuJoCo and prints the main numbers; `fjh paper report` runs
them all. `python -m experiments STUDY` is the same as `fjh paper STUDY`.
"""
EXIT_CODES = """\b
Exit codes:
  0    all checks of the results passed
  1    a check failed, a simulation diverged, no picture could be rendered, or
       the program has a bug: FJH_TRACEBACK=1 in the environment shows where
  2    wrong input
  130  interrupted (143 by SIGTERM, 129 by SIGHUP); no file is half-written
"""

# The command prints its own message instead of MuJoCo's warnings.
_sim_logger = logging.getLogger(f"{__name__.removesuffix('experiments.app.cli')}sim")
_sim_logger.addHandler(logging.NullHandler())


def _print_version(requested: bool) -> None:
    if requested:
        from argument_checks import __version__  # late: completion does not wait for numpy

        print(f"fjh {__version__}")
        raise typer.Exit


_VERSION = typer.Option(
    "--version", callback=_print_version, is_eager=True, help="Print the version and exit."
)


def _options(version: Annotated[bool, _VERSION] = False) -> None: ...


def app_of(*names: str) -> typer.Typer:
    """Return the command `fjh` with all its commands.

    Only the studies with the given names are imported and can be run, because each import takes up
    to a second.
    """
    app = _group("fjh", HELP)
    app.callback()(_options)
    paper = _group("paper", PAPER_HELP)
    _add_studies(app, ROBOT, names)
    _add(app, as_command(live), *map(as_command, (review, render, animate, results)))
    app.add_typer(paper)
    _add_studies(paper, PAPER, names)
    _add(paper, as_command(report))
    # `fjh STUDY` and `python -m experiments STUDY` work without `paper`.
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
    for function in commands:
        # The whole first line: Typer would cut it at the first full stop.
        group.command(short_help=(function.__doc__ or "").partition("\n")[0])(function)


def _listed() -> None: ...


def main(arguments: list[str] | None = None) -> int:
    """Run `fjh` and return its exit code; `fjh --help` lists the exit codes."""
    command_line = sys.argv[1:] if arguments is None else arguments
    if command_line in ([], ["paper"]):
        command_line = [*command_line, "--help"]
    if empty := _empty_option(command_line):
        return _failed(f"{empty} is empty, expected a value", WRONG_INPUT)
    try:
        # During shell completion the command line is in the environment.
        completed = os.environ.get("COMP_WORDS") or os.environ.get("_TYPER_COMPLETE_ARGS", "")
        is_silent = completed or {"--help", "--quiet"} & {*command_line}
        if sys.stderr.isatty() and {*LINES, "report"} & {*command_line[:2]} and not is_silent:
            # The progress bar overwrites this line after the imports, which take seconds.
            print("fjh: starting", end="\r", file=sys.stderr, flush=True)
        code = app_of(*command_line[:2], *completed.split()[1:3])(
            args=command_line, prog_name="fjh", standalone_mode=False
        )
    except Exception as error:
        return _failed(*exit_message(error))
    if code == INTERRUPTED:  # Typer has already caught the Ctrl-C
        return _failed(INTERRUPTION, interrupted() or INTERRUPTED)
    return code or 0


def _empty_option(command_line: list[str]) -> str | None:
    """Return the first empty option or argument: an empty path would be the working folder."""
    for former, word in pairwise(["the first argument", *command_line]):
        if not word:
            return former if former.startswith("-") else f"an argument after {former}"
        if word.startswith("--") and word.endswith("="):
            return word[:-1]
    return None


def _failed(sentence: str, code: int) -> int:
    if sentence:
        notice(sentence)
    return code
