"""Test motions of a mechanism: all velocities, and springs on motion that loops leave free."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prioritized import ConstrainedSystem, failure_atlas
from prioritized._solver.rank import RANK_TOLERANCE
from tests import spaces
from tests.random_systems import SEEDS, failures, orthogonal, springs, systems, with_stiffness


@given(st.data(), systems())
def test_all_velocities_are_in_the_order_of_the_columns(data, sample):
    """Check that they close the loops, move the task by J rates, and are zero for stuck joints."""
    system = data.draw(failures(sample.system))
    kin = system.kinematics()
    Z = spaces.null(kin.active_constraint)
    rates = (Z @ sample.rng.normal(size=(Z.shape[1], 4))).T.reshape(2, 2, -1)
    velocities = kin.velocities(rates)
    assert velocities.shape == (2, 2, system.J_T.shape[1])
    np.testing.assert_array_equal(velocities[..., kin.active], rates)
    np.testing.assert_array_equal(velocities[..., system.stuck], 0.0)
    allowed = spaces.motions(system)
    np.testing.assert_allclose(velocities @ allowed @ allowed.T, velocities, atol=1e-7)
    np.testing.assert_allclose(velocities @ system.J_T.T, rates @ kin.J.T, atol=1e-7)
    np.testing.assert_allclose(kin.velocities(rates[0, 0]), velocities[0, 0], atol=1e-12)


@given(st.data(), systems())
def test_passive_joints_minimize_the_energy_of_all_joints(data, sample):
    """Compare with dense algebra: loops, actuators, then energy of K, then the metric."""
    system, rng = data.draw(failures(sample.system)), sample.rng
    N = system.J_T.shape[1]
    R, S = data.draw(springs(N, rng)), data.draw(springs(N, rng))
    kin = with_stiffness(system, R.T @ R).kinematics(passive_metric=S.T @ S)
    Z = spaces.null(kin.active_constraint)
    rates = Z @ rng.normal(size=Z.shape[1])
    levels = [
        (np.eye(N)[kin.active], rates),
        (R, np.zeros(N)),
        (S, np.zeros(N)),
        (np.eye(N), np.zeros(N)),
    ]
    best = spaces.dense_lexicographic(spaces.closure(system), levels)
    # Random sub-blocks may be ill-conditioned, hence the tolerance of 1e-6.
    np.testing.assert_allclose(kin.passive_rates(rates), best[kin.passive], atol=1e-6)
    np.testing.assert_allclose(kin.J @ rates, system.J_T @ best, atol=1e-6)


@given(st.data(), systems())
def test_motion_without_springs_remains_self_motion(data, sample):
    """Check stiffness on some joints only: the unaffected motions remain."""
    system = data.draw(failures(sample.system))
    R = data.draw(springs(system.J_T.shape[1], sample.rng))
    rigid, kin = system.kinematics(), with_stiffness(system, R.T @ R).kinematics()
    spring_lost = spaces.self_motions(system, rigid)
    spring_lost = spring_lost @ spaces.null(R @ spring_lost)
    moved = system.J_T @ spring_lost
    spaces.assert_same(kin.passive_self_motion, spring_lost[kin.passive])
    spaces.assert_spans(kin.self_motion, moved)
    # Springs close no loop and constrain no rate.
    for name in ("internal_force", "active_constraint"):
        np.testing.assert_allclose(getattr(kin, name), getattr(rigid, name), atol=1e-12)


@given(SEEDS, st.floats(2, 14), st.floats(-6, 6))
def test_springs_below_the_rank_tolerance_of_the_stiffest_do_not_count(seed, weakness, unit):
    """Check two loose hinges on a serial arm: the weaker spring counts or not."""
    K = np.zeros((3, 3))
    Q = orthogonal(np.random.default_rng(seed), 2)
    K[1:, 1:] = 10.0**unit * Q @ np.diag([1.0, 10.0**-weakness]) @ Q.T
    K = (K + K.T) / 2
    ratio = 10.0**-weakness / np.hypot(1.0, 10.0**-weakness)
    if abs(np.log10(ratio / RANK_TOLERANCE)) > 0.05:  # round-off of K is 1e-16
        kin = ConstrainedSystem([[1.0, 1.0, 1.0]], None, [0], stiffness=K).kinematics()
        assert kin.passive_self_motion.shape[1] == (ratio < RANK_TOLERANCE)


@given(st.floats(3, 100), st.floats(-6, 6))
def test_round_off_of_a_coupling_to_an_active_joint_is_no_spring(exponent, unit):
    """Check K of one spring row (1, weak): the passive rate per active rate would be -1 / weak."""
    weak = 10.0**-exponent
    K = 10.0**unit * np.outer([1.0, weak], [1.0, weak])
    free = ConstrainedSystem([[1.0, 1.0]], None, [0])
    settled = with_stiffness(free, K)
    resisted = weak / np.hypot(1.0, weak) > RANK_TOLERANCE
    if abs(np.log10(weak / RANK_TOLERANCE)) < 0.05:
        return
    for kin in (settled.kinematics(), free.kinematics(passive_metric=K)):
        expected = 1.0 - 1.0 / weak if resisted else 1.0
        np.testing.assert_allclose(kin.J, [[expected]], rtol=1e-9)
        assert kin.gap == pytest.approx(max(weak / RANK_TOLERANCE, RANK_TOLERANCE / weak), rel=1e-3)
    assert settled.kinematics().self_motion.shape == (1, not resisted)
    # The atlas has the same decision, also with the joint's motor locked or released.
    elastic = failure_atlas(settled, [0]).elastic
    assert elastic is not None
    for row, failed in enumerate(({}, {"locked": [0]}, {"free": [0]})):
        kin = settled.with_failures(**failed).kinematics()
        report = kin.manipulability([0])
        assert elastic.unstable[row] == report.unstable
        gaps = elastic.gap[row], min(report.gaps.values())
        np.testing.assert_allclose(*np.minimum(gaps, 1e6), rtol=1e-3)
        np.testing.assert_allclose(elastic.worst_gain[row], report.worst_gain, rtol=1e-9)
