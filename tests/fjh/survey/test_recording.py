"""Recording of a survey: motions that are lost, each in a cell."""

from typing import Any

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fjh.survey import recording
from fjh.survey.recording import losses, title, write_losses
from sim import MODELS
from tests.fjh.survey.surveys import of_robot
from tests.robots import TEST_MODELS
from tests.rrd import entities, notes

SURVEYED = {
    "arm": (MODELS / "arm.xml", "0,1"),
    "platform": (MODELS / "platform.xml", "3,4"),
    "ropes": (TEST_MODELS / "ropes.xml", "3,4"),
}
"""Model file and major rows of an arm, a platform and an arm of ropes."""


def survey(name: str) -> Any:
    file, major = SURVEYED[name]
    return of_robot(file, axes=None, major=major)


def moved(model: mujoco.MjModel, qpos: np.ndarray) -> np.ndarray:
    """Return the payload's displacement from the start along the motion, from MuJoCo, (T, 6)."""
    data, poses = mujoco.MjData(model), []
    site = model.site("payload").id
    for data.qpos[:] in qpos:
        mujoco.mj_kinematics(model, data)
        poses.append((data.site_xmat[site].reshape(3, 3).copy(), data.site_xpos[site].copy()))
    (R, x), *_ = poses
    turns = [Rotation.from_matrix(R_site @ R.T).as_rotvec() for R_site, _ in poses]
    return np.hstack([turns, [place - x for _, place in poses]])


@pytest.mark.parametrize("name", SURVEYED)
def test_recorded_motion_is_along_the_lost_direction(name, monkeypatch, tmp_path):
    """The site moves in the lost direction; failed joints move, and in self-motions no others."""
    surveyed, written = survey(name), {}
    monkeypatch.setattr(recording, "MOST", 99)
    monkeypatch.setattr(recording, "condition_scene", lambda *driven, **_: driven)
    monkeypatch.setattr(recording, "write_scenes", lambda *of, pages: written.update(of[2]))
    write_losses(surveyed.system, surveyed.start, "fjh survey", "verdict", tmp_path)
    model, lost = surveyed.system.robot.scene.task_model, losses(surveyed.system, surveyed.start)
    assert len(written) == len(lost) > 0
    active = surveyed.system.constrained_system.active
    for loss, (_, _, qpos, (plot,)) in zip(lost, written.values(), strict=True):
        moved_by = moved(model, qpos)
        size = moved_by @ loss.direction
        np.testing.assert_allclose(moved_by, np.outer(size, loss.direction), atol=2e-3 * size.max())
        plotted = 1e-6 * plot.values
        np.testing.assert_allclose(plotted[:, int(loss.drifts)], size, atol=2e-3 * size.max())
        assert not plotted[:, 1 - loss.drifts].any() and size.max() > 1e-4
        rates = loss.velocities[active]
        for codes in surveyed.start.codes[loss.rows]:
            failing = np.flatnonzero(codes)
            assert (codes[failing] == (2 if loss.drifts else 1)).all()
            assert np.abs(rates[failing]).max() > 1e-3 * np.abs(rates).max()
            if loss.drifts:
                assert not np.delete(rates, failing).any()


def test_directions_beyond_one_screen_are_in_further_recordings(tmp_path, monkeypatch):
    monkeypatch.setattr(recording, "MOST", 3)
    surveyed = survey("arm")
    lost = losses(surveyed.system, surveyed.start)
    write_losses(surveyed.system, surveyed.start, "fjh survey", "verdict", tmp_path)
    files = sorted(tmp_path.glob("*.rrd"))
    cells = [sum(entity.endswith("/along") for entity in entities(file)) for file in files]
    assert sum(cells) == len(lost) and max(cells) == 3 and len(files) == -(-len(lost) // 3)
    text = "\n".join(notes(file) for file in files)
    assert all(title(surveyed.system, surveyed.start, loss, most=99) in text for loss in lost)
