"""Animations of runs, with frames from shortly before the first failure."""

import numpy as np
import pytest
from PIL import Image

from experiments.app.cli import main
from fjh.recording import animate
from tests.fjh.recording.conftest import NEEDS_DRIVER


@pytest.mark.long
@NEEDS_DRIVER
def test_two_runs_are_columns_of_a_small_animation_that_repeats(
    made, recorded, tmp_path, monkeypatch
):
    monkeypatch.setattr(animate, "FRAMES", 3)
    out = tmp_path / "new" / "run.gif"
    runs = [str(made / "made.npz"), str(recorded.file.with_suffix(".npz"))]
    assert main(["animate", *runs, "--out", str(out)]) == 0
    assert [path.name for path in out.parent.iterdir()] == ["run.gif"]
    with Image.open(out) as animation:
        assert getattr(animation, "n_frames", 1) == 3
        animation.seek(2)
        for column in np.array_split(np.asarray(animation.convert("RGB")), 2, axis=1):
            assert np.ptp(column) > 100  # the picture is not empty
