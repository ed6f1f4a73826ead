"""Dry friction beside the linear model: Coulomb's law, and MuJoCo's own motion step for step."""

from dataclasses import replace

import control
import mujoco
import numpy as np
import pytest

from ftc.fdi.fault_model import Fault, NominalModel, fault_model
from ftc.fdi.friction import DryFriction
from sim import Plant, load_model
from sim.plant.friction import dry_friction

ARM = """
<mujoco>
  <option timestep="0.001" integrator="{integrator}"/>
  <default><geom contype="0" conaffinity="0"/></default>
  <worldbody>
    <site name="base"/>
    <body name="upper">
      <joint name="shoulder" axis="0 1 0" damping="2" frictionloss="0.4" armature="0.1"/>
      <geom type="capsule" size="0.03" fromto="0 0 0 0.35 0 0" mass="1.2"/>
      <body name="lower" pos="0.35 0 0">
        <joint name="elbow" axis="0 1 0" damping="1" frictionloss="0.2" armature="0.05"/>
        <geom type="capsule" size="0.03" fromto="0 0 0 0 0 0.3" mass="0.8"/>
        <site name="payload" pos="0 0 0.3"/>
      </body>
    </body>
  </worldbody>
  <tendon>
    <fixed name="belt" frictionloss="0.1">
      <joint joint="shoulder" coef="1"/><joint joint="elbow" coef="-1"/>
    </fixed>
  </tendon>
  <actuator>
    <position name="shoulder" joint="shoulder" kp="500" kv="20"/>
    <position name="elbow" joint="elbow" kp="300" kv="10"/>
  </actuator>
</mujoco>
"""
PERIOD_S = 2e-3


def plant_of(folder, integrator: str = "implicitfast") -> Plant:
    """The arm at rest, its weight held."""
    file = folder / "arm.xml"
    file.write_text(ARM.format(integrator=integrator))
    model = load_model(file, add_locks=True)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return Plant(model, start=data)


def nominal_of(plant: Plant) -> NominalModel:
    """Its linear model to the displacements, with what rubs."""
    linear = plant.linear()
    assert linear.friction is not None
    return NominalModel(
        control.ss(linear.A, linear.B, linear.C_active, 0),
        linear.C_active,
        np.full(2, 1e-6),
        PERIOD_S,
        plant.model.opt.timestep,
        feedback=linear.feedback,
        holding=linear.holding,
        implicit_damping=plant.implicit_damping,
        friction=DryFriction(*linear.friction),
    )


def test_places_that_rub_are_those_of_the_file(tmp_path):
    """A force at a joint or tendon pushes by M^-1 times its row."""
    plant = plant_of(tmp_path)
    friction = plant.linear().friction
    assert friction is not None
    assert dry_friction(plant.model) == ("shoulder", "elbow", "belt")
    np.testing.assert_allclose(friction.limit, [0.4, 0.2, 0.1])
    np.testing.assert_allclose(np.abs(friction.rows), [[1, 0], [0, 1], [1, 1]], atol=1e-12)
    mass = np.zeros((2, 2))
    mujoco.mj_fullM(plant.model, plant.data, mass)
    np.testing.assert_allclose(mass @ friction.push, friction.rows.T, atol=1e-12)
    plant.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS)
    assert plant.linear().friction is None


@pytest.mark.parametrize("integrator", ["implicitfast", "Euler"])
@pytest.mark.parametrize("fault", [None, Fault(1, "locked"), Fault(1, "free")])
def test_the_model_moves_as_the_plant(tmp_path, integrator, fault):
    """Sticking, slipping and creeping alike, before and after a failure; the lock is a soft one."""
    plant = plant_of(tmp_path, integrator)
    nominal = nominal_of(plant)
    before, after = fault_model(nominal), fault_model(nominal, [fault] if fault else [])
    frictionless = fault_model(replace(nominal, friction=None))
    x, smooth, moved, expected, left_out = np.zeros(4), np.zeros(4), [], [], []
    for tick in range(300):
        if tick == 150 and fault is not None:
            x = after.onset @ x
            plant.lock(1) if fault.kind == "locked" else plant.release(1)
        command = 1e-3 * np.array([np.sin(0.03 * tick), 1 - np.cos(0.05 * tick)])
        plant.step(command, PERIOD_S)
        x = (before if tick < 150 else after).step(x, command)
        smooth = frictionless.step(smooth, command)
        moved.append(plant.displacements())
        expected.append(nominal.displacement @ x)
        left_out.append(nominal.displacement @ smooth)
    size = np.abs(moved).max()
    assert np.abs(np.subtract(moved, expected)).max() < 0.02 * size
    assert (
        np.abs(np.subtract(moved[:150], expected[:150])).max() < 3e-3 * size
    )  # Euler makes the dampers of joints alone implicit
    assert np.abs(np.subtract(moved[:150], left_out[:150])).max() > 0.1 * size
