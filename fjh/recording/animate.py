"""GIF animations of one run, or of two side by side."""

import tempfile
from pathlib import Path

from PIL import Image

from fjh.recording.file import TIMELINE
from fjh.recording.layout import write_film
from fjh.recording.render import headless_viewer, on_white, photograph, show
from fjh.recording.review import about_runs, find_runs
from fjh.recording.scene import scenes_of
from fjh.recording.view import RunView
from fjh.study.option import OnProgress

FRAMES, FRAME_MS, LAST_MS = 72, 90, 2000
_LEAD = 0.15  # time before the first failure, as a fraction of that after it
_COLUMN_PX, _COLORS = (400, 660), 128  # size of a run's column, and number of colours


def write_animation(
    path: Path, files: list[Path], model: Path | None, on_progress: OnProgress
) -> None:
    """Write a GIF of the runs in some `.npz` files, which repeats without end."""
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
    durations_ms = [*[FRAME_MS] * (FRAMES - 1), LAST_MS]
    first.save(path, save_all=True, append_images=others, duration=durations_ms, loop=0)


def times_of(*runs: RunView) -> list[float]:
    """Return times of the frames [s], evenly spaced from before the first failure to the end."""
    start_s, end_s = min(one.time_s[0] for one in runs), max(one.time_s[-1] for one in runs)
    onset_s = min((failure.time_s for run in runs for failure in run.failures), default=start_s)
    first_s = max(start_s, onset_s - _LEAD * (end_s - onset_s))
    return [first_s + (end_s - first_s) * k / (FRAMES - 1) for k in range(FRAMES)]
