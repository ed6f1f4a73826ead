"""The compiled code reads arrays of any layout as what they are."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from scipy.spatial.transform import Rotation

from fjh.rig.hexapod.closed_form import hexapod
from fjh.rig.hexapod.testbed import TestbedConfig
from sim import NOMINAL, Pose

R = Rotation.from_rotvec([[0.01, 0.02, -0.03], [0.0, 0.1, 0.0]]).as_matrix()


def columns(A):
    """The same numbers, column by column."""
    return np.asfortranarray(A)


def apart(A):
    """The same numbers, every other one of a larger array."""
    wide = np.full((*A.shape[:-1], 2 * A.shape[-1]), np.nan)
    wide[..., ::2] = A
    return wide[..., ::2]


@pytest.mark.parametrize("laid", [columns, apart])
def test_arrays_of_any_layout_are_the_same_numbers(laid, model):
    machine, bench, twist = hexapod(model), TestbedConfig(), np.linspace(1e-4, 2e-4, 12)
    twist = twist.reshape(2, 6)
    pose, other = Pose(R, twist[:, 3:]), Pose(laid(R), laid(twist[:, 3:]))
    assert_array_equal(pose.moved(twist).rotation, other.moved(laid(twist)).rotation)
    assert_array_equal(machine.inverse_jacobian(pose), machine.inverse_jacobian(other))
    here, there = (machine.moved(NOMINAL, step) for step in (twist[0], laid(twist[0])))
    assert_array_equal(here.rotation, there.rotation)
    assert_array_equal(here.twist(twist[1]), there.twist(laid(twist[1])))
    detector = bench.detector()
    one, two = (detector.read(axes, np.random.default_rng(1)) for axes in (R[0], laid(R[0])))
    assert_array_equal(one, two)


def test_one_pose_broadcasts_to_many_displacements():
    steps = np.linspace(0.0, 1e-3, 24).reshape(4, 6)
    moved = Pose(R[0], np.zeros(3)).moved(steps)
    each = [Pose(R[0], np.zeros(3)).moved(step).rotation for step in steps]
    assert_array_equal(moved.rotation, each)
    same = Pose(R[:1], np.zeros((1, 3))).moved(np.broadcast_to(steps[1], (3, 6)))
    assert_array_equal(same.rotation, [each[1]] * 3)
