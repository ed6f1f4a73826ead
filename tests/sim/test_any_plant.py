"""Plants of any drives: held still, commanded by displacements, linear, limited, failing."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
import scipy.linalg

from prioritized import ConstrainedSystem
from sim import (
    HEXAPOD_MJCF,
    ClosureError,
    Failure,
    ModelError,
    Plant,
    assemble,
    jacobians,
    load_model,
    servoed,
)

PERIOD_S = 5e-3

# Under gravity: a geared servo, a cable over a sprung joint, a sprung slide with two motors, a
# ball joint with three servos, a slider-crank, and a servo between sites.
SERIAL = """
<mujoco>
  <compiler angle="radian"/>
  <option timestep="1e-4" integrator="discrete"><flag contact="disable"/></option>
  <default><geom size="0.04" mass="0.4"/><joint armature="0.02" damping="1"/></default>
  <worldbody>
    <site name="floor"/><site name="rail" pos="0.5 0.1 0" zaxis="0 1 0"/>
    <body name="upper">
      <joint name="shoulder" axis="0 1 0" range="-1 1"/>
      <geom fromto="0 0 0 0.3 0 0" type="capsule"/>
      <body name="lower" pos="0.3 0 0">
        <joint name="elbow" axis="0 1 0" stiffness="40" springref="0.3"/>
        <geom fromto="0 0 0 0.3 0 0" type="capsule"/>
        <body name="tube" pos="0.3 0 0">
          <joint name="tube" type="slide" axis="1 0 0" stiffness="30000" springref="0.02"
            damping="100" range="-0.05 0.08"/><geom/>
          <body name="hand" pos="0.1 0 0">
            <joint name="wrist" type="ball"/><geom pos="0.05 0.02 0"/>
            <site name="tool" pos="0.1 0.05 0.02"/>
          </body>
        </body>
      </body>
    </body>
    <body pos="0.5 0.1 0.2" name="lift">
      <joint name="lift" type="slide" axis="0 0 1"/><geom/><site name="top"/>
    </body>
    <body pos="0.5 0.6 0" name="pin">
      <joint name="pin" axis="1 0 0"/><geom pos="0 0 0.05"/><site name="pin" pos="0 0 0.1"/>
    </body>
  </worldbody>
  <tendon>
    <fixed name="cable" range="-0.02 0.05" limited="true"><joint joint="elbow" coef="0.05"/></fixed>
  </tendon>
  <actuator>
    <position name="geared" joint="shoulder" gear="50" kp="20" kv="0.4"/>
    <position name="winch" tendon="cable" gear="-2" kp="5e5" kv="5e3"/>
    <motor name="coil1" joint="tube" forcerange="-400 400"/>
    <motor name="coil2" joint="tube" gear="3"/>
    <position name="x" joint="wrist" gear="2 0 0" kp="500" kv="10"/>
    <position name="y" joint="wrist" gear="0 2 0" kp="500" kv="10"/>
    <position name="z" joint="wrist" gear="0 0 2" kp="500" kv="10"/>
    <position name="between" site="top" refsite="floor" gear="0 0 3 0 0 0" kp="5e4" kv="900"/>
    <position name="crank" cranksite="pin" slidersite="rail" cranklength="0.8" gear="2"
      kp="5e4" kv="3e3" ctrlrange="-0.7 -0.62"/>
  </actuator>
</mujoco>
"""

# A loop under gravity, with more motors than freedoms.
LOOP = """
<mujoco>
  <option timestep="1e-4" integrator="discrete" jacobian="dense"/>
  <default><geom size="0.03" mass="0.4" contype="0" conaffinity="0"/>
    <joint axis="0 1 0" armature="0.02" damping="1"/>
    <equality solref="2e-4 1" solimp="0.9999 0.9999 0.001 0.5 2"/></default>
  <worldbody>
    <body name="left">
      <joint name="left"/><geom/>
      <body name="arm" pos="-0.05 0 0.2">
        <joint name="elbow"/><geom/><site name="tool" pos="0.15 0 0.2"/>
        <body pos="0.15 0 0.2">
          <joint name="tip"/><geom/>
          <body name="right" pos="0.15 0 -0.2"><joint name="right"/><geom/></body>
        </body>
      </body>
    </body>
  </worldbody>
  <equality><connect body1="right" anchor="-0.05 0 -0.2"/></equality>
  <actuator>
    <position joint="left" gear="3" kp="400" kv="8"/><position joint="right" kp="3e3" kv="60"/>
    <position joint="elbow" kp="3e3" kv="60"/>
  </actuator>
</mujoco>
"""


def posed(text: str, tmp_path: Path, **pose: float) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """A model with locks, and a closed start."""
    (tmp_path / "robot.xml").write_text(text)
    model = load_model(tmp_path / "robot.xml", add_locks=True)
    data = mujoco.MjData(model)
    for joint, value in pose.items():
        data.joint(joint).qpos[:] = value
    return model, assemble(model, data)


def started(text: str, tmp_path: Path, **pose: float) -> Plant:
    model, start = posed(text, tmp_path, **pose)
    return Plant(model, base=None, payload="tool", start=start)


POSES = {
    "serial": (SERIAL, {"shoulder": 0.4, "elbow": 0.5, "tube": 0.02, "lift": 0.05, "pin": 0.3}),
    "loop": (LOOP, {"left": 0.1, "elbow": 0.05}),
}


@pytest.fixture(params=POSES)
def robot(request, tmp_path) -> Plant:
    text, pose = POSES[request.param]
    return started(text, tmp_path, **pose)


def again(plant: Plant) -> Plant:
    """Another one of the same start."""
    start = mujoco.MjData(plant.model)
    start.qpos[:] = plant.data.qpos
    return Plant(plant.model, base=None, payload="tool", start=start)


def applied(plant: Plant) -> np.ndarray:
    """Generalized force of all actuators now."""
    mujoco.mj_forward(plant.model, plant.data)
    return plant.data.qfrc_actuator.copy()


# Held still.


def test_a_machine_that_is_held_stays_where_it_starts_under_weight_and_springs(robot):
    robot.settle(2.0)
    assert np.abs(robot.displacements()).max() < 1e-6
    assert np.abs(robot.displacement()).max() < 1e-6


def test_holding_forces_of_an_open_chain_are_those_of_inverse_dynamics(tmp_path):
    plant = started(SERIAL, tmp_path, **POSES["serial"][1])
    held, data = applied(plant), plant.data
    data.qacc[:] = 0.0
    mujoco.mj_inverse(plant.model, data)
    np.testing.assert_allclose(held, data.qfrc_inverse, atol=1e-9)
    assert np.abs(held).max() > 1.0


def test_holding_forces_on_a_loop_do_no_work_along_it_and_have_the_least_norm(tmp_path):
    """Virtual work; forces that cancel each other along every motion have no part in them."""
    plant = started(LOOP, tmp_path, left=0.1, elbow=0.05)
    balance = applied(plant) + plant.data.qfrc_passive - plant.data.qfrc_bias
    motions = scipy.linalg.null_space(plant.data.efc_J.reshape(-1, plant.model.nv))
    assert np.abs(motions.T @ balance).max() < 1e-9 < np.abs(balance).max()
    arms = plant.data.actuator_moment.reshape(-1) * np.ones(3)  # one entry a row
    places = plant.model.jnt_dofadr[plant.model.actuator_trnid[:, 0]]
    squeeze = scipy.linalg.null_space(motions[places].T * arms)
    assert squeeze.shape == (3, 1)
    assert abs(squeeze[:, 0] @ plant.data.actuator_force) < 1e-9


@pytest.mark.parametrize("joint", ["free", "ball", "hinge"])
def test_what_no_actuator_holds_is_named_and_floats_without_gravity(joint, tmp_path):
    text = f"""<mujoco><worldbody><body name="trunk">
      <joint type="{joint}" axis="0 1 0" name="root"/>
      <geom size="0.1" pos="0.1 0 0"/><body><joint name="a"/><geom size="0.1"/>
      <site name="tool" pos="1 0 0"/></body></body></worldbody>
      <actuator><position joint="a" kp="9"/></actuator></mujoco>"""
    model, start = posed(text, tmp_path)
    with pytest.raises(
        ModelError, match=r'^gravity moves the .*joint "root": no actuator holds it$'
    ):
        Plant(model, base=None, payload="tool", start=start)
    model.opt.gravity[:] = 0.0
    plant = Plant(model, base=None, payload="tool", start=start)
    plant.settle(0.1)
    assert not plant.displacement().any()


def test_a_spring_that_no_actuator_holds_is_named(tmp_path):
    text = SERIAL.replace('<joint name="pin"', '<joint name="pin" stiffness="9" springref="1"')
    text = text[: text.index('<position name="crank"')] + "</actuator></mujoco>"
    with pytest.raises(ModelError, match=r'^a spring moves the joint "pin": no actuator holds it'):
        started(text, tmp_path)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            ('name="geared"', 'name="geared" forcerange="-0.1 0.1"'),
            '"geared" cannot hold the start',
        ),
        (
            ('ctrlrange="-0.7 -0.62"', 'ctrlrange="0 0.1"'),
            '"crank" cannot hold the start: .* 0..0.1',
        ),
    ],
)
def test_a_start_beyond_the_ranges_of_actuators_is_refused(change, words, tmp_path):
    with pytest.raises(ModelError, match=words):
        started(SERIAL.replace(*change), tmp_path, **POSES["serial"][1])


def test_a_start_that_is_open_or_of_another_model_is_refused(tmp_path):
    model, _ = posed(LOOP, tmp_path)
    open_ = mujoco.MjData(model)
    open_.qpos[0] = 0.3
    with pytest.raises(ClosureError, match=r"call sim\.assemble"):
        Plant(model, base=None, payload="tool", start=open_)
    with pytest.raises(ValueError, match="data must be of this model"):
        Plant(model, base=None, payload="tool", start=mujoco.MjData(load_model()))


# Commands.


def steps(plant: Plant) -> np.ndarray:
    """A small displacement of each drive alone, or one that loops allow; (., n)."""
    size = 1e-4 * np.eye(len(plant.drives))
    if plant.model.neq and plant.data.eq_active.any():
        kin = kinematics(plant)
        size = size @ scipy.linalg.orth(scipy.linalg.null_space(kin.active_constraint)).T[:2].T
        return (size @ np.linalg.pinv(size) * 1e-4)[:2]
    return size


def kinematics(plant: Plant):
    start = mujoco.MjData(plant.model)
    start.qpos[:], start.eq_active[:] = plant.data.qpos, plant.data.eq_active
    return ConstrainedSystem.of(jacobians(plant.model, start, "tool")).kinematics()


def test_a_small_command_settles_at_that_displacement_and_moves_the_payload_by_the_jacobian(robot):
    J = kinematics(robot).J
    for command in steps(robot):
        plant = again(robot)
        plant.step(command, 2.0)
        assert np.abs(plant.displacements() - command).max() < 0.01 * np.abs(command).max()
        moved, expected = plant.displacement(), J @ command
        assert np.linalg.norm(moved - expected) <= 0.01 * np.linalg.norm(expected) + 1e-9


def test_the_linear_plant_answers_a_step_as_the_physics_does(robot):
    """Transient and rest, payload and drives, within 1 % of the peak."""
    lin = robot.linear()
    for command in steps(robot):
        plant, size = again(robot), len(lin.A)
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


@pytest.mark.parametrize(("rest", "drawn"), [("0.0", True), ("-1 1", False)])
def test_a_motor_on_a_sprung_tendon_draws_it_unless_it_is_slack(rest, drawn):
    """The spring takes what the control gives; between its two rest lengths there is none."""
    text = PENDULUM.format(g=0.0, joint='damping="9"', actuator='<motor tendon="c" gear="4"/>')
    cable = f"""<tendon><fixed name="c" stiffness="100" springlength="{rest}">
      <joint joint="a" coef="0.5"/></fixed></tendon><actuator>"""
    model = mujoco.MjModel.from_xml_string(text.replace("<actuator>", cable))
    if not drawn:
        with pytest.raises(ModelError, match="is a torque motor"):
            Plant(model, **WORLD)
        return
    plant = Plant(model, **WORLD)
    plant.step(np.array([0.01]), 8.0)
    assert plant.displacements()[0] == pytest.approx(0.01, rel=1e-6)
    assert plant.data.qpos[0] == pytest.approx(0.02, rel=1e-6)


def test_displacements_are_those_of_the_present_pose_in_motion(tmp_path):
    """A tendon's is 0.05 times that of its joint, at every tick."""
    plant = started(SERIAL, tmp_path, **POSES["serial"][1])
    elbow = plant.model.joint("elbow").qposadr[0]
    plant.step(0.01 * np.eye(len(plant.drives))[1], PERIOD_S)
    assert plant.data.qvel.any()
    turned = plant.data.qpos[elbow] - 0.5
    assert plant.displacements()[1] == pytest.approx(0.05 * turned, rel=1e-9)


@pytest.mark.parametrize("name", ["fjh", "arm", "arms", "hand", "platform"])
def test_commands_of_the_machines_of_this_repository_are_their_controls_to_the_bit(name):
    model = load_model(HEXAPOD_MJCF.with_name(f"{name}.xml"))
    plant, command = Plant(model), 1e-4 * np.random.default_rng(0).normal(size=model.nu)
    plant.step(command, 1e-3)
    np.testing.assert_array_equal(plant.data.ctrl, command)


def test_a_command_at_the_end_of_a_range_has_the_whole_slope(tmp_path):
    """Where a central difference would see half of it."""
    plant = started(SERIAL, tmp_path, **POSES["serial"][1])
    free = plant.linear().B
    control = plant.model.actuator("crank").id
    plant.model.actuator_ctrlrange[control, 1] = plant.data.ctrl[control]
    np.testing.assert_allclose(plant.linear().B, free, rtol=1e-6)


# Limits.


def test_at_its_limits_a_drive_rests_and_commands_beyond_them_take_it_no_farther(tmp_path):
    """Joint, tendon, control and force; each at the end that comes first."""
    plant = started(SERIAL, tmp_path, **POSES["serial"][1])
    lower, upper = plant.limits()
    geared, winch, tube, crank = 0, 1, 2, -1
    np.testing.assert_allclose([lower[geared], upper[geared]], [-1.4, 0.6])
    np.testing.assert_allclose([lower[winch], upper[winch]], [-0.045, 0.025])
    start = plant.data.ctrl[-1]
    np.testing.assert_allclose(
        [lower[crank], upper[crank]], [(-0.7 - start) / 2, (-0.62 - start) / 2]
    )
    assert not np.isfinite([lower[3:-1], upper[3:-1]]).any()
    assert (lower[tube], upper[tube]) == pytest.approx((-0.07, 0.06))
    for beyond in (1.0, 1.2):
        command = np.zeros(len(upper))
        command[crank] = beyond * upper[crank]
        plant = again(plant) if beyond == 1.0 else plant
        plant.step(command, 2.0)
        assert plant.displacements()[crank] == pytest.approx(upper[crank], rel=0.01)


def test_a_force_range_limits_what_a_spring_takes(tmp_path):
    """The two coils share the spring as their gears, 1 to 3; the first has 12 N."""
    text = SERIAL.replace('range="-0.05 0.08"', "").replace("-400 400", "-12 12")
    plant = started(text, tmp_path, **POSES["serial"][1])
    held = plant.data.actuator_force[2]
    lower, upper = plant.limits()
    np.testing.assert_allclose(
        [lower[2], upper[2]], (np.array([-12, 12]) - held) / (30000 * 1 / 10), rtol=1e-9
    )
    plant.step(upper[2] * np.eye(len(upper))[2], 2.0)
    assert plant.data.actuator_force[2] == pytest.approx(12.0, rel=1e-6)


# Failures.


@pytest.mark.parametrize("drive", [0, 1, 2])
def test_a_joint_or_a_tendon_locks_in_motion_where_it_is(drive, tmp_path):
    plant = started(SERIAL, tmp_path, **POSES["serial"][1])
    command = 0.01 * np.eye(len(plant.drives))[drive]
    plant.step(command, 0.05)
    Failure(drive, "locked").strike(plant)
    where = plant.displacements()[drive]
    assert abs(where) > 1e-4
    for _ in range(50):
        plant.step(-command, PERIOD_S)
        assert plant.displacements()[drive] == pytest.approx(where, abs=2e-5 * abs(0.05))


def test_what_has_no_lock_is_refused_when_it_is_to_lock_and_not_before(tmp_path):
    plant = started(SERIAL, tmp_path, **POSES["serial"][1])
    for drive, words in ((3, '"x" cannot be locked: it moves neither'), (7, '"crank" cannot be')):
        with pytest.raises(ModelError, match=words):
            plant.lock(drive)
    with pytest.raises(ModelError, match='"lock2" must lock the tendon "cable" alone'):
        Plant(mujoco.MjModel.from_xml_string(SERIAL.replace("</mujoco>", TAKEN)), **WORLD)
    with pytest.raises(ModelError, match='no equality named "lock2" to lock the tendon "cable"'):
        Plant(mujoco.MjModel.from_xml_string(SERIAL.replace("</mujoco>", LOCKS)), **WORLD).lock(1)


WORLD = {"base": None, "payload": "tool"}
LOCKS = """<equality><joint name="lock1" joint1="shoulder" active="false"/>
  <joint name="lock3" joint1="tube" active="false"/></equality></mujoco>"""
TAKEN = LOCKS.replace("</eq", '<joint name="lock2" joint1="elbow" active="false"/></eq')


def test_all_actuators_of_a_drive_weaken_and_are_released_together(tmp_path):
    plant = started(SERIAL, tmp_path, **POSES["serial"][1])
    before = plant.coil_force_n()
    plant.weaken(2, 0.5)
    applied(plant)
    expected = before * np.where(np.arange(len(before)) == 2, 0.5, 1.0)
    np.testing.assert_allclose(plant.coil_force_n(), expected, rtol=1e-12)
    assert abs(before[2]) > 1.0
    plant.release(2)
    applied(plant)
    assert not plant.data.actuator_force[2:4].any() and plant.data.actuator_force[4:].any()
    plant.break_loose(2)
    springs = plant.model.jnt_stiffness
    assert springs[plant.model.joint("tube").id] == 0.0
    assert springs[plant.model.joint("elbow").id] == 40.0


# Motors as servos, and what no displacement commands.

PENDULUM = """<mujoco><option gravity="0 0 {g}" timestep="1e-3"/><worldbody><body>
  <joint name="a" axis="0 1 0" {joint}/><geom size="0.05" mass="2" pos="0 0 -0.7"/>
  <site name="tool" pos="0.1 0 -0.7"/></body></worldbody><actuator>{actuator}</actuator></mujoco>"""


def pendulum(actuator: str, g: float = 0.0, joint: str = "") -> mujoco.MjModel:
    text = PENDULUM.format(g=g, joint=joint, actuator=actuator)
    lock = '<equality><joint name="lock1" joint1="a" active="false"/></equality></mujoco>'
    return mujoco.MjModel.from_xml_string(text.replace("</mujoco>", lock))


@pytest.mark.parametrize("ratio", [0.3, 1.0])
@pytest.mark.parametrize(
    "motors", ['<motor joint="a" gear="20"/>', '<motor joint="a"/><motor joint="a" gear="-3"/>']
)
def test_a_motor_as_a_servo_has_the_stated_poles(ratio, motors):
    """s^2 + 2 d w s + w^2."""
    model = servoed(pendulum(motors), natural_frequency_hz=4.0, damping_ratio=ratio)
    poles = np.poly(Plant(model, **WORLD).linear().A)
    w = 2 * np.pi * 4.0
    np.testing.assert_allclose(poles, [1.0, 2 * ratio * w, w * w], rtol=1e-5)


def test_a_motor_as_a_servo_keeps_the_range_of_its_force():
    motor = '<motor joint="a" gear="2" ctrlrange="-3 4" forcerange="-9 3.5"/>'
    model = servoed(pendulum(motor), natural_frequency_hz=2.0)
    plant, forces = Plant(model, **WORLD), []
    for target in (-50.0, 50.0):
        plant.step(np.array([target]), 1e-3)
        forces.append(plant.coil_force_n()[0])
    assert forces == [-6.0, 7.0]


SHARED = """<mujoco><option timestep="2e-3" gravity="0 0 0"/><worldbody>{links}
  <site name="tool"/>{ends}</worldbody><actuator>{motors}</actuator></mujoco>"""
LINK = '<body pos="0 0 -0.2"><joint name="a{}" axis="0 1 0"/><geom size="0.03" pos="0 0 -0.2"/>'


def test_motors_that_share_inertia_come_to_rest_as_servos(tmp_path):
    """Six links in a row lose speed faster than each drive alone, more than a step may take."""
    links, motors = (
        "".join(each.format(k) for k in range(6)) for each in (LINK, '<motor joint="a{}"/>')
    )
    model, start = posed(SHARED.format(links=links, ends="</body>" * 6, motors=motors), tmp_path)
    servo = servoed(model, natural_frequency_hz=10.0, data=start)
    plant = Plant(servo, base=None, payload="tool", start=start)
    fastest = np.abs(np.linalg.eigvals(plant.linear().A)).max()
    assert fastest * 2e-3 > 2.0  # where explicit steps grow
    plant.step(np.full(6, 1e-3), 1.0)
    np.testing.assert_allclose(plant.displacements(), 1e-3, atol=1e-6)


def test_the_inertia_of_a_servo_in_a_loop_is_that_of_the_loop(tmp_path):
    """One motor on a four-bar: the only mode is at the stated frequency."""
    text = LOOP.replace("<option ", '<option gravity="0 0 0" ').replace(' damping="1"', "")
    stiff = '<joint joint1="elbow" polycoef="0.05 0 0 0 0"/></equality>'
    text = text[: text.index("</equality>")] + stiff
    text += '<actuator><motor joint="left"/></actuator></mujoco>'
    model, start = posed(text, tmp_path, left=0.1, elbow=0.05)
    servo = servoed(model, natural_frequency_hz=3.0, data=start)
    poles = np.poly(Plant(servo, base=None, payload="tool", start=start).linear().A)
    w = 2 * np.pi * 3.0
    np.testing.assert_allclose(poles, [1.0, 2 * w, w * w], rtol=1e-4)


REFUSED = [
    ('<motor name="m" joint="a"/>', "", '"m" is a torque motor, .*sim.servoed'),
    ('<velocity name="m" joint="a" kv="2"/>', "", '"m" is a velocity servo, whose control is a'),
    ('<muscle name="m" joint="a" lengthrange="-1 1"/>', "", '"m" is a muscle: only servos and'),
    ('<intvelocity name="m" joint="a" actrange="-1 1"/>', "", '"m" has a state of its own'),
    ('<position name="m" joint="a" kp="2" timeconst="1"/>', "", '"m" has a state of its own'),
    ('<damper name="m" joint="a" kv="2" ctrlrange="0 1"/>', "", '"m" is an actuator of variable'),
    ('<general name="m" joint="a" gainprm="0"/>', "", '"m" has gain 0, so nothing commands it'),
    ('<general name="m" joint="a" biastype="affine" biasprm="0 2"/>', "", '"m" pushes away from'),
    ('<position name="m" site="tool" gear="1 0 0 0 0 0"/>', "", '"m" feels a length that does not'),
    ('<motor name="m" joint="a"/>', 'stiffness="3 1"', 'the spring of joint "a" is not linear'),
]


@pytest.mark.parametrize(("actuator", "joint", "words"), REFUSED)
def test_what_no_displacement_commands_is_refused_with_the_reason(actuator, joint, words):
    with pytest.raises(ModelError, match=words) as refused:
        Plant(pendulum(actuator, joint=joint), **WORLD)
    assert "\n" not in str(refused.value) and len(str(refused.value)) < 200


def test_a_servo_that_its_time_step_cannot_follow_is_refused():
    with pytest.raises(ValueError, match=r"natural_frequency_hz must be at most 39\.8 with"):
        servoed(pendulum('<motor joint="a"/>'), natural_frequency_hz=50.0)
