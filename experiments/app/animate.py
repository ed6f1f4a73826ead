"""The command `fjh animate`: one run, or two side by side, as a GIF."""

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from experiments.study.files import published, usable_file
from experiments.study.spelling import check_file
from experiments.study.study import WrongInput
from experiments.study.terminal import Ending, print_ending, progress

if TYPE_CHECKING:
    from experiments.recording.animated import Animated

_RUNS = typer.Argument(
    metavar="RUN.npz [RUN.npz]",
    help="A run of any robot, or two of the same path.",
)
_OUT = typer.Option(metavar="FILE.gif", help="The animation to write.")
_MODEL = typer.Option(
    metavar="FILE", help="The machine file of the runs, MJCF.  [default: that which they name]"
)
_QUIET = typer.Option("--quiet", help="No progress: file and exit code only.")


def animate(
    runs: Annotated[list[Path], _RUNS],
    out: Annotated[Path, _OUT],
    model: Annotated[Path | None, _MODEL] = None,
    quiet: Annotated[bool, _QUIET] = False,
) -> None:
    """Make an animation of a run, or of two side by side.

    It shows the machine, what has failed in red; the desired and the true path; and the error, a
    number and a bar. Two runs must be of the same path; they are drawn on the same scales, at the
    same time. The heading of a run is the name of its file, or of its folder where both files have
    one name. Failures and diagnoses are read from the recording (.rrd) beside the run. Where no two
    major rows have one unit, the first is drawn over time. The animation begins shortly before the
    first failure. No display is needed. A GIF of 7 s, below 1 MB; takes half a minute.

    Example: fjh animate unaware/track.npz diagnosed/track.npz --out lock.gif
    """
    if len(runs) > 2:
        raise WrongInput(f"an animation has one run or two, got {len(runs)}")
    for run in runs:
        check_file(run)
    folder = usable_file(out, ".gif")
    with progress("animate", shown=not quiet) as on_progress:
        from experiments.recording.animation import Animation, write_animation

        animation = Animation(_read(runs, model))
        with published(folder, index=out.name) as staging:
            write_animation(staging / out.name, animation, on_progress)
    if not quiet:
        beside = runs[0].with_suffix(".rrd")
        following = ["rerun", str(beside)] if beside.exists() else ["fjh", "review", str(runs[0])]
        print_ending(Ending("The data of the runs are whole.", out, shlex.join(following)))


def _read(files: Sequence[Path], model: Path | None) -> "list[Animated]":
    """Runs of any robot, by the names of their files or folders."""
    from experiments.app.review import find_runs  # late: help does not wait for it
    from experiments.recording.animated import Animated

    names = [file.stem for file in files]
    if len(set(names)) < len(names):
        names = [file.resolve().parent.name for file in files]
    found = find_runs(files, model).values()
    return [
        Animated(name.replace("_", " "), one.view) for name, one in zip(names, found, strict=True)
    ]
