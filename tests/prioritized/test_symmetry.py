"""Test symmetric mechanisms: choices among equals do not depend on the last bits.

The last bits, which depend on the processor, are perturbed; the first of equals must be chosen.
"""

from itertools import product

import numpy as np
import pytest

from prioritized import (
    ConstrainedSystem,
    Kinematics,
    Status,
    Task,
    failure_atlas,
    lexicographic_least_squares,
    velocity_mapping,
)
from prioritized._mechanism.names import Names
from tests.random_systems import bits

PROCESSORS = range(12)


def legs(seed: int) -> np.ndarray:
    """Return the heave of three equal legs, and a rotation."""
    return bits(np.random.default_rng(seed), np.array([[1.0, 1.0, 1.0], [2.0, -1.0, -1.0]]) / 3)


def kinematics(seed: int, J: np.ndarray) -> Kinematics:
    J = bits(np.random.default_rng(seed), J)
    return ConstrainedSystem(J, None, range(J.shape[1])).kinematics()


@pytest.mark.parametrize("when", ["least_squares", "scaled"])
@pytest.mark.parametrize("requested", [1.0, 1.5])
def test_all_equal_legs_at_their_limits_are_reported(when, requested):
    """Check requests at or beyond the limit; which bound the solver counts is round-off."""
    for seed in PROCESSORS:
        how = {"rate_limits": (-1, 1), "when_limited": when}
        mapping = velocity_mapping(legs(seed), [0], joint_weight=np.ones(3), **how)
        result = mapping.solve([requested])
        np.testing.assert_array_equal(result.active_limits, [1, 1, 1])
        assert not result.gains.any()
        levels = kinematics(seed, legs(0)).hierarchy([Task(rows=[0])], rate_limits=(-1, 1))
        np.testing.assert_array_equal(levels.solve([[requested]]).active_limits, [1, 1, 1])
        bounded = lexicographic_least_squares(
            [(legs(seed)[:1], [requested])], lower=-1.0, upper=1.0
        )
        np.testing.assert_array_equal(bounded.active, [1, 1, 1])


@pytest.mark.parametrize("seed", range(30))
def test_an_unlimited_task_has_scale_one(seed):
    """Check warm starts, which may differ by a bit."""
    rng = np.random.default_rng(seed)
    J, requested = rng.normal(size=(2, 4)), rng.normal(size=2)
    mapping = velocity_mapping(J, [0, 1], rate_limits=(-9, 9), when_limited="scaled")
    again = mapping.solve(requested, start=mapping.solve(rng.normal(size=2)))
    assert again.scale == 1.0 and again.status is Status.EXACT


def test_equal_joints_are_listed_in_order():
    """Check eight equal legs in one closed sum: five are listed."""
    names = Names(tuple("abcdefgh"), tuple((name,) for name in "abcdefgh"))
    message = set()
    for seed in PROCESSORS:
        loop = bits(np.random.default_rng(seed), np.ones((1, 8)))
        system = ConstrainedSystem(np.eye(1, 8), loop, range(8), names=names)
        message.add(str(system.kinematics().manipulability([0])))
    (sentence,) = message
    assert "a, b, c, d, e and 3 more" in sentence


def test_the_atlas_of_equal_struts_has_one_basis_of_lost_directions():
    """Check four struts of a task of four rows: each failure loses a direction."""
    parallel, lost = np.vstack([np.ones(4), np.eye(3, 4)]), []
    for seed in PROCESSORS:
        J = bits(np.random.default_rng(seed), parallel)
        lost.append(failure_atlas(ConstrainedSystem(J, None, range(4)), [0]).lost_secondary)
    assert np.ptp(lost, axis=0).max() < 1e-12 and np.max(lost) > 0.5


@pytest.mark.parametrize("seed", range(6))
def test_default_secondary_rows_depend_on_the_major_subspace_alone(seed):
    """Check that the default secondary coordinates do not depend on LAPACK."""
    rng = np.random.default_rng(seed)
    J, major = rng.normal(size=(5, 6)), rng.normal(size=(2, 5))
    weights = {"joint_weight": np.ones(6), "secondary_weight": [1.0, 2.0, 3.0]}
    one, other = (
        velocity_mapping(J, mix @ major, **weights) for mix in (np.eye(2), rng.normal(size=(2, 2)))
    )
    np.testing.assert_allclose(one.secondary, other.secondary, atol=1e-10)
    by_rows = velocity_mapping(J, [1, 3], **weights)
    by_matrix = velocity_mapping(J, np.eye(5)[[1, 3]], **weights)
    np.testing.assert_allclose(by_matrix.secondary, by_rows.secondary, atol=1e-14)


def test_corners_are_distinct_and_start_with_the_same_one():
    """Check six struts in three parallel pairs: the same hexagon as for three struts."""
    angle = np.pi / 3 * np.arange(6)
    struts = np.stack([np.cos(angle), np.sin(angle)])
    for seed in PROCESSORS:
        result = kinematics(seed, struts).attainable([0, 1], rate_limits=(-1.0, 1.0)).vertices
        # Each pair has twice the range of a strut, and the three pairs add up.
        np.testing.assert_allclose(result, 4 * struts.T, atol=1e-12)
        cube = kinematics(seed, np.eye(3)).attainable([0, 1, 2], rate_limits=(-1.0, 1.0)).vertices
        np.testing.assert_allclose(cube, list(product((-1.0, 1.0), repeat=3)), atol=1e-12)
