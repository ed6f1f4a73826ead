"""The command `fjh`: its studies, and the commands that show what they wrote."""

import logging
import os
import re
import shlex
import sys
from itertools import pairwise
from pathlib import Path
from typing import Annotated

import typer

from experiments.app.animate import animate
from experiments.app.live.command import live
from experiments.app.refusals import INTERRUPTED, WRONG_INPUT, ending_of
from experiments.app.report import report
from experiments.studies import LINES, study
from experiments.study.command import as_command, command
from experiments.study.errors import Unsound
from experiments.study.files import published, usable_file
from experiments.study.interrupts import INTERRUPTION, interrupted, notice, printable
from experiments.study.spelling import check_file
from experiments.study.terminal import print_ending, progress

HELP = """Simulate the fault-tolerant hexapod of Chen, McInroy and Yi (2003) and other mechanisms.

Each study simulates one experiment in MuJoCo and prints its tables; `fjh report` runs most studies.
A study writes into results/COMMAND/, or the folder given by --out: all numbers (.json, with units
in the names), tables (.md), data (.npz), figures and recordings (.rrd; `rerun FILE.rrd` opens one).
Start with `fjh table1`: a minute on two cores. `fjh compare` says what changed between two results;
`fjh review`, `fjh render` and `fjh animate` show runs; `fjh.results` in Python gives data frames.
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

_SIZE = re.compile(r"([1-9]\d{1,3})x([1-9]\d{1,3})")


_RUNS = typer.Argument(
    metavar="RUN", help="Folders with results, or single runs (.npz), of any robots."
)
_REVIEW = typer.Option(metavar="FILE.rrd", help="Recording to write.")
_MODEL = typer.Option(
    metavar="FILE", help="The machine file of the runs, MJCF.  [default: that which they name]"
)


def review(
    runs: Annotated[list[Path], _RUNS],
    out: Annotated[Path, _REVIEW] = Path("review.rrd"),
    model: Annotated[Path | None, _MODEL] = None,
) -> None:
    """Show several runs of any robots side by side in one recording.

    Two or three runs have the robot in 3D, its error, inputs, secondary motion, states and events;
    of more there is one column of plots each, a page with the robots, and one with the numbers.
    Runs of one robot and task are on the same scales. A robot's machine file is found by its
    SHA-256, where `fjh track` read it or in models/. Takes seconds.

    Example: fjh review results/table1 results/track --out /tmp/runs.rrd
    """
    folder = usable_file(out, ".rrd")
    for run in (run for run in runs if not run.is_dir()):
        check_file(run)
    with progress("review"):
        from experiments.app.review import write_review  # late: help does not wait for it

        with published(folder, index=out.name) as staging:
            write_review(staging / out.name, runs, model)
    checked = "All runs agree with the numbers in the JSON beside them."
    print_ending(checked, out, shlex.join(["rerun", str(out)]))


_FORMER = typer.Argument(metavar="A", help="The former result: its folder or its JSON file.")
_LATTER = typer.Argument(metavar="B", help="The result that is compared with it, likewise.")


def compare(a: Annotated[Path, _FORMER], b: Annotated[Path, _LATTER]) -> None:
    """Say what changed by more than noise between two results of one study.

    They may be of two versions, or of other settings, which are said first. Rows are compared by
    their names, whatever their order; docs/find.md says what noise is. The exit code is 1 if a
    check fails in the second that did not in the first. The output is Markdown.

    Example: fjh compare docs/data/table1.json results/table1
    """
    from experiments.comparison import compare as compared  # late: help does not wait for it

    found = compared(a, b)
    for line in str(found).splitlines():
        print(printable(line))
    if len(failing := found.failing):
        raise Unsound(f"{len(failing)} checks fail that did not: {failing.what.iloc[0]}")


_FILE = typer.Argument(metavar="FILE.rrd", help="A recording.")
_PICTURE = typer.Option(metavar="FILE.png", help="Picture to write.")
_TIME = typer.Option(
    metavar="S", help="Simulation time to show [s].  [default: the recording's end]"
)
_PIXELS = typer.Option(metavar="WIDTHxHEIGHT", help="Size of the picture in pixels.")


def render(
    file: Annotated[Path, _FILE],
    out: Annotated[Path, _PICTURE],
    time: Annotated[float | None, _TIME] = None,
    size: Annotated[str, _PIXELS] = "1600x900",
) -> None:
    """Make a picture of a recording: the viewer's views, on white.

    Needs no display, but a graphics card or Mesa's Vulkan driver (mesa-vulkan-drivers). Without a
    display the viewer has only a dark theme: dark and light greys are exchanged. A warning of the
    viewer counts as an error. Takes 5 s.

    Example: fjh render results/table1/W_e.rrd --time 6 --out picture.png
    """
    check_file(file)
    pixels = _SIZE.fullmatch(size)
    if not pixels:
        raise typer.BadParameter(f"{size} is not WIDTHxHEIGHT", param_hint="--size")
    folder = usable_file(out, ".png")
    with progress("render"):
        from experiments.app.render import picture_of  # late, as above

        picture = picture_of(file, time, (int(pixels[1]), int(pixels[2])))
        with published(folder, index=out.name) as staging:
            picture.save(staging / out.name)
    checked = "The viewer gave no warning."
    print_ending(checked, out, shlex.join(["rerun", str(file)]))


def _print_version(wanted: bool) -> None:
    if wanted:
        from argument_checks import __version__  # late: completion does not wait for numpy

        print(f"fjh {__version__}")
        raise typer.Exit


_VERSION = typer.Option(
    "--version", callback=_print_version, is_eager=True, help="Print the version and exit."
)


def _options(version: Annotated[bool, _VERSION] = False) -> None: ...


_OTHERS = (as_command(report), as_command(live), compare, review, render, animate)


def app_of(*names: str) -> typer.Typer:
    """The command `fjh`, all of whose commands are listed; the studies of these names can be run.

    The others are not imported: a study takes a second.
    """
    app = typer.Typer(
        name="fjh", help=HELP, epilog=EXIT_CODES, rich_markup_mode=None, callback=_options
    )
    for name, line in LINES.items():
        app.command(name, short_help=line)(command(study(name)) if name in names else _listed)
    for each in _OTHERS:
        # The first line whole: Typer itself would cut it at any full stop.
        app.command(short_help=(each.__doc__ or "").partition("\n")[0])(each)
    return app


def _listed() -> None: ...


def main(arguments: list[str] | None = None) -> int:
    """Run `fjh`; returns the exit code, as its help lists them."""
    words = sys.argv[1:] if arguments is None else arguments
    if empty := _empty_option(words):
        return _failed(f"{empty} is empty, expected a value", WRONG_INPUT)
    try:
        # What a shell completes stands in the environment.
        completed = os.environ.get("COMP_WORDS") or os.environ.get("_TYPER_COMPLETE_ARGS", "")
        code = app_of(*words[:1], *completed.split()[1:2])(
            args=words or ["--help"], prog_name="fjh", standalone_mode=False
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
