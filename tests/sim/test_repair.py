"""A repaired actuator works as before, whatever it had; and where the task frame of a plant is."""

from collections.abc import Sequence

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sim import MODELS, Body, Failure, Plant, load_model
from tests.sim.test_any_plant import POSES, SERIAL, started

PERIOD_S = 5e-3
STATE = int(mujoco.mjtState.mjSTATE_INTEGRATION)
SPRUNG = SERIAL.replace('<fixed name="cable"', '<fixed name="cable" stiffness="300"')
OF_FAILURES = "actuator_group", "actuator_gainprm", "actuator_biasprm"
OF_FAILURES += "jnt_stiffness", "tendon_stiffness"
ONE_AFTER_ANOTHER = ("weak", "locked", "weak", "free", "loose")
KINDS = (*[(kind,) for kind in dict.fromkeys(ONE_AFTER_ANOTHER)], ONE_AFTER_ANOTHER)
"""What an actuator has before it is repaired."""


@pytest.fixture(params=["hexapod", "arm", "serial"])
def plant(request, tmp_path) -> Plant:
    """The last has a spring on a tendon, two motors on a joint, and drives without a lock."""
    if request.param == "serial":
        return started(SPRUNG, tmp_path, **POSES["serial"][1])
    name = {"hexapod": "fjh"}.get(request.param, request.param)
    return Plant(load_model(MODELS / f"{name}.xml"))


def of_model(plant: Plant) -> dict[str, np.ndarray]:
    return {name: getattr(plant.model, name).copy() for name in OF_FAILURES}


def strike(plant: Plant, actuator: int, kinds: Sequence[str], has_lock: bool = True) -> None:
    for kind in kinds:
        if kind != "locked" or has_lock:
            Failure(actuator, kind).strike(plant)  # type: ignore[arg-type]


def lockable(plant: Plant) -> list[bool]:
    return [drive.joint is not None or drive.tendon is not None for drive in plant.drives]


@pytest.mark.parametrize("kinds", KINDS, ids=" ".join)
def test_repair_gives_the_model_back_all_that_failures_take(plant, kinds):
    before, active = of_model(plant), plant.data.eq_active.copy()
    plant.step(np.full(len(plant.drives), 1e-5), PERIOD_S)
    for actuator, has_lock in enumerate(lockable(plant)):
        strike(plant, actuator, kinds, has_lock)
        if has_lock or kinds != ("locked",):
            changed = [not np.array_equal(value, before[n]) for n, value in of_model(plant).items()]
            assert any(changed) or not np.array_equal(plant.data.eq_active, active)
        plant.repair(actuator)
        for name, value in of_model(plant).items():
            np.testing.assert_array_equal(value, before[name], err_msg=name)
        np.testing.assert_array_equal(plant.data.eq_active, active)


def test_a_repaired_machine_moves_as_a_sound_one_bit_for_bit(plant):
    n = len(plant.drives)
    state = np.empty(mujoco.mj_stateSize(plant.model, STATE))
    mujoco.mj_getState(plant.model, plant.data, state, STATE)
    commands = 1e-3 * np.sin(np.arange(20)[:, None] + np.arange(n))

    def moved() -> np.ndarray:
        mujoco.mj_setState(plant.model, plant.data, state, STATE)
        mujoco.mj_forward(plant.model, plant.data)
        visited = []
        for command in commands:
            plant.step(command, PERIOD_S)
            visited.append([*plant.data.qpos, *plant.data.qvel])
        return np.array(visited)

    sound = moved()
    for actuator, has_lock in enumerate(lockable(plant)):
        strike(plant, actuator, ONE_AFTER_ANOTHER, has_lock)
    assert np.abs(moved() - sound).max() > 1e-6
    for actuator in range(n):
        plant.repair(actuator)
    np.testing.assert_array_equal(moved(), sound)


def test_a_repair_leaves_the_other_failures_as_they_are(plant):
    for actuator in (0, 1):
        strike(plant, actuator, ONE_AFTER_ANOTHER)
    both = of_model(plant)
    plant.repair(0)
    ids, other = (list(plant.drives[k].ids) for k in (0, 1))
    assert not np.array_equal(plant.model.actuator_gainprm[ids], both["actuator_gainprm"][ids])
    for name in OF_FAILURES[:3]:
        np.testing.assert_array_equal(getattr(plant.model, name)[other], both[name][other])
    assert plant.data.eq_active[plant._locks[1]] and not plant.data.eq_active[plant._locks[0]]


def test_the_task_frame_is_where_mujoco_has_it_and_its_axes_are_those_of_the_base():
    """Its base turns with the first joint of the arm; the origin stays that of the nominal pose."""
    model = load_model(MODELS / "arm.xml")
    turned = mujoco.MjData(model)
    turned.qpos[:] = 0.1 * np.arange(1, model.nq + 1)
    mujoco.mj_forward(model, turned)
    at_rest = mujoco.MjData(model)
    mujoco.mj_forward(model, at_rest)
    bodies = [model.body(k).name for k in range(model.nbody)]
    plant = Plant(model, base=Body(bodies[2]), payload="payload")
    np.testing.assert_allclose(plant.origin_m, at_rest.site("payload").xpos, atol=1e-15)
    plant.data.qpos[:] = turned.qpos
    mujoco.mj_forward(plant.model, plant.data)
    quaternion = turned.body(bodies[2]).xquat
    expected = Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
    np.testing.assert_allclose(plant.axes, expected, atol=1e-12)
    np.testing.assert_allclose(plant.origin_m, at_rest.site("payload").xpos, atol=1e-15)
    assert np.abs(expected - np.eye(3)).max() > 0.05
    np.testing.assert_array_equal(Plant(model, base=None).axes, np.eye(3))


def test_who_alters_the_frame_of_a_plant_alters_a_copy():
    plant = Plant(load_model())
    plant.origin_m[:], plant.axes[:] = 7.0, 7.0
    assert not (plant.origin_m == 7.0).any() and not (plant.axes == 7.0).any()
