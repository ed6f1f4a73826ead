"""Tasks: several frames, centres of mass and relative motion, and the way to a target."""

from functools import cache
from pathlib import Path

import mujoco
import numpy as np
import pytest

from sim import (
    Body,
    CenterOfMass,
    Pin,
    Relative,
    assemble,
    jacobians,
    pose_error,
    pose_of,
)

TASKS = [
    "left",
    Body("rod"),
    CenterOfMass(),
    CenterOfMass("arm1"),
    Relative("left", "right"),
    Relative(Body("rod"), "left"),
]


@cache
def two_arms() -> mujoco.MjModel:
    """On a trunk that floats, a closed loop in one of them, and everything turned."""
    return mujoco.MjModel.from_xml_path(str(Path(__file__).parents[1] / "models/two_arms.xml"))


@pytest.fixture
def model() -> mujoco.MjModel:
    return two_arms()


def some_pose(model: mujoco.MjModel, seed: int) -> mujoco.MjData:
    data = mujoco.MjData(model)
    step = 0.2 * np.random.default_rng(seed).normal(size=model.nv)
    mujoco.mj_integratePos(model, data.qpos, step, 1.0)
    return assemble(model, data)


def at(model: mujoco.MjModel, data: mujoco.MjData, step: np.ndarray) -> mujoco.MjData:
    there = mujoco.MjData(model)
    there.qpos[:] = data.qpos
    mujoco.mj_integratePos(model, there.qpos, step, 1.0)
    return there


@pytest.mark.parametrize("axes", [None, "room"])
@pytest.mark.parametrize("task", TASKS, ids=str)
def test_the_rows_of_a_task_are_the_slope_of_the_way_to_where_it_was(model, task, axes):
    """Central differences of pose_error along every velocity; their error falls as h^2."""
    data = some_pose(model, 0)
    jac = jacobians(model, data, task, axes)
    target = pose_of(model, data, task, axes)
    if isinstance(task, CenterOfMass):
        target = target.translation_m
    errors = []
    for h in (4e-3, 2e-3):
        ways = [
            pose_error(model, at(model, data, -e), task, target, axes)
            - pose_error(model, at(model, data, e), task, target, axes)
            for e in h * np.eye(model.nv)
        ]
        errors.append(np.abs(np.transpose(ways) / (2 * h) - jac.J_T[:, : model.nv]).max())
    assert errors[1] < 1e-4
    assert errors[1] < 0.3 * errors[0] + 1e-9


def test_rows_of_several_tasks_are_stacked_and_known_by_task(model):
    data = some_pose(model, 1)
    jac = jacobians(model, data, TASKS, "room")
    assert jac.J_T.shape == (6 + 6 + 3 + 3 + 6 + 6, model.nv + 3)  # three drives of the ball
    assert jac.rows["left"] == slice(0, 6)
    for task in TASKS:
        alone = jacobians(model, data, task, "room")
        np.testing.assert_array_equal(jac.J_T[jac.rows[task]], alone.J_T)
    # What two frames share, the floating trunk, does not move one relative to the other.
    between = jac.J_T[jac.rows[Relative("left", "right")]]
    assert np.abs(between[:, :6]).max() < 1e-14 < 0.1 < np.abs(between).max()


def test_a_name_is_that_of_a_site_or_else_of_a_body(model):
    """In tasks, pins, poses and axes."""
    data = mujoco.MjData(model)
    by_name = jacobians(model, data, ["fore1", Relative("right", "fore1")], axes="fore1")
    by_body = jacobians(model, data, [Body("fore1"), Relative("right", Body("fore1"))])
    R = data.body("fore1").xmat.reshape(3, 3)
    np.testing.assert_allclose(by_name.J_T, np.kron(np.eye(4), R.T) @ by_body.J_T, atol=1e-12)
    pose = pose_of(model, data, "fore1")
    np.testing.assert_array_equal(pose.translation_m, data.body("fore1").xpos)
    for pin in ("fore1", Pin("fore1")):
        held = jacobians(model, data, "left", pinned=[pin], active=True).J_C
        np.testing.assert_array_equal(held[-3:], by_body.J_T[3:6])
    both = mujoco.MjModel.from_xml_string("""<mujoco><worldbody><body name="tip"><joint name="j"/>
      <geom size="1"/><site name="tip" pos="1 0 0"/></body></worldbody>
      <actuator><motor joint="j"/></actuator></mujoco>""")
    there = pose_of(both, mujoco.MjData(both), "tip").translation_m
    np.testing.assert_array_equal(there, [1.0, 0.0, 0.0])
