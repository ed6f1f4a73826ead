"""Motors as position servos: forces, poles, integrators, rejected arguments."""

import mujoco
import numpy as np
import pytest

from sim import ModelError, Plant, servoed
from sim.mjcf import mass_matrix
from sim.scene import robot_scene
from tests.models import saved
from tests.sim.machines import WORLD, pendulum, started_model

MOTORS = '<motor joint="a" gear="3"/><velocity joint="b" kv="7"/>'
RATIO, FREQUENCY_HZ = 0.6, 5.0


def arm(actuators: str = MOTORS, integrator: str = "Euler") -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(f"""<mujoco>
      <option timestep="1e-3" integrator="{integrator}"/><worldbody>
      <body><joint name="a" axis="0 1 0"/><geom size="0.03" pos="0.3 0 0"/>
        <body pos="0.3 0 0"><joint name="b" axis="0 1 0"/><geom size="0.02" pos="0.2 0 0"/></body>
      </body></worldbody><actuator>{actuators}</actuator></mujoco>""")


def test_a_servo_pulls_in_proportion_to_its_error_and_brakes_its_speed():
    model = servoed(arm(), natural_frequency_hz=FREQUENCY_HZ, damping_ratio=RATIO)
    data, rng = mujoco.MjData(model), np.random.default_rng(0)
    M = mass_matrix(model, data)
    gear, omega = np.array([3.0, 1.0]), 2 * np.pi * FREQUENCY_HZ
    stiffness = np.diag(M) * omega**2 / gear**2
    damping = 2 * RATIO * np.diag(M) * omega / gear**2
    for _ in range(5):
        data.qpos, data.qvel, data.ctrl = rng.normal(size=(3, 2))
        mujoco.mj_forward(model, data)
        expected = stiffness * (data.ctrl - gear * data.qpos) - damping * gear * data.qvel
        np.testing.assert_allclose(data.actuator_force, expected, rtol=1e-9)


@pytest.mark.parametrize(
    ("before", "after"), [("Euler", "IMPLICITFAST"), ("RK4", "RK4"), ("implicit", "IMPLICIT")]
)
def test_only_a_motor_with_explicit_steps_gets_another_integrator(before, after):
    """A model that has only servos is unchanged."""
    servo = servoed(arm(MOTORS, before), natural_frequency_hz=FREQUENCY_HZ)
    assert mujoco.mjtIntegrator(servo.opt.integrator).name == f"mjINT_{after}"
    model = arm('<position joint="a" kp="9"/><position joint="b" kp="5"/>')
    servo = servoed(model, natural_frequency_hz=FREQUENCY_HZ)
    assert servo.opt.integrator == model.opt.integrator
    np.testing.assert_array_equal(servo.actuator_gainprm, model.actuator_gainprm)
    np.testing.assert_array_equal(servo.actuator_biasprm, model.actuator_biasprm)


@pytest.mark.parametrize("ratio", [0.3, 1.0])
@pytest.mark.parametrize(
    "motors", ['<motor joint="a" gear="20"/>', '<motor joint="a"/><motor joint="a" gear="-3"/>']
)
def test_a_motor_as_a_servo_has_the_stated_poles(ratio, motors):
    """The poles are the roots of s^2 + 2 d w s + w^2."""
    model = servoed(pendulum(motors), natural_frequency_hz=4.0, damping_ratio=ratio)
    poles = np.poly(Plant(model, **WORLD).linear().A)
    w = 2 * np.pi * 4.0
    np.testing.assert_allclose(poles, [1.0, 2 * ratio * w, w * w], rtol=1e-5)


def test_a_motor_as_a_servo_keeps_the_range_of_its_force():
    motor = '<motor joint="a" gear="2" ctrlrange="-3 4" forcerange="-9 3.5"/>'
    plant, forces = Plant(servoed(pendulum(motor), natural_frequency_hz=2.0), **WORLD), []
    for target in (-50.0, 50.0):
        plant.step(np.array([target]), 1e-3)
        forces.append(plant.coil_force_n()[0])
    assert forces == [-6.0, 7.0]


def test_motors_that_share_inertia_come_to_rest_as_servos():
    """Six links in series lose speed too fast for an explicit step of each drive."""
    numbers = range(6)
    link = '<body pos="0 0 -.2"><joint name="a{}" axis="0 1 0"/><geom size=".03" pos="0 0 -.2"/>'
    links = "".join(map(link.format, numbers))
    motors = "".join(f'<motor joint="a{k}"/>' for k in numbers)
    locks = "".join(f'<joint name="lock{k + 1}" joint1="a{k}" active="false"/>' for k in numbers)
    model = mujoco.MjModel.from_xml_string(f"""<mujoco><option timestep="2e-3" gravity="0 0 0"/>
      <worldbody>{links}<site name="tool"/>{"</body>" * 6}</worldbody>
      <equality>{locks}</equality><actuator>{motors}</actuator></mujoco>""")
    plant = Plant(servoed(model, natural_frequency_hz=10.0), **WORLD)
    assert np.abs(np.linalg.eigvals(plant.linear().A)).max() * 2e-3 > 2.0  # explicit steps grow
    plant.step(np.full(6, 1e-3), 1.0)
    np.testing.assert_allclose(plant.displacements(), 1e-3, atol=1e-6)


def test_the_inertia_of_a_servo_in_a_loop_is_that_of_the_loop():
    """The only mode of a four-bar with one motor has the stated frequency."""
    stiff = '<joint joint1="elbow" polycoef="0.05 0 0 0 0"/></equality>'
    servos = """<position joint="left" gear="3" kp="400" kv="8"/>
    <position joint="right" kp="3e3" kv="60"/>
    <position joint="elbow" kp="3e3" kv="60"/>"""
    model, start = started_model(
        "squeezed_loop",
        ("<option ", '<option gravity="0 0 0" '),
        (' damping="1"', ""),
        ("</equality>", stiff),
        (servos, '<motor joint="left"/>'),
    )
    servo = servoed(model, natural_frequency_hz=3.0, data=start)
    poles = np.poly(Plant(servo, **WORLD, start=start).linear().A)
    w = 2 * np.pi * 3.0
    np.testing.assert_allclose(poles, [1.0, 2 * w, w * w], rtol=1e-4)


def test_a_velocity_servo_of_a_scene_becomes_a_position_servo(tmp_path):
    """The range of the velocity servo was one of speed, and does not limit the force."""
    servo = '<velocity name="m2" joint="elbow" kv="5" ctrlrange="-1 1"/>'
    position = '<position name="m2" joint="elbow" kp="200" kv="20"/>'
    file = saved(tmp_path, "desk", (position, servo))
    with pytest.raises(ModelError, match=r"velocity servo.*--servo"):
        robot_scene(file, "tip", None, mujoco.MjData)
    scene = robot_scene(file, "tip", None, mujoco.MjData, servo_hz=5.0)
    plant = Plant(scene.model, base=None, payload="tip", start=scene.start, part=scene.part)
    plant.step(np.array([0.0, 0.02]), 1.0)
    np.testing.assert_allclose(plant.displacements(), [0.0, 0.02], atol=1e-3)
    assert not plant.model.actuator("m2").forcelimited


def test_a_servo_too_fast_for_the_time_step_is_rejected():
    with pytest.raises(ValueError, match=r"natural_frequency_hz must be at most 39\.8 with"):
        servoed(pendulum('<motor joint="a"/>'), natural_frequency_hz=50.0)
