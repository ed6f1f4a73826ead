"""What is drawn of the machines, against MuJoCo's own frames."""

import mujoco
import numpy as np

from fjh.live.live_run import LiveRun
from fjh.live.stage import Pointer
from fjh.rig import Rig
from tests.fjh.rigs import rig


def flown(one: Rig, ticks: int) -> tuple[LiveRun, np.ndarray, np.ndarray]:
    """Along the first major row, a tenth of the path's size; and where MuJoCo then has the site."""
    flight = LiveRun(one, one.controller(), ticks, 0)
    ahead = 0.1 * one.size * np.eye(len(one.major))[0]
    for _ in range(ticks):
        flight.step(ahead, None)
    data = mujoco.MjData(one.model)
    data.qpos[:] = flight.motion(slice(ticks - 1, ticks))[1][0]
    mujoco.mj_kinematics(one.model, data)
    site = data.site("payload")
    return flight, site.xpos.copy(), site.xmat.reshape(3, 3).copy()


def test_tool_is_drawn_at_its_position():
    one = rig("arm", major=(3, 4, 5))
    flight, place, _ = flown(one, 40)
    drawn = Pointer(one, *flight.frame).at(flight.motion(slice(39, 40))[2], 1.0)[0]
    np.testing.assert_allclose(drawn, place, atol=1e-12)
    assert np.linalg.norm(drawn - flight.frame[0]) > 1e-6


def test_hexapod_is_drawn_in_its_pointing_direction():
    """Whatever the rows that do not matter do: they turn it about the axis it points along."""
    (flight, _, turned), (_, _, before) = (flown(rig("hexapod"), ticks) for ticks in (40, 1))
    pointer = Pointer(rig("hexapod"), *flight.frame)
    at_rest, drawn = pointer.at(np.array([[0.0, 0.0], flight.motion(slice(39, 40))[2][0]]), 1.0)
    lever = at_rest - flight.frame[0]
    moved = turned @ before.T @ lever
    # To first order: angles of microradians.
    np.testing.assert_allclose(drawn - flight.frame[0], moved, atol=1e-9)
    assert np.linalg.norm(moved - lever) > 1e-7
