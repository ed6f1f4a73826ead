"""Jacobians of any MJCF against finite differences, and results of a reader."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import mujoco
import numpy as np
import pytest
import scipy.linalg
from scipy.spatial.transform import Rotation

from fjh.rig.hexapod.closed_form import hexapod
from sim import (
    MODELS,
    NOMINAL,
    Body,
    CenterOfMass,
    CenterOfMassTask,
    FrameTask,
    JacobianReader,
    JointCouplingTask,
    LookAtTask,
    Pin,
    PostureTask,
    Relative,
    RelativeFrameTask,
    assemble,
    jacobians,
    linearize,
    load_model,
)
from sim.mjcf import mass_matrix
from tests.motions import check_slope, kinematics, shifted
from tests.sim.machines import (
    CASES,
    SPARSE,
    closed_state,
    humanoid,
    limited,
    linkage,
    state_at,
    stored_options,
)


@stored_options
@pytest.mark.parametrize("seed", range(4))
def test_the_task_jacobian_is_the_slope_of_the_pose_along_closed_loops(storage, seed):
    """Move along the null space of J_C, close the loops again, and compare the tool's motion."""
    model = linkage(*storage)
    data = closed_state(model, seed)
    jac = jacobians(model, data, "payload", "post")
    Z = scipy.linalg.null_space(jac.J_C)
    assert Z.shape == (model.nv, 7)
    velocity = Z @ np.random.default_rng(seed).normal(size=7)
    velocity /= np.linalg.norm(velocity)
    to_post = data.site("post").xmat.reshape(3, 3).T
    at_first = data.site("payload").xmat.reshape(3, 3).copy()

    def pose(h: float) -> np.ndarray:
        tool = assemble(model, shifted(model, data, h * velocity)).site("payload")
        turn = Rotation.from_matrix(tool.xmat.reshape(3, 3) @ at_first.T).as_rotvec()
        return np.concatenate([to_post @ turn, to_post @ tool.xpos])

    check_slope(jac.J_T @ velocity, pose, h=4e-3, most=1e-4)


def test_the_jacobian_is_the_closed_form_away_from_the_nominal_pose(model):
    """The hexapod has a closed form at given strut lengths."""
    machine = hexapod(model)
    target = NOMINAL.moved(np.array([2e-3, -1e-3, 3e-3, 5e-4, 2e-4, -4e-4]))
    struts = [f"strut{k}" for k in range(1, 7)]
    lengths = dict(zip(struts, machine.displacements(target), strict=True))
    there = assemble(model, state_at(model, **lengths), held=struts)
    kin = kinematics(jacobians(model, there, "payload", "base"))
    np.testing.assert_allclose(machine.inverse_jacobian(target) @ kin.J, np.eye(6), atol=1e-7)

    def displacements(h: float) -> np.ndarray:
        return np.array([machine.displacements(target.moved(h * e)) for e in np.eye(6)]).T

    check_slope(machine.inverse_jacobian(target), displacements, h=1e-3, most=1e-5)


TASKS = [
    "right_hand",
    CenterOfMass(),
    Relative("left_hand", "right_hand"),
    Body("left_elbow"),
    FrameTask("left_hand", rows=[3, 4, 5]),
    FrameTask("left_foot", rows=[5, 0]),
    FrameTask("right_foot", axes="left_hand"),
    RelativeFrameTask("left_hand", "right_hand", rows=[0, 1, 3]),
    CenterOfMassTask(rows=[0, 1]),
    PostureTask(),
    JointCouplingTask({"left_knee": 1.0, "right_knee": -1.0}),
    LookAtTask("left_hand", [0, 0, 1], target=[1.0, 2.0, 3.0]),
]
FEET = "left_foot", Pin("right_foot", weld=True)
Poses = list[mujoco.MjData]


def of_humanoid(axes: str | None = None, pinned: tuple = ()) -> tuple[Callable, Poses]:
    model, rng = humanoid(), np.random.default_rng(0)
    first = mujoco.MjData(model)
    poses = [shifted(model, first, rng.normal(scale=0.3, size=model.nv)) for _ in range(4)]
    return (lambda: JacobianReader(model, TASKS, axes, pinned=pinned, active=["root"])), poses


def of_loops(*storage: tuple[str, str]) -> tuple[Callable, Poses]:
    """Create states with closed and open loops, and with other equalities."""
    model, poses = linkage(*storage), []
    for seed in range(4):
        poses.append(data := closed_state(model, seed))
        data.eq_active[model.equality("brake").id] = seed == 2
        data.eq_active[model.equality("reel").id] = seed != 3
        data.qpos[:7] += 1e-3 * (seed % 2)
    tasks = ["payload", Body("rocker")]
    return (lambda: JacobianReader(model, tasks, "post", closure_tolerance=np.inf)), poses


def of_limits() -> tuple[Callable, Poses]:
    """Create states with different numbers of elements on limits, and drives without joints."""
    poses = [limited(), limited(slide=0.2), limited(1.0, 0.05, 0.9), limited(), limited(slide=0.2)]
    model = poses[0].model
    return (lambda: JacobianReader(model, "tool", stuck_at_limits=True)), poses


def of_drives(kind: str) -> tuple[Callable, Poses]:
    model = linkage(actuators=CASES[kind].mjcf)
    return (lambda: JacobianReader(model, "tool")), [closed_state(model, seed) for seed in range(3)]


MADE: dict[str, Callable[[], tuple[Callable, Poses]]] = {
    "every task": of_humanoid,
    "in axes": lambda: of_humanoid("right_hand"),
    "pins": lambda: of_humanoid(None, FEET),
    "pins, in axes": lambda: of_humanoid("left_foot", FEET),
    "loops": of_loops,
    "loops, sparse": lambda: of_loops(SPARSE),
    "limits": of_limits,
} | {f"drives: {kind}": (lambda kind=kind: of_drives(kind)) for kind in CASES}


@pytest.mark.parametrize("name", MADE)
def test_views_equal_the_result_of_a_new_reader_exactly(name):
    make, poses = MADE[name]()
    reader = make()
    for data in (*poses, *poses[::-1]):
        new, views = make().at(data), reader.read(data)
        for view, copied in ((views.J_T, new.J_T), (views.J_C, new.J_C)):
            assert view.shape == copied.shape
            assert view.tobytes() == copied.tobytes()
            assert view.flags.c_contiguous and not view.flags.writeable
        np.testing.assert_array_equal(views.active, new.active)
        assert views.closure_residual == new.closure_residual
        assert views.error_bound == new.error_bound
        own = reader.at(data)
        assert own.J_C.tobytes() == new.J_C.tobytes()
        assert own.rows == new.rows


def test_a_reader_follows_actuators_that_are_switched_off():
    model = linkage()
    data, reader = closed_state(model), JacobianReader(model, "tool")
    both = reader.at(data)
    model.actuator_group[1], model.opt.disableactuator = 1, 2
    one = reader.at(data)
    assert (len(both.active), len(one.active)) == (2, 1)
    new = jacobians(model, data, "tool")
    np.testing.assert_array_equal(one.J_C, new.J_C)
    assert one.warnings == new.warnings


@pytest.mark.parametrize("name", ["every task", "loops", "limits", f"drives: {next(iter(CASES))}"])
def test_the_next_reading_overwrites_views_and_nothing_else(name):
    make, poses = MADE[name]()
    reader = make()
    views = [reader.read(data) for data in poses]
    last = views[-1].J_T.copy()
    reader.at(poses[0])
    np.testing.assert_array_equal(views[-1].J_T, last)
    own = [reader.at(data) for data in poses]
    copies = [(jac.J_T.copy(), jac.J_C.copy()) for jac in own]
    again = [reader.read(data) for data in poses]
    for before, after in zip(views, again, strict=True):  # no new memory
        assert np.shares_memory(before.J_T, after.J_T)
        np.testing.assert_array_equal(before.J_T, after.J_T)
    for jac, (J_T, J_C) in zip(own, copies, strict=True):
        np.testing.assert_array_equal(jac.J_T, J_T)
        np.testing.assert_array_equal(jac.J_C, J_C)
        assert not any(np.shares_memory(jac.J_T, other.J_T) for other in again)


@pytest.mark.usefixtures("switching")
def test_four_threads_get_separate_arrays_from_one_reader():
    make, poses = MADE["pins, in axes"]()
    reader, alone = make(), [make().at(data) for data in poses]

    def read(k: int) -> list[bytes]:
        return [reader.at(poses[k]).J_T.tobytes() for _ in range(60)]

    with ThreadPoolExecutor(4) as pool:
        for k, matrices in enumerate(pool.map(read, range(4))):
            assert set(matrices) == {alone[k].J_T.tobytes()}


def test_data_of_another_model_are_rejected(model):
    """MuJoCo would read past their end."""
    data = mujoco.MjData(load_model(MODELS / "arm.xml"))
    for ask in (mass_matrix, linearize, jacobians):
        site: dict[str, Any] = {"site": "payload"} if ask is jacobians else {}
        with pytest.raises(ValueError, match="data must be of this model"):
            ask(model, data, **site)


def test_invalid_states_and_tasks_are_rejected(model):
    data = mujoco.MjData(model)
    with pytest.raises(ValueError, match="site must not repeat a task"):
        jacobians(model, data, site=["payload", "payload"])
    data.qpos[0] = np.nan
    with pytest.raises(ValueError, match=r"data\.qpos must be finite"):
        jacobians(model, data, site="payload")
