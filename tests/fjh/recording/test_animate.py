"""Runs as an animation: frames of the viewer, from shortly before the first failure."""

import numpy as np
import pytest
from PIL import Image

from experiments.app.cli import main
from fjh.recording import animate
from fjh.recording.view import Change
from tests.fjh.recording.conftest import NEEDS_DRIVER
from tests.made import made_view


@pytest.mark.parametrize("incidents", [[], [Change("strut1", "locked", 0.3)]])
def test_the_frames_begin_shortly_before_the_failure_and_run_forward(incidents):
    run = made_view(*incidents)
    end_s, times_s = float(run.time_s[-1]), animate.times_of(run, run)
    assert np.ptp(np.diff(times_s)) < 1e-12
    assert times_s[-1] == pytest.approx(end_s)
    struck_s = incidents[0].time_s if incidents else 0.0
    before_s = 0.15 * (end_s - struck_s) if incidents else 0.0
    assert times_s[0] == pytest.approx(struck_s - before_s)
    assert 6000 < animate.FRAMES * animate.FRAME_MS + animate.LAST_MS < 9000


@pytest.mark.long
@NEEDS_DRIVER
def test_two_runs_are_columns_of_a_small_animation_that_repeats(made, kept, tmp_path, monkeypatch):
    monkeypatch.setattr(animate, "FRAMES", 3)
    out = tmp_path / "new" / "run.gif"
    runs = [str(made / "made.npz"), str(kept.file.with_suffix(".npz"))]
    assert main(["animate", *runs, "--out", str(out)]) == 0
    assert [path.name for path in out.parent.iterdir()] == ["run.gif"]
    assert out.stat().st_size * animate.FRAMES < 1.5e6
    with Image.open(out) as animation:
        assert getattr(animation, "n_frames", 1) == 3
        assert animation.info["loop"] == 0
        animation.seek(2)
        frame = np.asarray(animation.convert("RGB")).astype(int)
    assert frame.shape == (660, 800, 3)
    assert np.median(frame) > 230  # on white
    for column in np.array_split(frame, 2, axis=1):
        red, green, blue = np.moveaxis(column, -1, 0)
        assert ((red > 150) & (blue > 80) & (green < 0.6 * blue)).sum() > 100  # what has failed
