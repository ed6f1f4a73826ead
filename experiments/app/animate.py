"""The command `fjh animate`: a run of the hexapod as a GIF."""

import shlex
from pathlib import Path
from typing import Annotated

import typer

from experiments.app.command import machine_refused
from experiments.study.files import published, usable_file
from experiments.study.spelling import check_file
from experiments.study.terminal import Ending, print_ending, progress

_RUN = typer.Argument(metavar="RUN.npz", help="A run of the hexapod.")
_OUT = typer.Option(metavar="FILE.gif", help="The animation to write.")
_MODEL = typer.Option(
    metavar="FILE", help="The machine file of the run, MJCF.  [default: the hexapod, fjh.xml]"
)
_QUIET = typer.Option("--quiet", help="No progress: file and exit code only.")


def animate(
    run: Annotated[Path, _RUN],
    out: Annotated[Path, _OUT],
    model: Annotated[Path | None, _MODEL] = None,
    quiet: Annotated[bool, _QUIET] = False,
) -> None:
    """Make an animation of a run of the hexapod.

    The machine, its motion magnified; the detector; the pointing error. Failures and diagnoses
    are taken from the recording (.rrd) beside the run, where there is one. No display is needed. A
    GIF of 12 s below 3 MB; takes a minute.

    Example: fjh animate results/recover/locked.npz --out locked.gif
    """
    check_file(run)
    folder = usable_file(out, ".gif")
    with progress("animate", shown=not quiet) as on_progress, machine_refused():
        from experiments.app.review import find_runs  # late: help does not wait for it
        from experiments.recording.animation import Animation, write_animation
        from sim import hexapod, load_model, model_sha256

        machine = load_model(model)
        hexapod(machine)  # raises for any other
        (one,) = find_runs([run], model_sha256(model)).values()
        with published(folder, index=out.name) as staging:
            write_animation(staging / out.name, Animation(machine, one.shown), on_progress)
    if not quiet:
        beside = run.with_suffix(".rrd")
        following = ["rerun", str(beside)] if beside.exists() else ["fjh", "review", str(run)]
        print_ending(Ending("The data of the run are whole.", out, shlex.join(following)))
