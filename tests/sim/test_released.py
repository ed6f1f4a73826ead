"""A servo that loses its force: what the linear model of the sound machine says of it."""

import mujoco
import numpy as np
import pytest
import scipy.linalg

from sim import HEXAPOD_MJCF, Plant, assemble, load_model

MECHANISMS = ["arm", "platform", "hand", "arms"]

# A double pendulum that servos hold against gravity: one at a joint, one that pulls on a cable.
LIFTED = """
<mujoco>
  <option timestep="{timestep}" integrator="{integrator}">
    <flag contact="disable" eulerdamp="{eulerdamp}"/></option>
  <worldbody>
    <site name="anchor" pos="-0.3 0 0.5"/>
    <body name="upper" pos="0 0 0.2">
      <joint name="shoulder" axis="0 1 0" damping="{damping}"/>
      <geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.03" mass="2"/>
      <site name="grip" pos="0.2 0 0.05"/>
      <body name="lower" pos="0.4 0 0">
        <joint name="elbow" axis="0 1 0" damping="{damping}"/>
        <geom type="capsule" fromto="0 0 0 0.3 0 0.1" size="0.03" mass="1"/>
        <site name="payload" pos="0.3 0 0.1"/>
      </body>
    </body>
  </worldbody>
  <tendon><spatial name="cable"><site site="anchor"/><site site="grip"/></spatial></tendon>
  <equality><joint name="lock1" joint1="elbow" active="false"/></equality>
  <actuator>
    <position name="elbow" joint="elbow" gear="3" kp="20" kv="{kv}"/>
    <position name="hoist" tendon="cable" gear="-2" kp="4000" kv="{kv}"/>
  </actuator>
</mujoco>
"""


def servos(name: str) -> Plant:
    model = load_model(HEXAPOD_MJCF.with_name(f"{name}.xml"))
    return Plant(model, start=assemble(model))


def lifted(
    integrator: str = "Euler", eulerdamp: str = "disable", damping=0.2, kv=1.0, timestep=1e-4
) -> Plant:
    text = LIFTED.format(
        integrator=integrator, eulerdamp=eulerdamp, damping=damping, kv=kv, timestep=timestep
    )
    model = mujoco.MjModel.from_xml_string(text)
    return Plant(model, base=None, start=assemble(model))


def without(plant: Plant, k: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A, B and the constant acceleration (2k,) that the sound model foretells without drive k."""
    linear = plant.linear()
    assert linear.feedback is not None and linear.holding is not None
    B, column = linear.B.copy(), linear.B[:, k]
    B[:, k] = 0.0
    return linear.A + np.outer(column, linear.feedback[k]), B, -column * linear.holding[k]


@pytest.mark.parametrize("name", MECHANISMS)
def test_a_released_servo_leaves_the_linear_model_without_its_feedback(name):
    """The same as the model of the machine in which it is really switched off."""
    plant = servos(name)
    for k in range(len(plant.drives)):
        A, B, push = without(plant, k)
        broken = servos(name)
        broken.release(k)
        real = broken.linear()
        scale = np.abs(plant.linear().A).max()
        np.testing.assert_allclose(A, real.A, atol=1e-6 * scale)
        np.testing.assert_allclose(B, real.B, atol=1e-6 * np.abs(B).max())
        np.testing.assert_allclose(push, 0.0, atol=1e-6)  # no gravity: nothing was held


def test_a_coil_against_a_spring_feeds_nothing_back_and_holds_nothing():
    linear = Plant(load_model()).linear()
    assert linear.feedback is not None and not linear.feedback.any()
    assert linear.holding is not None and not linear.holding.any()


@pytest.mark.parametrize("k", [0, 1])
def test_without_a_servo_a_machine_falls_as_its_linear_model_says(k):
    """From rest under gravity, within 1 % of the way for 30 ms."""
    plant = lifted()
    A, _, push = without(plant, k)
    plant_C = plant.linear().C_active
    plant.release(k)
    duration_s = 0.03
    plant.step(np.zeros(2), duration_s)
    both = np.zeros((len(A) + 1,) * 2)
    both[:-1, :-1], both[:-1, -1] = A, push
    expected = plant_C @ scipy.linalg.expm(both * duration_s)[:-1, -1]
    moved = plant.displacements()
    assert np.abs(moved).max() > 1e-3
    np.testing.assert_allclose(moved, expected, atol=0.01 * np.abs(moved).max())
