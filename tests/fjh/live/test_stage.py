"""Drawn positions against MuJoCo's frames."""

import mujoco
import numpy as np

from fjh.live.live_run import LiveRun
from fjh.live.stage import Pointer
from fjh.rig import Rig
from tests.fjh.rigs import shared_rig


def simulated(rig: Rig, ticks: int) -> tuple[LiveRun, np.ndarray, np.ndarray]:
    """Simulate a step of a tenth of the path in the first major row; also return the site pose."""
    live = LiveRun(rig, rig.controller(), ticks, 0)
    ahead = 0.1 * rig.size * np.eye(len(rig.major))[0]
    for _ in range(ticks):
        live.step(ahead, None)
    data = mujoco.MjData(rig.model)
    data.qpos[:] = live.motion(slice(ticks - 1, ticks))[1][0]
    mujoco.mj_kinematics(rig.model, data)
    site = data.site("payload")
    return live, site.xpos.copy(), site.xmat.reshape(3, 3).copy()


def test_tool_is_drawn_at_its_position():
    rig = shared_rig("arm", major=(3, 4, 5))
    live, place, _ = simulated(rig, 40)
    position = Pointer(rig, *live.frame).at(live.motion(slice(39, 40))[2], 1.0)[0]
    np.testing.assert_allclose(position, place, atol=1e-12)
    assert np.linalg.norm(position - live.frame[0]) > 1e-6


def test_hexapod_is_drawn_in_its_pointing_direction():
    """Rows beyond pointing rotate the hexapod about its pointing axis, without effect."""
    (live, _, turned), (_, _, start) = (
        simulated(shared_rig("hexapod"), ticks) for ticks in (40, 1)
    )
    pointer = Pointer(shared_rig("hexapod"), *live.frame)
    at_rest, position = pointer.at(np.array([[0.0, 0.0], live.motion(slice(39, 40))[2][0]]), 1.0)
    lever = at_rest - live.frame[0]
    moved = turned @ start.T @ lever
    # Angles are of microradians, so first order is exact.
    np.testing.assert_allclose(position - live.frame[0], moved, atol=1e-9)
    assert np.linalg.norm(moved - lever) > 1e-7
