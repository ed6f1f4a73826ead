"""What is drawn of the machines, against MuJoCo's own frames."""

import mujoco
import numpy as np

from fjh.live.flight import Flight
from fjh.live.stage import Pointer
from fjh.rig import Rig
from tests.fjh.live.robots import rig


def flown(one: Rig, ticks: int) -> Flight:
    """Along the first major row, a tenth of the path's size."""
    flight = Flight(one, one.controller(), ticks, 0)
    ahead = np.zeros(len(one.major))
    ahead[0] = 0.1 * one.size
    for _ in range(ticks):
        flight.step(ahead, None)
    return flight


def payload(one: Rig, flight: Flight) -> tuple[np.ndarray, np.ndarray]:
    """Its site in the world at the last tick that was seen: position and rotation."""
    data = mujoco.MjData(one.model)
    data.qpos[:] = flight.seen(slice(flight.tick - 1, flight.tick))[1][0]
    mujoco.mj_kinematics(one.model, data)
    site = data.site("payload")
    return site.xpos.copy(), site.xmat.reshape(3, 3).copy()


def test_where_a_tool_is_drawn_it_is():
    flight = flown(rig("arm"), 40)
    rows = flight.seen(slice(39, 40))[2]
    drawn = Pointer(rig("arm"), *flight.frame).at(rows, 1.0)[0]
    np.testing.assert_allclose(drawn, payload(rig("arm"), flight)[0], atol=1e-12)
    assert np.linalg.norm(drawn - flight.frame[0]) > 1e-6


def test_where_the_hexapod_is_drawn_to_point_it_points():
    """Whatever the rows that do not matter do: they turn it about the axis it points along."""
    flight = flown(rig(), 40)
    pointer = Pointer(rig(), *flight.frame)
    at_rest, drawn = pointer.at(np.array([[0.0, 0.0], flight.seen(slice(39, 40))[2][0]]), 1.0)
    lever = at_rest - flight.frame[0]
    turn = payload(rig(), flight)[1] @ payload(rig(), flown(rig(), 1))[1].T
    moved = turn @ lever
    # To first order: angles of microradians.
    np.testing.assert_allclose(drawn - flight.frame[0], moved, atol=1e-9)
    assert np.linalg.norm(moved - lever) > 1e-7
