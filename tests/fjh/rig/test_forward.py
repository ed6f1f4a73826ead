"""Forward kinematics of the hexapod: from strut lengths to the pose."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fjh.rig.hexapod.closed_form import Hexapod, hexapod
from fjh.rig.hexapod.forward import UnreachableLengths, forward_kinematics
from sim import NOMINAL, Plant, Pose, load_model
from tests.random_systems import SEEDS


@cache
def machine() -> Hexapod:
    return hexapod(load_model())


@given(
    SEEDS,
    st.sampled_from([(0.0, 0.03), (0.05, 2e-3)]),
    st.sampled_from([(), (1,), (5,), (2, 3), (0,)]),
)
def test_the_pose_gives_back_the_lengths_it_was_found_from(seed, spreads_m, shape):
    """Seven per cent of the strut length away, fifty times the paper's stroke; or other nodes."""
    rng, (moved_m, asked_m) = np.random.default_rng(seed), spreads_m
    bottom_m, top_m = rng.uniform(-moved_m, moved_m, (2, 6, 3))
    other = Hexapod(bottom_m=machine().bottom_m + bottom_m, top_m=machine().top_m + top_m)
    asked = rng.uniform(-asked_m, asked_m, (*shape, 6))
    pose = forward_kinematics(other, asked)
    np.testing.assert_allclose(other.displacements(pose), asked, atol=1e-14)
    assert pose.translation_m.shape == (*shape, 3)
    orthonormal = pose.rotation @ pose.rotation.swapaxes(-1, -2)
    np.testing.assert_allclose(orthonormal, np.broadcast_to(np.eye(3), (*shape, 3, 3)), atol=1e-14)


@given(SEEDS)
def test_the_lengths_of_a_pose_give_back_the_pose(seed):
    """As far as the assembled machine moves there is one pose to a set of lengths."""
    rng = np.random.default_rng(seed)
    twist = rng.uniform(-1, 1, (4, 6)) * [0.05, 0.05, 0.05, 0.02, 0.02, 0.02]
    there = NOMINAL.moved(twist)
    pose = forward_kinematics(machine(), machine().displacements(there))
    np.testing.assert_allclose(pose.rotation, there.rotation, atol=1e-13)
    np.testing.assert_allclose(pose.translation_m, there.translation_m, atol=1e-13)


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e3])
@pytest.mark.parametrize("away", [0.0, 100.0])
def test_any_unit_of_length_and_any_origin_will_do(scale, away):
    """Round-off is measured against the nodes' distances, which lengths are differences of."""
    shift = np.array([0, 0, away])
    other = Hexapod(
        bottom_m=scale * (machine().bottom_m + shift), top_m=scale * (machine().top_m + shift)
    )
    asked = scale * np.random.default_rng(3).uniform(-6e-4, 6e-4, (50, 6))
    off = np.abs(other.displacements(forward_kinematics(other, asked)) - asked).max()
    assert off <= 16 * np.finfo(float).eps * scale * (2 + away)


def test_the_pose_is_where_the_physics_takes_the_payload(model):
    """MuJoCo closes the loops by its own constraints; its payload is where the lengths say."""
    plant = Plant(model)
    plant.step(np.array([2e-4, -1e-4, 3e-4, 0.0, -2e-4, 1e-4]), 0.3)
    pose, truth = forward_kinematics(machine(), plant.displacements()), plant.pose()
    np.testing.assert_allclose(pose.translation_m, truth.translation_m, atol=1e-8)
    np.testing.assert_allclose(pose.rotation, truth.rotation, atol=3e-8)
    assert np.abs(truth.translation_m).max() > 1e-5


@pytest.mark.parametrize(
    "asked",
    [
        [2.0, 0, 0, 0, 0, 0],  # longer than the other struts let the platform reach
        [-0.41] * 6,  # shorter than nothing
        [-0.38, 0.5, -0.38, 0.5, -0.38, 0.5],
    ],
)
def test_lengths_that_no_pose_reaches_are_refused_and_the_others_are_found(asked):
    """Triangle inequality: a strut joins its two nodes, whatever the pose."""
    many = np.zeros((4, 6))
    many[2] = asked
    with pytest.raises(UnreachableLengths, match=r"displacements_m: .*1 of 4 sets of") as refusal:
        forward_kinematics(machine(), many)
    np.testing.assert_array_equal(refusal.value.reached, [True, True, False, True])
    assert refusal.value.residual_m[2] > 0.1
    # Leaving it out is all there is to do.
    forward_kinematics(machine(), many[refusal.value.reached])


def test_a_singular_start_ends_nothing():
    """A strut of no length; all six struts in one plane, where the Jacobian has no inverse."""
    on_its_node = machine().bottom_m[0] - machine().top_m[0]
    both = Pose(np.stack([np.eye(3)] * 2), np.stack([on_its_node, np.zeros(3)]))
    with pytest.raises(UnreachableLengths) as refusal:
        forward_kinematics(machine(), np.zeros(6), start=both)
    np.testing.assert_array_equal(refusal.value.reached, [False, True])
    flat = Pose(np.eye(3), np.array([0.0, 0.0, on_its_node[2]]))
    assert np.linalg.cond(machine().inverse_jacobian(flat)) > 1e10
    with pytest.raises(UnreachableLengths):
        forward_kinematics(machine(), np.zeros(6), start=flat)


@pytest.mark.parametrize("turn", np.linspace(0.0, 2.0, 9))
def test_a_payload_turned_by_a_right_angle_is_held_by_no_struts(turn):
    """Fichter, "A Stewart platform-based manipulator" (1986): elimination leaves round-off."""
    angle = turn + np.radians([10, 110, 130, 230, 250, 350])
    bottom_m = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    top_m = 0.5 * bottom_m @ np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]]) + np.eye(3)[2]
    with pytest.raises(ValueError, match="singular"):
        Hexapod(bottom_m, top_m).moved(NOMINAL, 1e-6 * np.arange(6.0))
