"""The command `fjh`: one experiment, its options, one sentence when something is wrong."""

import sys

import typer

from experiments.conduct import Unsound
from experiments.files import OutputError
from experiments.force.command import force
from experiments.goals.command import goals
from experiments.interrupt import INTERRUPTED, SENTENCE
from experiments.jacobian.command import jacobian
from experiments.recover.command import recover
from experiments.release.command import release
from experiments.speed.command import bench
from experiments.systems.command import systems
from experiments.table1.command import table1
from experiments.uncorrected.command import uncorrected
from sim import ModelError

UNSOUND, WRONG_INPUT = 1, 2

app = typer.Typer(
    name="fjh",
    help="Experiments on the fault-tolerant hexapod and the other mechanisms of its paper.",
    no_args_is_help=True,
    rich_markup_mode=None,
)
commands = (table1, systems, release, recover, force, goals, jacobian, uncorrected, bench)
for command in commands:
    app.command()(command)


@app.callback()
def _fjh() -> None:
    """Experiments on the fault-tolerant hexapod and the other mechanisms of its paper."""


def main(arguments: list[str] | None = None) -> int:
    """Run `fjh`; returns the exit code: 0 sound, 1 unsound, 2 wrong input, 130 interrupted."""
    try:
        code = app(args=arguments, prog_name="fjh", standalone_mode=False)
    except typer.exceptions.TyperException as error:
        return _complain(error.format_message(), WRONG_INPUT)
    except (ModelError, OutputError) as error:
        return _complain(str(error), WRONG_INPUT)
    except Unsound as error:
        return _complain(str(error), UNSOUND)
    if code == INTERRUPTED:  # Typer has already caught the Ctrl-C
        return _complain(SENTENCE, INTERRUPTED)
    return code or 0


def _complain(sentence: str, code: int) -> int:
    if sentence:
        print(f"fjh: {sentence}", file=sys.stderr)
    return code
