"""The command `fjh animate`: one run, or two side by side, as a GIF."""

import shlex
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from experiments.study.errors import WrongInput
from experiments.study.files import published, usable_file
from experiments.study.spelling import check_file
from experiments.study.terminal import OnProgress, print_ending, progress

if TYPE_CHECKING:
    from experiments.recording.view import RunView

FRAMES, FRAME_MS, LAST_MS = 72, 90, 2000
_BEFORE = 0.15  # part of the time after the first failure that is shown of the time before
_COLUMN_PX, _COLORS = (400, 660), 128  # size of a run, and how many colours there are

_RUNS = typer.Argument(metavar="RUN.npz [RUN.npz]", help="A run of any robot, or two.")
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

    It shows the machine, with what has failed in magenta, its path and its error as the viewer
    does; two runs of one robot and task are on the same scales. It begins shortly before the first
    failure. Like `fjh render` it needs a Vulkan driver, but no display. A GIF of 8 s, below 1 MB;
    takes half a minute.

    Example: fjh animate unaware/track.npz diagnosed/track.npz --out lock.gif
    """
    if len(runs) > 2:
        raise WrongInput(f"an animation has one run or two, got {len(runs)}")
    for run in runs:
        check_file(run)
    folder = usable_file(out, ".gif")
    with (
        progress("animate", shown=not quiet) as on_progress,
        published(folder, index=out.name) as staging,
    ):
        write_animation(staging / out.name, runs, model, on_progress)
    if not quiet:
        following = shlex.join(["fjh", "review", *map(str, runs)])
        print_ending("The viewer gave no warning.", out, following)


def write_animation(
    path: Path, files: list[Path], model: Path | None, on_progress: OnProgress
) -> None:
    """Write a GIF of runs that repeats."""
    from PIL import Image  # late: help does not wait for it

    from experiments.app.render import headless_viewer, on_white, photograph, show
    from experiments.app.review import about_runs, find_runs
    from experiments.recording.file import TIMELINE
    from experiments.recording.layout import write_film
    from experiments.recording.scene import scenes_of

    runs, pictures = find_runs(files, model), list[Image.Image]()
    views = {name: one.view for name, one in runs.items()}
    size = _COLUMN_PX[0] * len(runs), _COLUMN_PX[1]
    with tempfile.TemporaryDirectory() as folder, headless_viewer(size) as viewer:
        recording = Path(folder, "film.rrd")
        write_film(recording, about_runs(runs), scenes_of(views, paths=True))
        show(viewer, recording, None)
        for time_s in times_of(*views.values()):
            viewer.set_time(TIMELINE, duration=time_s)
            pictures.append(on_white(photograph(viewer)))
            on_progress(len(pictures), FRAMES)
    palette = pictures[-1].quantize(_COLORS)
    first, *others = (one.quantize(palette=palette, dither=Image.Dither.NONE) for one in pictures)
    shown_ms = [*[FRAME_MS] * (FRAMES - 1), LAST_MS]
    first.save(path, save_all=True, append_images=others, duration=shown_ms, loop=0)


def times_of(*runs: "RunView") -> list[float]:
    """Times of the frames [s], evenly spaced, from shortly before the first failure to the end."""
    begin_s, end_s = min(one.time_s[0] for one in runs), max(one.time_s[-1] for one in runs)
    struck_s = min((each.time_s for one in runs for each in one.failures), default=begin_s)
    first_s = max(begin_s, struck_s - _BEFORE * (end_s - struck_s))
    return [first_s + (end_s - first_s) * k / (FRAMES - 1) for k in range(FRAMES)]
