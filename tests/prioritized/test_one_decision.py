"""Motion and force rest on one rank decision: power balances however near the threshold it is."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prioritized import ConstrainedSystem, Kinematics, Status
from prioritized._solver.rank import RANK_TOLERANCE
from tests.random_systems import SEEDS, major_and_rest, null, of_rank, orthogonal

NEAR = st.floats(-1.0, 2.0)
"""Exponent of a singular value in multiples of what counts as zero: 0.1 to 100."""


def nearly_held(seed: int, nearness: float, m: int, columns: int) -> Kinematics:
    """An arm of m task rows whose passive columns hardly move the task, each a little differently.

    Of several columns the first may move it well.
    """
    rng = np.random.default_rng(seed)
    active, kept = rng.normal(size=(m, 4)), min(m, columns)
    sigma = 10.0 ** (nearness + rng.uniform(-0.5, 0.5, size=kept)) * RANK_TOLERANCE
    if kept > 1 and rng.random() < 0.5:
        sigma[0] = 1.0
    passive = orthogonal(rng, m)[:, :kept] * sigma @ orthogonal(rng, columns)[:kept]
    J_T = np.hstack([active, np.linalg.norm(active) * passive])
    return ConstrainedSystem(J_T, None, range(4)).kinematics()


def nearly_constrained(seed: int, nearness: float, m: int, columns: int) -> Kinematics:
    """Loops that forbid one active rate by hardly more, or less, than what counts as zero."""
    rng = np.random.default_rng(seed)
    J_Cp = of_rank(rng, columns + 1, columns, columns)
    follow, forbidden = rng.normal(size=(columns, 4)), rng.normal(size=(1, 4))
    weak = np.linalg.norm(J_Cp) * 10.0**nearness * RANK_TOLERANCE * null(J_Cp.T) @ forbidden
    J_C = np.hstack([J_Cp @ follow + weak, J_Cp])
    return ConstrainedSystem(rng.normal(size=(m, 4 + columns)), J_C, range(4)).kinematics()


@pytest.mark.parametrize("near", [nearly_held, nearly_constrained])
@given(SEEDS, NEAR, st.integers(1, 6), st.integers(1, 3), st.data())
def test_power_balances_at_any_gap(near, seed, nearness, m, columns, data):
    """Force times velocity is torque times rate, for whatever motion the report admits."""
    kin, rng = near(seed, nearness, m, columns), np.random.default_rng(seed)
    major, rest = major_and_rest(data, m)
    mapping = kin.force_mapping(major, None, rng.uniform(0.5, 2, 4), rng.uniform(0.5, 2, len(rest)))
    aims = [rng.normal(size=size) for size in (len(major), 4, len(rest))]
    torques, f = mapping(*aims), np.empty(m)
    f[major], f[rest] = aims[0] - mapping.residual(aims[0]), mapping.secondary_force(*aims)
    Z = null(kin.active_constraint)
    rates = Z @ rng.normal(size=Z.shape[1])
    v = kin.J @ rates + kin.self_motion @ rng.normal(size=kin.self_motion.shape[1])
    size = np.linalg.norm(np.concatenate(aims)) * np.linalg.norm(v)
    size += np.linalg.norm(torques) * np.linalg.norm(rates)
    assert abs(f @ v - torques @ rates) <= 1e-9 * size


@given(SEEDS, NEAR, st.integers(1, 6), st.integers(1, 3))
def test_report_and_both_mappings_agree_on_the_self_motion_of_the_whole_task(
    seed, nearness, m, columns
):
    """With every row major: it is the task's self-motion or none, and no force acts on it."""
    kin, rows = nearly_held(seed, nearness, m, columns), list(range(m))
    report = kin.manipulability(rows)
    assert report.bases["unstable"].shape == report.bases["unstable_major"].shape
    velocity, force = kin.velocity_mapping(rows), kin.force_mapping(rows)
    assert (velocity.status is Status.SELF_MOTION) == report.unstable
    assert (force.status is Status.LEAST_SQUARES) == report.unstable
    assert force.rank == m - report.bases["unstable"].shape[1]
    assert force.gap <= 1.001 * report.gaps["unstable"]
