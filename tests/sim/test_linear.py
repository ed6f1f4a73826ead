"""Linearization on the closed loops: what a textbook says of small motions."""

import mujoco
import numpy as np
import pytest

from sim import ModelError, jacobians, linearize

# A bob that may go anywhere in a plane, tied by a light rod to a pivot: a pendulum by its loop.
PENDULUM = """
<mujoco>
  <option jacobian="dense"><flag contact="disable"/></option>
  <worldbody>
    <site name="base"/>
    <body name="rod">
      <joint name="pivot" axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.5" size="0.005" mass="1e-9"/>
    </body>
    <body name="bob" pos="0 0 -0.5">
      <joint name="x" type="slide" axis="1 0 0"/>
      <joint name="z" type="slide" axis="0 0 1"/>
      <geom type="sphere" size="0.02" mass="2"/>
      <site name="payload"/>
    </body>
  </worldbody>
  <equality><connect name="tie" body1="rod" body2="bob" anchor="0 0 -0.5"/></equality>
</mujoco>
"""

# A sprung hinge; a pull along its arm stiffens it, a push along it softens it.
ARM = """
<mujoco>
  <option gravity="0 0 0"/>
  <worldbody>
    <site name="base"/>
    <body name="arm">
      <joint name="hinge" axis="0 1 0" stiffness="10"/>
      <geom type="capsule" fromto="0 0 0 0 0 0.5" size="0.01" mass="1"/>
      <site name="payload" pos="0 0 0.5"/>
    </body>
  </worldbody>
  <actuator>{actuator}</actuator>
</mujoco>
"""
MOTOR = '<motor name="motor" joint="hinge"/>'


def test_a_bob_on_a_tie_swings_with_the_frequency_of_its_length():
    """omega^2 = g / l: all stiffness is geometric, from the tie that turns under load."""
    model = mujoco.MjModel.from_xml_string(PENDULUM)
    linear = linearize(model, mujoco.MjData(model))
    assert linear.A.shape == (2, 2)
    # The rod's own mass and the finite differences leave 1e-6.
    assert -linear.A[1, 0] == pytest.approx(9.81 / 0.5, rel=1e-5)


def test_a_standing_push_along_an_arm_softens_it():
    """A load that follows no turn is a spring of its own: k - F l against k."""
    model = mujoco.MjModel.from_xml_string(ARM.format(actuator=MOTOR))
    data = mujoco.MjData(model)
    alone = linearize(model, data)
    # At the centre of mass, half way up.
    data.xfrc_applied[model.body("arm").id, 2] = -5.0
    pushed = linearize(model, data)
    assert pushed.A[1, 0] / alone.A[1, 0] == pytest.approx(1 - 5.0 * 0.25 / 10.0, rel=1e-6)


def test_an_actuator_with_a_state_of_its_own_is_refused():
    slow = '<general name="slow" joint="hinge" dyntype="filter" dynprm="0.1"/>'
    model = mujoco.MjModel.from_xml_string(ARM.format(actuator=slow))
    with pytest.raises(ModelError, match="an actuator has a state of its own"):
        linearize(model, mujoco.MjData(model))


@pytest.mark.parametrize("flag", ["equality", "constraint"])
def test_closures_that_a_flag_switches_off_are_refused(flag):
    """A closed mechanism must not pass for an open one."""
    text = PENDULUM.replace('contact="disable"', f'contact="disable" {flag}="disable"')
    text = text.replace("</mujoco>", '<actuator><motor joint="x"/></actuator></mujoco>')
    model = mujoco.MjModel.from_xml_string(text)
    with pytest.raises(ModelError, match="equalities are active, and the model's flags disable"):
        jacobians(model, mujoco.MjData(model), "payload")
    model.eq_active0[:] = False
    assert jacobians(model, mujoco.MjData(model), "payload").J_C.shape == (0, 3)


def test_a_closure_that_is_not_finite_is_refused():
    model = mujoco.MjModel.from_xml_string(PENDULUM)
    model.eq_data[0, :3] = np.nan
    with pytest.raises(ModelError, match="an equality of the model is not finite"):
        jacobians(model, mujoco.MjData(model), "payload")
