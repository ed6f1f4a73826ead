"""The command `fjh`: one experiment, its options, one sentence when something is wrong."""

import sys
from itertools import pairwise

import typer

from experiments.app.command import command as command_of
from experiments.app.presentation import presented
from experiments.app.render.command import render
from experiments.app.report.command import report
from experiments.app.review.command import review
from experiments.atlas.command import atlas
from experiments.benchmark.command import bench
from experiments.figures.command import figures
from experiments.force.command import force
from experiments.goals import STUDY as GOALS
from experiments.jacobian import STUDY as JACOBIAN
from experiments.output.files import OutputError
from experiments.output.interrupt import INTERRUPTED, SENTENCE
from experiments.output.study import Interrupted, Unsound, WrongInput
from experiments.output.terminal import notice
from experiments.recover.command import recover
from experiments.release import STUDY as RELEASE
from experiments.sweep.command import sweep
from experiments.systems import STUDY as SYSTEMS
from experiments.table1.command import table1
from experiments.uncorrected.command import uncorrected

UNSOUND, WRONG_INPUT = 1, 2

HELP = """Experiments on the fault-tolerant hexapod and the other mechanisms of its paper.

Each of the studies runs one experiment in MuJoCo and prints its tables; `fjh report` runs all. Into
results/COMMAND/, or where --out says, it writes all numbers (.json, units in their names), data
(.npz), figures and recordings (.rrd; `rerun FILE.rrd` opens one). Begin with `fjh table1`: a
minute on two cores. `fjh review` and `fjh render` show what is there.
"""
EXIT_CODES = """\b
Exit codes:
  0    sound
  1    unsound: a simulation diverged, left its prediction or missed a goal; no picture
  2    wrong input
  130  interrupted; no file is left half-written
"""

app = typer.Typer(name="fjh", help=HELP, epilog=EXIT_CODES, rich_markup_mode=None)
STUDIES = (
    table1,
    figures,
    recover,
    force,
    uncorrected,
    sweep,
    atlas,
    bench,
    report,
)
for command in (
    *map(presented, STUDIES),
    *map(command_of, (SYSTEMS, GOALS, JACOBIAN, RELEASE)),
    review,
    render,
):
    # The first line whole: Typer itself would cut it at any full stop.
    app.command(short_help=(command.__doc__ or "").partition("\n")[0])(command)


def main(arguments: list[str] | None = None) -> int:
    """Run `fjh`; returns the exit code: 0 sound, 1 unsound, 2 wrong input, 130 interrupted."""
    words = sys.argv[1:] if arguments is None else arguments
    if empty := _empty_option(words):
        return _complain(f"{empty} is empty, expected a value", WRONG_INPUT)
    try:
        code = app(args=words or ["--help"], prog_name="fjh", standalone_mode=False)
    except typer.exceptions.TyperException as error:
        return _complain(error.format_message(), WRONG_INPUT)
    except (WrongInput, OutputError) as error:
        return _complain(str(error), WRONG_INPUT)
    except Unsound as error:
        return _complain(str(error), UNSOUND)
    except Interrupted as error:
        return _complain(str(error), INTERRUPTED)
    if code == INTERRUPTED:  # Typer has already caught the Ctrl-C
        return _complain(SENTENCE, INTERRUPTED)
    return code or 0


def _empty_option(words: list[str]) -> str | None:
    """The first option or argument with nothing in it; a path of nothing would be this folder."""
    for former, word in pairwise(["the first argument", *words]):
        if not word:
            return former if former.startswith("-") else f"an argument after {former}"
        if word.startswith("--") and word.endswith("="):
            return word[:-1]
    return None


def _complain(sentence: str, code: int) -> int:
    if sentence:
        notice(sentence)
    return code
