"""Test the force mapping, Problem 6, with internal forces and self-motion."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from prioritized import Status, force_mapping
from tests import spaces
from tests.force_theorems import theorem_7, theorem_8
from tests.random_systems import (
    SEEDS,
    as_matrix,
    failures,
    major_and_secondary,
    of_rank,
    systems,
    weights,
)


@given(SEEDS, st.integers(1, 3), st.integers(1, 4), st.integers(0, 3))
def test_theorems_7_8_and_9_are_special_cases(seed, m1, m2, extra):
    """Compare with the paper's torques without self-motion and internal force."""
    n = m2 + extra
    rng = np.random.default_rng(seed)
    J_m, J_s = rng.normal(size=(m1, n)), of_rank(rng, m2, n, m2)
    J = np.vstack([J_m, J_s])
    W3, W4 = of_rank(rng, n, n, n), of_rank(rng, m2, m2, m2)
    major = list(range(m1))

    both = force_mapping(J, major, torque_weight=W3, secondary_weight=W4)
    expected, goals = theorem_7(J_m, J_s, W3, W4)
    np.testing.assert_allclose(both.major, expected, atol=1e-10)
    np.testing.assert_allclose(np.hstack([both.torque, both.secondary]), goals, atol=1e-10)

    torque = force_mapping(J, major, torque_weight=W3)
    expected, goals = theorem_8(J_m, J_s, W3)
    np.testing.assert_allclose(torque.major, expected, atol=1e-10)
    np.testing.assert_allclose(torque.torque, goals, atol=1e-10)

    secondary = force_mapping(J, major, secondary_weight=W4)  # Theorem 9
    np.testing.assert_allclose(secondary.major, J_m.T, atol=1e-10)
    np.testing.assert_allclose(secondary.secondary, J_s.T, atol=1e-10)


@given(st.data(), systems())
def test_torques_are_the_lexicographic_optimum_over_all_forces(data, sample):
    """Compare with eqs. (8) and (9) for all constraint forces, without elimination."""
    system = data.draw(failures(sample.system))
    kin = system.kinematics()
    rng, m, n = sample.rng, len(system.J_T), len(kin.active)
    major, others = major_and_secondary(data, m)
    m1, m2 = len(major), len(others)
    W3, W4 = data.draw(weights(n, rng)), data.draw(weights(m2, rng))
    T, M = data.draw(weights(n, rng)), of_rank(rng, m1 + 1, m1, m1)
    mapping = kin.force_mapping(major, None, W3, W4, major_metric=M, tie_metric=T)
    targets = rng.normal(size=m1), rng.normal(size=n), rng.normal(size=m2)
    torques, f_s = mapping(*targets), mapping.secondary_force(*targets)
    f = np.empty(m)
    f[major], f[others] = targets[0] - mapping.residual(targets[0]), f_s
    by_eq_16 = kin.J.T @ f + kin.active_constraint.T @ mapping.internal_force(*targets)
    np.testing.assert_allclose(torques, by_eq_16, atol=1e-9)
    # Forces do no work on self-motion, so that some major forces are unattainable.
    np.testing.assert_allclose((system.J_T @ spaces.self_motions(system, kin)).T @ f, 0, atol=1e-9)
    allowed = np.linalg.matrix_rank(spaces.null(kin.self_motion.T)[major], tol=1e-8)
    assert mapping.rank == allowed
    assert (mapping.status is Status.LEAST_SQUARES) == (allowed < m1)

    # Unknowns are f and f_C; stuck joints bear any force, moving ones none.
    bearing = np.setdiff1d(kin.passive, spaces.stuck_joints(system))
    balance = np.vstack([system.J_T, system.J_C]).T
    to_torques, to_f = balance[kin.active], np.eye(balance.shape[1])
    W3, W4, T = as_matrix(W3, n), as_matrix(W4, m2), as_matrix(T, n)
    weighted = np.vstack([W3 @ to_torques, W4 @ to_f[others]])
    levels = [
        (M @ to_f[major], M @ targets[0]),
        (weighted, np.concatenate([W3 @ targets[1], W4 @ targets[2]])),
        (T @ to_torques, np.zeros(len(T))),
        (to_torques, np.zeros(n)),
        (to_f[others], np.zeros(m2)),
    ]
    best = spaces.dense_lexicographic(balance[bearing], levels)
    # Random sub-blocks may be ill-conditioned, hence the tolerance of 1e-6.
    np.testing.assert_allclose(torques, to_torques @ best, atol=1e-6)
    np.testing.assert_allclose(f_s, best[others], atol=1e-6)
    np.testing.assert_allclose(mapping.residual(targets[0]), targets[0] - best[major], atol=1e-6)
