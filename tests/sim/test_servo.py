"""Motors as position servos: forces as MuJoCo computes them, the integrator, and refusals."""

import mujoco
import numpy as np
import pytest

from sim import servoed

ARM = """
<mujoco>
  <option timestep="1e-3" integrator="{integrator}"/>
  <worldbody><body><joint name="a" axis="0 1 0"/><geom size="0.03" pos="0.3 0 0"/>
    <body pos="0.3 0 0"><joint name="b" axis="0 1 0"/><geom size="0.02" pos="0.2 0 0"/>
  </body></body></worldbody>
  <actuator>{actuators}</actuator>
</mujoco>"""
MOTORS = '<motor joint="a" gear="3"/><velocity joint="b" kv="7"/>'
SERVOS = '<position joint="a" kp="9"/><position joint="b" kp="5"/>'
RATIO, FREQUENCY_HZ = 0.6, 5.0


def arm(actuators: str = MOTORS, integrator: str = "Euler") -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(ARM.format(actuators=actuators, integrator=integrator))


def test_a_servo_pulls_in_proportion_to_its_error_and_brakes_its_speed():
    """Nothing else acts: with the command where it is, and at rest, it has no force at all."""
    model = servoed(arm(), natural_frequency_hz=FREQUENCY_HZ, damping_ratio=RATIO)
    data, rng = mujoco.MjData(model), np.random.default_rng(0)
    mujoco.mj_forward(model, data)
    M = np.zeros((2, 2))
    mujoco.mj_fullM(model, data, M)
    gear, omega = np.array([3.0, 1.0]), 2 * np.pi * FREQUENCY_HZ
    stiffness = np.diag(M) * omega**2 / gear**2
    damping = 2 * RATIO * np.diag(M) * omega / gear**2
    for _ in range(5):
        data.qpos, data.qvel, data.ctrl = rng.normal(size=(3, 2))
        mujoco.mj_forward(model, data)
        expected = stiffness * (data.ctrl - gear * data.qpos) - damping * gear * data.qvel
        np.testing.assert_allclose(data.actuator_force, expected, rtol=1e-9)
    data.qvel, data.ctrl = 0.0, gear * data.qpos
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.actuator_force, 0.0, atol=1e-9)


@pytest.mark.parametrize(
    ("actuators", "before", "after"),
    [
        (MOTORS, "Euler", "IMPLICITFAST"),
        (SERVOS, "Euler", "EULER"),
        (MOTORS, "RK4", "RK4"),
        (MOTORS, "implicit", "IMPLICIT"),
    ],
)
def test_only_a_motor_with_explicit_steps_gets_another_integrator(actuators, before, after):
    """A model that has its servos already stays as it is, all of it."""
    model = arm(actuators, before)
    servo = servoed(model, natural_frequency_hz=FREQUENCY_HZ)
    assert mujoco.mjtIntegrator(servo.opt.integrator).name == f"mjINT_{after}"
    if actuators == SERVOS:
        np.testing.assert_array_equal(servo.actuator_gainprm, model.actuator_gainprm)
        np.testing.assert_array_equal(servo.actuator_biasprm, model.actuator_biasprm)


def test_the_range_of_a_control_becomes_one_of_the_force_and_binds_no_displacement():
    """A motor's was one of its force, a velocity servo's one of its speed, which is gone."""
    motor = '<motor joint="a" gear="3" ctrlrange="-2 4"/>'
    model = servoed(
        arm(motor + '<velocity joint="b" kv="7" ctrlrange="-1 1"/>'), natural_frequency_hz=2.0
    )
    assert not model.actuator_ctrllimited.any()
    assert model.actuator_forcelimited.tolist() == [True, False]
    np.testing.assert_array_equal(model.actuator_forcerange[0], [-2.0, 4.0])


def test_a_state_of_another_model_is_refused():
    other = mujoco.MjData(mujoco.MjModel.from_xml_string("<mujoco/>"))
    with pytest.raises(ValueError, match=r"^data must be of this model"):
        servoed(arm(), natural_frequency_hz=2.0, data=other)
