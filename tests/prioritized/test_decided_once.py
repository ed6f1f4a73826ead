"""One condition has one verdict, whoever is asked, and in every unit of length."""

import itertools

import numpy as np
import pytest

from prioritized import ConstrainedSystem, Status, failure_atlas
from tests.profiles import scaled
from tests.random_systems import orthogonal

FLAGS = (
    *("unmanipulable", "unmanipulable_task", "unstable", "unstable_major"),
    *("irresolvable", "constrained_active"),
)


def weak(rng: np.random.Generator, rows: int, columns: int) -> np.ndarray:
    """A matrix of which half the singular values lie between 1e-3 and 1e-9."""
    k = min(rows, columns)
    sigma = np.where(rng.random(k) < 0.5, 1.0, 10.0 ** -rng.uniform(3, 9, size=k))
    return orthogonal(rng, rows)[:, :k] * sigma @ orthogonal(rng, columns)[:k]


@pytest.mark.parametrize("seed", range(scaled(20)))
def test_atlas_report_and_mappings_agree_however_weak_a_direction_is(seed):
    """Ten mechanisms a seed, every condition of three actuators, tolerances among the values."""
    rng, rows = np.random.default_rng(seed), [0, 1]
    for _ in range(10):
        c, accuracy = int(rng.integers(0, 5)), 10.0 ** -rng.uniform(5, 9)
        J_C = weak(rng, c, 7) if c else None
        system = ConstrainedSystem(weak(rng, 3, 7), J_C, range(3), geometry_accuracy=accuracy)
        atlas = failure_atlas(system, rows)
        for row, code in enumerate(itertools.product(range(3), repeat=3)):
            locked, free = ([k for k in range(3) if code[k] == what] for what in (1, 2))
            kin = system.with_failures(locked, free).kinematics()
            report = kin.manipulability(rows)
            for flag in FLAGS:
                assert getattr(atlas, flag)[row] == getattr(report, flag), (code, flag)
            mapping = kin.velocity_mapping(rows, joint_weight=np.ones(len(kin.active)))
            assert (mapping.status is Status.SELF_MOTION) == report.unstable_major
            assert (mapping.rank < 2) == report.unmanipulable
            assert mapping.rank == atlas.major_rank[row]
            attainable = kin.attainable(rows, (-1.0, 1.0))
            assert (attainable.radius > 0.0) == bool(atlas.possible[row])


@pytest.mark.parametrize("exponent", range(-12, 7, 2))
def test_a_planar_arm_moves_alike_in_every_unit_of_length(exponent):
    """Its place alone is the major task; with one joint left it cannot do both directions."""
    size, q = 10.0**exponent, np.cumsum([0.4, 0.9, -0.7])
    x, y = (np.cumsum((np.array([0.3, 0.25, 0.2]) * f(q))[::-1])[::-1] for f in (np.cos, np.sin))
    J, v = np.stack([np.ones(3), -size * y, size * x]), np.array([0.02, -0.05])
    system = ConstrainedSystem(J, None, range(3))
    for locked in ([], [2], [1, 2]):
        kin = system.with_failures(locked).kinematics()
        mapping = kin.velocity_mapping([1, 2], joint_weight=np.ones(3 - len(locked)))
        is_possible = len(locked) < 2
        assert (mapping.status is Status.EXACT) == is_possible
        assert kin.manipulability([1, 2]).unmanipulable != is_possible
        code = [[int(k in locked) for k in range(3)]]
        assert failure_atlas(system, [1, 2], codes=code).possible[0] == is_possible
        if is_possible:
            oracle = np.linalg.pinv(J[1:, : len(kin.active)] / size) @ v
            np.testing.assert_allclose(mapping(size * v), oracle, rtol=1e-9)
