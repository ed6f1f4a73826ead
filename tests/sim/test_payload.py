"""Motion of the payload is measured from its nominal pose, however sites are turned."""

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sim import HEXAPOD_MJCF, Body, Plant, jacobians, load_model

PERIOD_S = 1e-3
COMMAND = np.array([0.3, -0.4, 0.5])
ARM = """
<mujoco>
  <option timestep="5e-4" integrator="implicitfast" gravity="0 0 0"/>
  <default>
    <joint armature="0.1"/>
    <geom type="capsule" size="0.02" fromto="0 0 0 0.3 0 0" contype="0" conaffinity="0"/>
    <position kp="300" kv="15"/>
  </default>
  <worldbody>
    <site name="base" quat="{base}"/>
    <body><joint name="yaw" axis="0 0 1"/><geom/>
      <site name="first" quat="{base}"/>
      <body pos="0.3 0 0"><joint name="pitch" axis="0 1 0"/><geom/>
        <body name="hand" pos="0.3 0 0"><joint name="roll" axis="1 0 0"/><geom/>
          <site name="payload" pos="0.1 0.05 0" quat="{payload}"/>
        </body>
      </body>
    </body>
  </worldbody>
  <equality>
    <joint name="lock1" joint1="yaw" active="false"/>
    <joint name="lock2" joint1="pitch" active="false"/>
    <joint name="lock3" joint1="roll" active="false"/>
  </equality>
  <actuator><position joint="yaw"/><position joint="pitch"/><position joint="roll"/></actuator>
</mujoco>
"""
UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])


def quaternion(rng: np.random.Generator) -> np.ndarray:
    """A random orientation, [w, x, y, z]."""
    q = rng.normal(size=4)
    return q / np.linalg.norm(q)


def arm(base: np.ndarray = UPRIGHT, payload: np.ndarray = UPRIGHT) -> mujoco.MjModel:
    """The arm with its sites turned."""
    text = {"base": base, "payload": payload}
    text = {name: " ".join(map(repr, map(float, q))) for name, q in text.items()}
    return mujoco.MjModel.from_xml_string(ARM.format(**text))


def moved(plant: Plant, command: np.ndarray = COMMAND) -> np.ndarray:
    """Displacement of the payload under way to the command."""
    plant.step(command, 0.2)
    return plant.displacement()


def world_displacement(plant: Plant) -> np.ndarray:
    """The same from the body's own frame, which is the world's at the nominal pose."""
    nominal = mujoco.MjData(plant.model)
    mujoco.mj_forward(plant.model, nominal)
    np.testing.assert_allclose(nominal.body("hand").xmat, np.eye(3).ravel(), atol=1e-15)
    turned = Rotation.from_matrix(plant.data.body("hand").xmat.reshape(3, 3)).as_rotvec()
    shift = plant.data.site("payload").xpos - nominal.site("payload").xpos
    return np.concatenate([turned, shift])


def in_axes(plant: Plant, site: str, twist: np.ndarray) -> np.ndarray:
    axes = plant.data.site(site).xmat.reshape(3, 3)
    return (twist.reshape(2, 3) @ axes).ravel()


@pytest.mark.parametrize("seed", range(5))
def test_a_payload_at_its_nominal_pose_has_no_displacement_however_it_is_turned(seed):
    rng = np.random.default_rng(seed)
    plant = Plant(arm(base=quaternion(rng), payload=quaternion(rng)))
    np.testing.assert_allclose(plant.displacement(), 0.0, atol=2e-15)
    np.testing.assert_allclose(plant.pose().rotation, np.eye(3), atol=2e-15)
    # It can fail: the rotation was that of the payload's axes in those of the base.
    base, payload = (plant.data.site(name).xmat.reshape(3, 3) for name in ("base", "payload"))
    assert Rotation.from_matrix(base.T @ payload).magnitude() > 0.1


@pytest.mark.parametrize("seed", range(5))
def test_the_displacement_is_that_of_the_body_in_base_axes(seed):
    rng = np.random.default_rng(seed)
    plant = Plant(arm(base=quaternion(rng), payload=quaternion(rng)))
    found, expected = moved(plant), world_displacement(plant)
    np.testing.assert_allclose(found, in_axes(plant, "base", expected), atol=1e-12)
    assert np.linalg.norm(found[:3]) > 0.1
    assert np.linalg.norm(found[3:]) > 0.01


def test_without_a_base_the_axes_are_those_of_the_world():
    rng = np.random.default_rng(1)
    plant = Plant(arm(base=quaternion(rng), payload=quaternion(rng)), base=None)
    np.testing.assert_allclose(moved(plant), world_displacement(plant), atol=1e-12)
    plant.shake(np.array([1.0, 2.0, 3.0]))
    np.testing.assert_array_equal(plant.model.opt.gravity, [-1.0, -2.0, -3.0])


def test_a_base_that_moves_gives_its_present_axes():
    rng = np.random.default_rng(2)
    plant = Plant(arm(base=quaternion(rng), payload=quaternion(rng)), base="first")
    found, expected = moved(plant), world_displacement(plant)
    np.testing.assert_allclose(found, in_axes(plant, "first", expected), atol=1e-12)
    first = plant.data.site("first").xmat
    assert np.abs(first - plant.data.site("base").xmat).max() > 0.1


@pytest.mark.parametrize("base", ["base", None])
def test_a_small_displacement_is_the_jacobian_times_the_joints(base):
    rng = np.random.default_rng(3)
    model = arm(base=quaternion(rng), payload=quaternion(rng))
    plant = Plant(model, base=base)
    found = moved(plant, 1e-5 * COMMAND)
    jac = jacobians(model, mujoco.MjData(model), "payload", axes=base)
    expected = jac.J_T[:, jac.active] @ plant.displacements()
    np.testing.assert_allclose(found, expected, atol=1e-3 * np.abs(expected).max())


def test_a_push_acts_at_the_payload_along_base_axes():
    """Virtual work: the joints at rest feel J^T times the wrench."""
    rng = np.random.default_rng(4)
    model, wrench = arm(base=quaternion(rng), payload=quaternion(rng)), rng.normal(size=6)
    for base in ("base", None):
        plant = Plant(model, base=base)
        plant.push(wrench)
        mujoco.mj_forward(plant.model, plant.data)
        jac = jacobians(model, mujoco.MjData(model), "payload", axes=base)
        np.testing.assert_allclose(plant.data.qfrc_smooth, jac.J_T.T @ wrench, atol=1e-12)


def test_the_payload_of_the_hexapod_stands_along_its_base_to_the_bit(model):
    """So its pose is that of the payload's axes in the base's, with no product in between."""
    plant = Plant(model)
    for tick in range(20):
        base, payload = (plant.data.site(name).xmat.reshape(3, 3) for name in ("base", "payload"))
        np.testing.assert_array_equal(plant.pose().rotation, base.T.dot(payload))
        plant.step(2e-5 * np.sin(tick + np.arange(6)), PERIOD_S)
    assert np.abs(plant.displacement()).min() > 0.0


@pytest.mark.parametrize("name", ["fjh", "arm", "arms", "hand", "platform"])
def test_turning_the_payload_site_of_a_mechanism_changes_no_displacement(name):
    """Of models/ as they are, and with the site turned by 20 degrees."""
    model = load_model(HEXAPOD_MJCF.with_name(f"{name}.xml"))
    plants = [Plant(model)]
    site = model.site("payload")
    site.quat, site.sameframe = _turned(site.quat), mujoco.mjtSameFrame.mjSAMEFRAME_NONE
    plants.append(Plant(model))
    for plant in plants:
        np.testing.assert_allclose(plant.displacement(), 0.0, atol=1e-15)
        plant.step(1e-4 * np.cos(np.arange(model.nu)), 0.05)
    straight, turned = (plant.displacement() for plant in plants)
    np.testing.assert_allclose(turned, straight, atol=1e-13)
    assert np.abs(straight).max() > 1e-6


def _turned(quat_wxyz: np.ndarray) -> np.ndarray:
    turn, result = np.array([np.cos(np.pi / 18), 0.0, np.sin(np.pi / 18), 0.0]), np.empty(4)
    mujoco.mju_mulQuat(result, quat_wxyz, turn)
    return result


def test_a_body_is_a_payload_as_a_site_at_its_origin_is(model):
    """The hexapod's payload site lies at its body's origin, turned by half a turn."""
    plants = Plant(model, payload=Body("payload")), Plant(model)
    for plant in plants:
        plant.step(np.array([1e-5, 0, -1e-5, 0, 2e-5, 0]), 0.05)
    moved, expected = (plant.displacement() for plant in plants)
    assert np.abs(expected).min() > 1e-9
    np.testing.assert_allclose(moved, expected, atol=1e-15)
