"""Poses in all forms of input."""

import mujoco
import numpy as np
import pytest
from hypothesis import given
from numpy.testing import assert_array_equal
from scipy.spatial.transform import RigidTransform, Rotation

from fjh.rig.hexapod.closed_form import hexapod
from sim import MODELS, NOMINAL, CenterOfMass, Pose, load_model, pose_error
from sim.kinematics.pose import target_pose
from sim.mjcf.frame import rotation_vector
from tests.random_systems import SEEDS


def some(seed: int, *lead: int) -> Pose:
    """Create rotations by any angle about any axis, and translations, with scipy."""
    rng = np.random.default_rng(seed)
    turned = Rotation.from_quat(rng.normal(size=(int(np.prod(lead)), 4))).as_matrix()
    return Pose(turned.reshape(*lead, 3, 3), rng.normal(size=(*lead, 3)))


def close(a: Pose, b: Pose, atol: float = 1e-12) -> None:
    np.testing.assert_allclose(a.rotation, b.rotation, atol=atol)
    np.testing.assert_allclose(a.translation_m, b.translation_m, atol=atol)


@pytest.mark.parametrize("lead", [(), (4,), (2, 3), (0,)])
def test_every_form_of_a_pose_is_converted_back(lead):
    pose = some(0, *lead)
    T = pose.matrix()
    assert T.shape == (*lead, 4, 4)
    close(Pose.from_matrix(T), pose, atol=0.0)
    close(Pose.from_matrix(pose.transform().as_matrix()), pose)


@given(SEEDS)
def test_a_quaternion_and_its_negative_of_any_length_are_one_rotation(seed):
    """The reference is MuJoCo's conversion."""
    rng, by_mujoco = np.random.default_rng(seed), np.empty(9)
    q = rng.normal(size=4)
    mujoco.mju_quat2Mat(by_mujoco, q / np.linalg.norm(q))
    for length in (1.0, -1.0, 1e-200, -1e100):
        pose = target_pose("target", (np.zeros(3), length * q))
        assert isinstance(pose, Pose)
        np.testing.assert_allclose(pose.rotation, by_mujoco.reshape(3, 3), atol=1e-14)


@pytest.mark.parametrize("axis", [[1.0, 0, 0], [0, 0, 1], [0.6, 0, 0.8], [0, -0.6, 0.8]], ids=str)
def test_a_half_turn_has_one_rotation_vector(axis):
    """Rotations by pi about opposite axes are equal; a component that rounds to 0 has no sign."""
    half = 2 * np.outer(axis, axis) - np.eye(3)
    first = np.array(axis) * np.sign(axis[np.flatnonzero(axis)[0]])
    for seed in range(12):
        vector = rotation_vector(half + 1e-16 * np.random.default_rng(seed).normal(size=(3, 3)))
        np.testing.assert_allclose(vector, np.pi * first, atol=1e-7)


def test_batches_are_broadcast():
    pose = Pose(some(0, 2, 1).rotation, some(1, 3).translation_m)
    for k, j in np.ndindex(2, 3):
        alone = Pose(pose.rotation[k, 0], pose.translation_m[j])
        assert_array_equal(pose.matrix()[k, j], alone.matrix())
    steps = np.random.default_rng(0).normal(size=(4, 6))
    one, many = some(2), some(3, 4)
    for k in range(4):
        assert_array_equal(one.moved(steps).rotation[k], one.moved(steps[k]).rotation)
        alone = Pose(many.rotation[k], many.translation_m[k]).moved(steps[0])
        close(Pose(many.moved(steps[0]).rotation[k], many.moved(steps[0]).translation_m[k]), alone)


@pytest.mark.parametrize("laid", [np.asfortranarray, lambda A: np.repeat(A, 2, axis=-1)[..., ::2]])
def test_arrays_of_any_layout_are_the_same_numbers(laid, model):
    """Compiled code reads contiguous arrays."""
    machine, twist = hexapod(model), np.linspace(1e-4, 2e-4, 12).reshape(2, 6)
    R = Rotation.from_rotvec([[0.01, 0.02, -0.03], [0.0, 0.1, 0.0]]).as_matrix()
    pose, other = Pose(R, twist[:, 3:]), Pose(laid(R), laid(twist[:, 3:]))
    assert_array_equal(pose.moved(twist).rotation, other.moved(laid(twist)).rotation)
    assert_array_equal(machine.inverse_jacobian(pose), machine.inverse_jacobian(other))
    here, there = (machine.moved(NOMINAL, step) for step in (twist[0], laid(twist[0])))
    assert_array_equal(here.rotation, there.rotation)
    assert_array_equal(here.twist(twist[1]), there.twist(laid(twist[1])))


def test_a_target_is_the_same_in_every_form():
    model = load_model(MODELS / "arm.xml")
    data = mujoco.MjData(model)
    pose = some(3)
    displacement = pose_error(model, data, "payload", pose, "base")
    forms = [pose.matrix(), pose.matrix().tolist(), pose.transform()]
    for sign in (1.0, -3.0):
        quat_wxyz = sign * pose.transform().rotation.as_quat(scalar_first=True)
        forms += [(pose.translation_m, quat_wxyz), [[*pose.translation_m], [*quat_wxyz]]]
    for form in forms:
        np.testing.assert_allclose(
            pose_error(model, data, "payload", form, "base"), displacement, atol=1e-12
        )
    several = pose_error(model, data, ["payload", CenterOfMass()], [pose.transform(), np.ones(3)])
    np.testing.assert_allclose(several[:6], pose_error(model, data, "payload", pose), atol=1e-12)


@pytest.mark.parametrize(
    ("target", "pattern"),
    [
        (np.diag([1.0, 1, -1, 1]), "target must be a rotation matrix"),
        (np.eye(4)[::-1], "target must have the last row 0 0 0 1"),
        (np.eye(3), r"got shape \(3, 3\): a rotation R alone is Pose\(R, position\)"),
        (RigidTransform.from_matrix(np.stack([np.eye(4)] * 2)), r"got shape \(2, 4, 4\)"),
        ((np.zeros(3), np.zeros(4)), "the quaternion of target must not be zero"),
    ],
)
def test_an_invalid_target_is_rejected(target, pattern):
    model = load_model(MODELS / "arm.xml")
    data = mujoco.MjData(model)
    with pytest.raises(ValueError, match=pattern):
        pose_error(model, data, "payload", target)
