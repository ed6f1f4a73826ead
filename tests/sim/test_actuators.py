"""Actuators of all kinds in a plant: balance, commands, limits, locks, failures, repair."""

import copy
import re
from functools import cache

import mujoco
import numpy as np
import pytest
import scipy.linalg

from sim import MODELS, ClosureError, Failure, ModelError, Plant, jacobians, load_model
from tests.models import model_of
from tests.motions import kinematics
from tests.sim.machines import POSES, WORLD, pendulum, plant_of, started_model, state_at

PERIOD_S = 5e-3


def applied(plant: Plant) -> np.ndarray:
    """Return the present generalized force of all actuators."""
    mujoco.mj_forward(plant.model, plant.data)
    return plant.data.qfrc_actuator.copy()


def test_holding_forces_of_an_open_chain_are_those_of_inverse_dynamics():
    plant = plant_of("drives")
    forces, data = applied(plant), plant.data
    data.qacc[:] = 0.0
    mujoco.mj_inverse(plant.model, data)
    np.testing.assert_allclose(forces, data.qfrc_inverse, atol=1e-9)
    assert np.abs(forces).max() > 1.0


def test_holding_forces_on_a_loop_do_no_work_and_have_the_least_norm():
    """Check virtual work, and that internal forces are zero."""
    plant = plant_of("squeezed_loop")
    balance = applied(plant) + plant.data.qfrc_passive - plant.data.qfrc_bias
    motions = scipy.linalg.null_space(plant.data.efc_J.reshape(-1, plant.model.nv))
    assert np.abs(motions.T @ balance).max() < 1e-9 < np.abs(balance).max()
    arms = plant.data.actuator_moment.reshape(-1) * np.ones(3)  # one entry a row
    places = plant.model.jnt_dofadr[plant.model.actuator_trnid[:, 0]]
    squeeze = scipy.linalg.null_space(motions[places].T * arms)
    assert squeeze.shape == (3, 1)
    assert abs(squeeze[:, 0] @ plant.data.actuator_force) < 1e-9


def test_another_actuator_bears_the_load_beyond_the_range_of_a_weak_one():
    """Two actuators of 5 and 50 N support 19.6 N; with the least norm each takes half."""
    model = mujoco.MjModel.from_xml_string("""<mujoco><worldbody><body name="plate">
      <joint name="lift" type="slide" axis="0 0 1"/><geom size="0.1" mass="2"/><site name="tool"/>
      </body></worldbody>
      <equality><joint name="lock1" joint1="lift" active="false"/></equality>
      <actuator><position joint="lift" kp="1000" forcerange="-5 5"/>
      <position joint="lift" kp="1000" forcerange="-50 50"/></actuator></mujoco>""")
    plant = Plant(model, **WORLD, start=mujoco.MjData(model))
    np.testing.assert_allclose(plant.data.actuator_force, [5.0, 2 * 9.81 - 5.0], rtol=1e-6)
    plant.step(np.zeros(1), 1.0)
    assert np.abs(plant.displacements()).max() < 1e-6


TRUNK = """<mujoco><worldbody><body name="trunk"><joint type="{}" axis="0 1 0" name="root" {}/>
  <geom size="0.1" pos="0.1 0 0"/><body><joint name="a"/><geom size="0.1"/>
  <site name="tool" pos="1 0 0"/></body></body></worldbody>
  <equality><joint name="lock1" joint1="a" active="false"/></equality>
  <actuator><position joint="a" kp="9"/></actuator></mujoco>"""


@pytest.mark.parametrize("joint", ["free", "hinge"])
def test_an_unsupported_joint_is_reported_and_floats_without_gravity(joint):
    model = mujoco.MjModel.from_xml_string(TRUNK.format(joint, ""))
    with pytest.raises(ModelError, match=r'^gravity moves .*joint "root": no actuator holds it$'):
        Plant(model, **WORLD, start=mujoco.MjData(model))
    model.opt.gravity[:] = 0.0
    plant = Plant(model, **WORLD, start=mujoco.MjData(model))
    plant.settle(0.1)
    assert not plant.displacement().any()


def test_a_start_out_of_balance_is_rejected():
    sprung = mujoco.MjModel.from_xml_string(TRUNK.format("hinge", 'stiffness="9" springref="1"'))
    sprung.opt.gravity[:] = 0.0
    with pytest.raises(ModelError, match=r'^a spring moves the joint "root": no actuator holds it'):
        Plant(sprung, **WORLD, start=mujoco.MjData(sprung))
    with pytest.raises(ModelError, match='"geared" cannot hold the start'):
        plant_of("drives", ('name="geared"', 'name="geared" forcerange="-0.1 0.1"'))
    with pytest.raises(ModelError, match=r'"crank" cannot hold the start: .* 0..0.1'):
        plant_of("drives", ('ctrlrange="-0.7 -0.62"', 'ctrlrange="0 0.1"'))
    model, _ = started_model("squeezed_loop")
    with pytest.raises(ClosureError, match=r"call sim\.assemble"):
        Plant(model, **WORLD, start=state_at(model, left=0.3))


@pytest.mark.parametrize("name", POSES)
def test_the_response_to_a_command_is_that_of_the_linear_model(name):
    """The transient agrees within 1 % of the peak; at rest the payload has moved by J command."""
    model, start = started_model(name)
    robot, kin = Plant(model, **WORLD, start=start), kinematics(jacobians(model, start, "tool"))
    lin, Z = robot.linear(), scipy.linalg.null_space(kin.active_constraint)
    for command in 1e-4 * Z @ Z.T:  # each drive alone, as far as the loops admit
        plant, size = copy.deepcopy(robot), len(lin.A)
        drift = np.block([[lin.A, (lin.B @ command)[:, None]], [np.zeros((1, size + 1))]])
        tick, x = scipy.linalg.expm(drift * PERIOD_S), np.eye(size + 1)[-1]
        seen, expected = [], []
        for _ in range(100):
            plant.step(command, PERIOD_S)
            x = tick @ x
            seen.append(np.concatenate([plant.displacements(), plant.displacement()]))
            expected.append(np.concatenate([lin.C_active @ x[:-1], lin.C_twist @ x[:-1]]))
        error = np.abs(np.array(seen) - expected)
        assert error.max() < 0.01 * np.abs(seen).max()
        plant.step(command, 0.5)
        assert np.abs(plant.displacements() - command).max() < 0.01 * np.abs(command).max()
        off = np.linalg.norm(plant.displacement() - kin.J @ command)
        assert off <= 0.01 * np.linalg.norm(kin.J @ command) + 1e-9


def test_a_motor_pulls_a_tendon_with_a_spring():
    """The force of the control balances that of the spring."""
    cable = 'stiffness="100" springlength="0.0"'
    plant = Plant(pendulum('<motor tendon="c" gear="4"/>', 'damping="9"', cable), **WORLD)
    plant.step(np.array([0.01]), 8.0)
    assert plant.displacements()[0] == pytest.approx(0.01, rel=1e-6)
    assert plant.data.qpos[0] == pytest.approx(0.02, rel=1e-6)


def test_displacements_are_those_of_the_present_pose_in_motion():
    """The displacement of the tendon is 0.05 times that of its joint at every tick."""
    plant = plant_of("drives")
    plant.step(0.01 * np.eye(len(plant.drives))[1], PERIOD_S)
    assert plant.data.qvel.any()
    turned = plant.data.joint("elbow").qpos[0] - POSES["drives"]["elbow"]
    assert plant.displacements()[1] == pytest.approx(0.05 * turned, rel=1e-9)


def test_a_command_at_the_end_of_a_range_has_the_whole_slope():
    """A central difference across the end of the range would give half of it."""
    plant = plant_of("drives")
    free = plant.linear().B
    control = plant.model.actuator("crank").id
    plant.model.actuator_ctrlrange[control, 1] = plant.data.ctrl[control]
    np.testing.assert_allclose(plant.linear().B, free, rtol=1e-6)


REJECTED = [
    ('<motor name="m" joint="a"/>', {}, '"m" is a torque motor, .*sim.servoed'),
    ('<velocity name="m" joint="a" kv="2"/>', {}, '"m" is a velocity servo, whose control is a'),
    ('<muscle name="m" joint="a" lengthrange="-1 1"/>', {}, '"m" is a muscle: only servos and'),
    ('<position name="m" joint="a" kp="2" timeconst="1"/>', {}, '"m" has an internal state'),
    ('<damper name="m" joint="a" kv="2" ctrlrange="0 1"/>', {}, '"m" is an actuator of variable'),
    ('<general name="m" joint="a" gainprm="0"/>', {}, '"m" has gain 0, so it cannot be commanded'),
    ('<general name="m" joint="a" biastype="affine" biasprm="0 2"/>', {}, '"m" pushes away from'),
    (
        '<position name="m" site="tool" gear="1 0 0 0 0 0"/>',
        {},
        '"m" measures a length that does not',
    ),
    ('<adhesion name="m" body="arm" gain="1" ctrlrange="0 1"/>', {}, '"m" adheres'),
    (
        '<motor name="m" joint="a"/>',
        {"joint": 'stiffness="3 1"'},
        'the spring of joint "a" is not linear',
    ),
    ("", {}, "^the model has no enabled actuator, so nothing can be commanded: add one$"),
]


@pytest.mark.parametrize(("actuator", "springs", "pattern"), REJECTED)
def test_actuators_without_static_displacement_are_rejected_with_the_reason(
    actuator, springs, pattern
):
    with pytest.raises(ModelError, match=pattern) as raised:
        Plant(pendulum(actuator, **springs), **WORLD)
    assert "\n" not in str(raised.value)


def test_a_drive_rests_at_its_limits_for_any_larger_command():
    """Ranges of joint, tendon, control and force apply, each at the nearest end."""
    plant = plant_of("drives")
    lower, upper = plant.limits()
    start = plant.data.ctrl[-1]
    limits = np.array([lower, upper])[:, [0, 1, 2, -1]].T  # geared, winch, coils, crank
    ends = [[-1.4, 0.6], [-0.045, 0.025], [-0.07, 0.06]]
    np.testing.assert_allclose(limits, [*ends, [(-0.7 - start) / 2, (-0.62 - start) / 2]])
    assert not np.isfinite([lower[3:-1], upper[3:-1]]).any()
    for beyond in (1.0, 1.2):
        plant.step(beyond * upper[-1] * np.eye(len(upper))[-1], 2.0)
        assert plant.displacements()[-1] == pytest.approx(upper[-1], rel=0.01)


def test_a_force_range_limits_the_share_of_a_spring_force():
    """The two coils share the spring force as their gears, 1 to 3; the first has 12 N."""
    plant = plant_of("drives", (' range="-0.05 0.08"', ""), ("-400 400", "-12 12"))
    preload = plant.data.actuator_force[2]
    lower, upper = plant.limits()
    ends = (np.array([-12, 12]) - preload) / (30000 * 1 / 10)
    np.testing.assert_allclose([lower[2], upper[2]], ends, rtol=1e-9)
    plant.step(upper[2] * np.eye(len(upper))[2], 2.0)
    assert plant.data.actuator_force[2] == pytest.approx(12.0, rel=1e-6)


NAMES = {"base": None, "payload": "foot"}
COMMAND = np.array([0.5, -0.4, 0.3])


@pytest.mark.parametrize(
    ("name", "drive"), [("drives", 0), ("drives", 1), ("drives", 2), ("gantry", 1)]
)
def test_a_joint_or_tendon_locks_in_motion_at_its_present_position(name, drive):
    plant = plant_of(name) if name in POSES else Plant(model_of(name), **WORLD)
    command = 0.01 * np.eye(len(plant.drives))[drive]
    plant.step(command, 0.05)
    Failure(drive, "locked").inject(plant)
    where = plant.displacements()[drive]
    assert abs(where) > 1e-4
    for _ in range(50):
        plant.step(-command, PERIOD_S)
        assert plant.displacements()[drive] == pytest.approx(where, abs=1e-6)


@pytest.mark.parametrize("flag", ["", "EQUALITY", "CONSTRAINT"])
@pytest.mark.parametrize("actuator", range(3))
def test_an_added_lock_is_effective_in_motion(actuator, flag):
    """The other joints move; flags that disable equalities are cleared without effect on others."""
    model = model_of("three_joints", add_locks=True)
    bit = int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{flag}", 0))
    model.opt.disableflags |= bit
    model.jnt_limited[:], model.jnt_range[:] = flag == "CONSTRAINT", [-0.05, 0.05]
    plant, away = Plant(model, **NAMES), 0.0
    plant.step(COMMAND, 0.1)
    plant.lock(actuator)
    where = plant.displacements()[actuator]
    for _ in range(300):
        plant.step(-COMMAND, 1e-3)
        away = max(away, abs(plant.displacements()[actuator] - where))
    assert 0 < away < 1e-6 and np.abs(np.delete(plant.displacements(), actuator)).min() > 0.1
    assert model.opt.disableflags & bit == bit


def damped(integrator: str, step_s: float, *changes: tuple[str, str]) -> mujoco.MjModel:
    """Create a chain with joint dampers only, which every integrator treats implicitly."""
    model = model_of("three_joints", *changes, add_locks=True)
    model.dof_damping[:], model.actuator_biasprm[:, 2] = 20.0, 0.0
    model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator}")
    model.opt.timestep, model.eq_solref[:] = step_s, [2 * step_s, 1.0]
    return model


@cache
def simulated(integrator: str, step_s: float, *locked: int) -> np.ndarray:
    """Simulate a smooth path on which actuators lock at 0.3 s; displacements every 10 ms."""
    plant, seen = Plant(damped(integrator, step_s), **NAMES), []
    for tick in range(100):
        for actuator in locked if tick == 30 else ():
            plant.lock(actuator)
        phase = 2 * np.pi * tick * 0.01 / 0.6
        plant.step(0.1 * np.sin(phase) * COMMAND, 0.01)
        seen.append(plant.displacements())
    return np.array(seen)


@pytest.mark.parametrize("locked", [(1,), (0, 2)])
@pytest.mark.parametrize("integrator", ["EULER", "IMPLICIT", "IMPLICITFAST", "DISCRETE"])
@pytest.mark.parametrize("step_s", [2e-3, 5e-3, 1e-2])
def test_a_lock_is_as_stiff_at_any_usual_step_as_at_a_short_one(integrator, step_s, locked):
    """The reference is MuJoCo at 0.1 ms, where the equality alone holds."""
    oracle, path = simulated("DISCRETE", 1e-4, *locked), simulated(integrator, step_s, *locked)
    healthy = np.ptp(simulated(integrator, step_s)[31:], axis=0)
    assert (np.ptp(path[31:], axis=0)[list(locked)] < 0.05 * healthy[list(locked)]).all()
    assert (np.abs(path - oracle).max(axis=0) < 0.15 * healthy).all()


def test_a_yielding_lock_is_reported_before_the_simulation():
    """A lock yields on a tendon, whose inertia cannot be raised, or if the file has a soft one."""
    cable = '<tendon><fixed name="cable"><joint joint="knee" coef="1"/></fixed></tendon>'
    on_cable = ("<equality/>", cable), ('"knee_servo" joint="knee"', '"knee_servo" tendon="cable"')
    warnings = {
        (integrator, step_s): Plant(damped(integrator, step_s, *on_cable), **NAMES).soft_locks
        for integrator in ("IMPLICITFAST", "DISCRETE")
        for step_s in (2.5e-4, 1e-2)
    }
    assert {k: list(v) for k, v in warnings.items() if v} == {("IMPLICITFAST", 1e-2): [1]}
    pattern = r'lock of tendon "cable" yields, by about \d+ % .* implicitfast .* of 10 ms'
    assert re.search(pattern, warnings["IMPLICITFAST", 1e-2][1])
    soft = model_of("three_joints", *on_cable, add_locks=True)
    soft.eq_solref[:], soft.eq_solimp[:, 0] = [0.1, 1.0], 0.9
    assert "a time constant of" in Plant(soft, **NAMES).soft_locks[1]


def test_locks_may_have_other_names_and_must_fix_one_joint():
    def brakes(*names: str) -> mujoco.MjModel:
        pairs = zip(names, ("hip", "knee", "ankle"), strict=False)
        locks = "".join(f'<joint name="{n}" joint1="{j}" active="false"/>' for n, j in pairs)
        return model_of("three_joints", ("<equality/>", f"<equality>{locks}</equality>"))

    plant = Plant(brakes("a", "b", "c"), **NAMES)
    plant.lock(2)
    np.testing.assert_array_equal(plant.data.eq_active, [False, False, True])
    with pytest.raises(ModelError, match=r'named "lock1" to lock the joint "hip"; load_model\('):
        Plant(brakes(), **NAMES)
    with pytest.raises(ModelError, match='equality "lock1" must lock the joint "hip" alone'):
        Plant(brakes("hip_brake", "lock1", "c"), **NAMES)


def test_locking_an_actuator_without_a_lock_is_rejected():
    plant = plant_of("drives")
    for drive, pattern in ((3, '"x" cannot be locked: it moves neither'), (7, '"crank" cannot be')):
        with pytest.raises(ModelError, match=pattern):
            plant.lock(drive)


def test_all_actuators_of_a_drive_weaken_and_are_released_together():
    """Factors multiply in any state; other actuators keep their forces and springs."""
    shift, number = 1e-3 * np.random.default_rng(0).normal(size=(3, 20)), range(8)
    for k in number:
        plant = plant_of("drives")
        data, springs = plant.data, plant.model.jnt_stiffness.copy()
        mujoco.mj_integratePos(plant.model, data.qpos, shift[0, : plant.model.nv], 1.0)
        data.qvel[:], data.ctrl[:] = shift[1, : plant.model.nv], data.ctrl + shift[2, :9]
        applied(plant)
        before = plant.coil_force_n()
        assert abs(before[k]) > 1e-2
        for effectiveness, left in ((0.5, 0.5), (0.6, 0.3), (0.0, 0.0)):
            plant.weaken(k, effectiveness)
            applied(plant)
            expected = before * np.where(np.arange(len(before)) == k, left, 1.0)
            np.testing.assert_allclose(plant.coil_force_n(), expected, rtol=1e-12)
        plant.release(k)
        applied(plant)
        silent = np.isin(np.arange(9), plant.drives[k].ids)
        np.testing.assert_array_equal(data.actuator_force == 0.0, silent)
        plant.break_loose(k)
        if plant.drives[k].joint is not None:
            springs[plant.drives[k].joint] = 0.0
        np.testing.assert_array_equal(plant.model.jnt_stiffness, springs)


@pytest.mark.parametrize("groups", [(0, 0, 0), (30, 30, 30), (30, 31, 5), (-1, 40, 30)])
@pytest.mark.parametrize("off", [None, 0, 7, 30])
def test_actuators_of_any_groups_are_released_one_by_one(groups, off):
    """Actuators that the model disables stay disabled."""
    model, number = model_of("three_joints", add_locks=True), range(3)
    model.actuator_group[:] = groups
    model.opt.disableactuator = 0 if off is None else 1 << off
    on = [k for k in number if groups[k] != off]
    if not on:
        return
    plant, names = Plant(model, **NAMES), ["hip_servo", "knee_servo", "ankle_servo"]
    assert [drive.actuators for drive in plant.drives] == [(names[k],) for k in on]
    for count in range(1, len(on) + 1):
        plant.release(count - 1)
        plant.step(np.full(len(on), 0.1), plant.model.opt.timestep)
        silent = np.flatnonzero(plant.data.actuator_force == 0.0).tolist()
        assert silent == sorted({*number} - {*on[count:]})
    np.testing.assert_array_equal(model.actuator_group, groups)


@pytest.fixture(params=["fjh", "arm", "drives"])
def plant(request) -> Plant:
    """Create plants; the last has a tendon spring, two motors on a joint, drives without locks."""
    if request.param == "drives":
        return plant_of("drives", ('<fixed name="cable"', '<fixed name="cable" stiffness="300"'))
    return Plant(load_model(MODELS / f"{request.param}.xml"))


def of_failures(plant: Plant) -> bytes:
    """Serialize all that failures may change: the model and active equalities."""
    model = copy.copy(plant.model)
    model.opt.disableactuator = 0  # groups without elements
    content = np.empty(mujoco.mj_sizeModel(model), dtype=np.uint8)
    mujoco.mj_saveModel(model, None, content)
    return content.tobytes() + plant.data.eq_active.tobytes()


def inject(plant: Plant, actuator: int, kinds: str) -> None:
    """Inject the possible failures among some kinds, one after the other."""
    drive = plant.drives[actuator]
    for kind in kinds.split():
        if kind != "locked" or drive.joint is not None or drive.tendon is not None:
            Failure(actuator, kind).inject(plant)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "kinds", ["weak", "locked", "free", "loose", "weak locked weak free loose"]
)
def test_repair_restores_all_that_failures_change(plant, kinds):
    """Failures of other actuators are not repaired."""
    before = of_failures(plant)
    plant.step(np.full(len(plant.drives), 1e-5), PERIOD_S)
    for actuator in range(len(plant.drives)):
        inject(plant, 0, kinds)
        alone = of_failures(plant)
        if actuator:
            inject(plant, actuator, kinds)
            plant.repair(actuator)
        assert of_failures(plant) == alone != before
        plant.repair(0)
        assert of_failures(plant) == before
