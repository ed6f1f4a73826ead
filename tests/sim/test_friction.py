"""What a plant says of its dry friction."""

import mujoco
import numpy as np

from sim import Plant, load_model
from sim.plant import dry_friction

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


def plant_of(folder, integrator: str = "implicitfast") -> Plant:
    """The arm at rest, its weight held."""
    file = folder / "arm.xml"
    file.write_text(ARM.format(integrator=integrator))
    model = load_model(file, add_locks=True)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return Plant(model, start=data)


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
