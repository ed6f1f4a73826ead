"""Views of a reader are what a new reader finds at that pose, whatever was read before."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import mujoco
import numpy as np
import pytest

from sim import (
    MODELS,
    Body,
    CenterOfMass,
    CenterOfMassTask,
    ClosureError,
    FrameTask,
    JacobianReader,
    JointCouplingTask,
    LookAtTask,
    Pin,
    PostureTask,
    Relative,
    RelativeFrameTask,
    TaskFunction,
    load_model,
)
from tests.sim.test_jacobian import everything, random_closed_pose
from tests.sim.test_limits import limited
from tests.sim.test_transmission import CASES, mechanism

HUMANOID = load_model(MODELS / "humanoid.xml")
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
    rng, poses = np.random.default_rng(0), []
    for _ in range(4):
        poses.append(data := mujoco.MjData(HUMANOID))
        step = rng.normal(scale=0.3, size=HUMANOID.nv)
        mujoco.mj_integratePos(HUMANOID, data.qpos, step, 1.0)
    return (lambda: JacobianReader(HUMANOID, TASKS, axes, pinned=pinned, active=["root"])), poses


def of_loops(storage: str) -> tuple[Callable, Poses]:
    """Closed, open, and with other equalities."""
    model, poses = everything(storage)[0], []
    for seed in range(4):
        poses.append(data := mujoco.MjData(model))
        data.eq_active[model.equality("brake").id] = seed == 2
        random_closed_pose(model, data, seed)
        data.qpos[:7] += 1e-3 * (seed % 2)
    tasks = ["tool", Body("rod1")]
    return (lambda: JacobianReader(model, tasks, "ground", closure_tolerance=np.inf)), poses


def of_limits() -> tuple[Callable, Poses]:
    """Another number of joints and tendons at a limit in each, and drives that are no joint."""
    poses = [limited(), limited(slide=0.2), limited(1.0, 0.05, 0.9), limited(), limited(slide=0.2)]
    model = poses[0].model
    return (lambda: JacobianReader(model, "tool", stuck_at_limits=True)), poses


def of_drives(kind: str) -> tuple[Callable, Poses]:
    model, first = mechanism(CASES[kind][0], 0)
    poses = [first]
    for seed in (1, 2):
        there = mechanism(CASES[kind][0], seed)[1]
        poses.append(data := mujoco.MjData(model))
        data.qpos[:] = there.qpos
    return (lambda: JacobianReader(model, "tool")), poses


MADE: dict[str, Callable[[], tuple[Callable, Poses]]] = {
    "every task": of_humanoid,
    "in axes": lambda: of_humanoid("right_hand"),
    "pins": lambda: of_humanoid(None, FEET),
    "pins, in axes": lambda: of_humanoid("left_foot", FEET),
    "loops": lambda: of_loops("dense"),
    "loops, sparse": lambda: of_loops("sparse"),
    "limits": of_limits,
} | {f"drives: {kind}": (lambda kind=kind: of_drives(kind)) for kind in CASES}


@pytest.mark.parametrize("name", MADE)
def test_views_are_to_the_bit_what_a_new_reader_finds_there(name):
    make, poses = MADE[name]()
    reader = make()
    for data in (*poses, *poses[::-1]):
        new, found = make().at(data), reader.read(data)
        for ours, theirs in ((found.J_T, new.J_T), (found.J_C, new.J_C)):
            assert ours.shape == theirs.shape
            assert ours.tobytes() == theirs.tobytes()
            assert ours.flags.c_contiguous and not ours.flags.writeable
        np.testing.assert_array_equal(found.active, new.active)
        assert found.closure_residual == new.closure_residual
        assert found.error_bound == new.error_bound


@pytest.mark.parametrize("name", ["every task", "loops", "limits", f"drives: {next(iter(CASES))}"])
def test_the_next_reading_overwrites_views_and_nothing_else(name):
    make, poses = MADE[name]()
    reader = make()
    views = [reader.read(data) for data in poses]
    last = views[-1].J_T.copy()
    reader.at(poses[0])
    np.testing.assert_array_equal(views[-1].J_T, last)
    own = [reader.at(data) for data in poses]
    kept = [(jac.J_T.copy(), jac.J_C.copy()) for jac in own]
    again = [reader.read(data) for data in poses]
    for before, after in zip(views, again, strict=True):  # no new memory
        assert np.shares_memory(before.J_T, after.J_T)
        np.testing.assert_array_equal(before.J_T, after.J_T)
    for jac, (J_T, J_C) in zip(own, kept, strict=True):
        np.testing.assert_array_equal(jac.J_T, J_T)
        np.testing.assert_array_equal(jac.J_C, J_C)
        assert not any(np.shares_memory(jac.J_T, each.J_T) for each in again)


def test_a_joint_at_its_limit_has_a_row_of_its_own_velocity_after_any_other_pose():
    make, poses = of_limits()
    reader, first = make(), np.eye(7)
    for data in (limited(np.deg2rad(60.0), 0.2), *poses, limited(np.deg2rad(60.0), 0.2)):
        found = reader.read(data).J_C[:, :5]
        at = [k for k, most in enumerate([np.deg2rad(60.0), 0.2]) if data.qpos[k] >= most - 1e-9]
        np.testing.assert_array_equal(found[2 : 2 + len(at)], first[at, :5])


@dataclass(eq=False)
class Short(TaskFunction):
    """A task that says two rows and gives one."""

    frames: tuple = ()
    angular: tuple[bool, ...] = (False, False)

    def on(self, model):
        """Nothing to look up."""
        return self

    def jacobian(self, model, data):
        """One row."""
        return np.ones((1, model.nv))

    def error(self, model, data):
        """Nothing is missing."""
        return np.zeros(2)


@pytest.mark.parametrize("way", ["read", "at"])
def test_a_task_with_other_rows_than_it_says_is_refused(way):
    reader = JacobianReader(HUMANOID, [Short()], active=["root"])
    with pytest.raises(
        ValueError,
        match=r"the Jacobian of Short\(.*\) must have shape \(2, 35\)",
    ):
        getattr(reader, way)(mujoco.MjData(HUMANOID))


def test_views_are_refused_where_a_loop_is_open():
    model, data = everything()
    random_closed_pose(model, data, 0)
    reader = JacobianReader(model, "tool")
    reader.read(data)
    data.qpos[0] += 0.1
    with pytest.raises(ClosureError):
        reader.read(data)


@pytest.mark.usefixtures("switching")
def test_four_threads_get_arrays_of_their_own_from_one_reader():
    make, poses = MADE["pins, in axes"]()
    reader, alone = make(), [make().at(data) for data in poses]

    def read(k: int) -> list[bytes]:
        return [reader.at(poses[k]).J_T.tobytes() for _ in range(60)]

    with ThreadPoolExecutor(4) as pool:
        for k, found in enumerate(pool.map(read, range(4))):
            assert set(found) == {alone[k].J_T.tobytes()}
