"""Frames, centres of mass and relative motion as tasks: their rows and names."""

import mujoco
import numpy as np
import pytest

from sim import (
    Body,
    CenterOfMass,
    JacobianReader,
    JointCouplingTask,
    LookAtTask,
    Pin,
    PostureTask,
    Relative,
    jacobians,
    pose_error,
    pose_of,
)
from tests.models import model
from tests.motions import check_slope, shifted
from tests.sim.machines import closed

TASKS = [
    "left",
    Body("rod"),
    CenterOfMass(),
    CenterOfMass("arm1"),
    Relative("left", "right"),
    Relative(Body("rod"), "left"),
]


@pytest.mark.parametrize("axes", [None, "room"])
@pytest.mark.parametrize("task", TASKS, ids=str)
def test_the_rows_of_a_task_are_the_slope_of_the_way_from_where_it_was(task, axes):
    """Along every velocity, and so of the error with which rates lead to a target."""
    of = model("two_arms")
    data = closed(of)
    target = pose_of(of, data, task, axes)
    if isinstance(task, CenterOfMass):
        target = target.translation_m

    def way(h: float) -> np.ndarray:
        ends = [shifted(of, data, h * e) for e in np.eye(of.nv)]
        return -np.transpose([pose_error(of, end, task, target, axes) for end in ends])

    check_slope(jacobians(of, data, task, axes).J_T[:, : of.nv], way, h=4e-3, most=1e-4)


def test_rows_of_several_tasks_are_stacked_and_known_by_task():
    of = model("two_arms")
    data = closed(of, 1)
    looking = LookAtTask("left", [0, 0, 1], target=np.ones(3))
    functions = [looking, JointCouplingTask({"a1": 1.0}), PostureTask(target=of.qpos0)]
    tasks = [*TASKS, *functions]
    jac = JacobianReader(of, tasks, "room").at(data)
    assert [jac.rows[task].stop for task in tasks[:8]] == [6, 12, 15, 18, 24, 30, 32, 33]
    assert jac.J_T.shape == (jac.rows[tasks[8]].stop, of.nv + 3)  # three drives of the ball
    for task in tasks:
        alone = jacobians(of, data, task, "room")
        np.testing.assert_array_equal(jac.J_T[jac.rows[task]], alone.J_T)
    # What two frames share, the floating trunk, does not move one relative to the other.
    between = jac.J_T[jac.rows[Relative("left", "right")]]
    assert np.abs(between[:, :6]).max() < 1e-14 < 0.1 < np.abs(between).max()


def test_a_name_is_that_of_a_site_or_else_of_a_body():
    """In tasks, pins, poses and axes."""
    of = model("two_arms")
    data = mujoco.MjData(of)
    by_name = jacobians(of, data, ["fore1", Relative("right", "fore1")], axes="fore1")
    by_body = jacobians(of, data, [Body("fore1"), Relative("right", Body("fore1"))])
    R = data.body("fore1").xmat.reshape(3, 3)
    np.testing.assert_allclose(by_name.J_T, np.kron(np.eye(4), R.T) @ by_body.J_T, atol=1e-12)
    pose = pose_of(of, data, "fore1")
    np.testing.assert_array_equal(pose.translation_m, data.body("fore1").xpos)
    for pin in ("fore1", Pin("fore1")):
        held = jacobians(of, data, "left", pinned=[pin], active=True).J_C
        np.testing.assert_array_equal(held[-3:], by_body.J_T[3:6])
    both = model("two_arms", ('<site name="left"', '<site name="fore2"'))
    there = mujoco.MjData(both)
    place = pose_of(both, there, "fore2").translation_m
    np.testing.assert_array_equal(place, there.site("fore2").xpos)
    assert np.abs(place - there.body("fore2").xpos).max() > 0.01
