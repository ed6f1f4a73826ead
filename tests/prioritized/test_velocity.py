"""Test the velocity mapping, Problem 1: oracles in all coordinates, optimality, units, damping."""

import numpy as np
import pytest
import scipy.linalg
from hypothesis import given
from hypothesis import strategies as st

from prioritized import Status, force_mapping, velocity_mapping
from tests import spaces
from tests.profiles import examples
from tests.random_systems import (
    SEEDS,
    as_matrix,
    failures,
    major_and_secondary,
    of_rank,
    orthogonal,
    systems,
    weights,
)


def theorem_3(J_m, J_s, W1, W2):
    """Evaluate eq. (25) as printed: gains of v_md, and of the stacked [rates_d; v_sd]."""
    J_m_pinv, N = pinv_and_null(J_m)
    K = N @ np.linalg.pinv(np.vstack([W1 @ N, W2 @ J_s @ N]))
    major = J_m_pinv - K @ np.vstack([W1 @ J_m_pinv, W2 @ J_s @ J_m_pinv])
    return major, K @ scipy.linalg.block_diag(W1, W2)


def theorem_4(J_m, W1):
    """Evaluate eq. (28) as printed."""
    J_m_pinv, N = pinv_and_null(J_m)
    K = N @ np.linalg.pinv(W1 @ N) @ W1
    return J_m_pinv - K @ J_m_pinv, K


def theorem_5(J_m, J_s, W2):
    """Evaluate eq. (30) as printed."""
    J_m_pinv, N = pinv_and_null(J_m)
    A, B = W2 @ J_s @ N, W2 @ J_s @ J_m_pinv
    NA = N @ scipy.linalg.null_space(A)
    least_norm = np.eye(J_m.shape[1]) - NA @ np.linalg.pinv(NA)
    A_pinv = np.linalg.pinv(A)
    return least_norm @ (J_m_pinv - N @ A_pinv @ B), least_norm @ N @ A_pinv @ W2


def pinv_and_null(A: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return np.linalg.pinv(A), scipy.linalg.null_space(A)


@given(SEEDS, st.integers(1, 3), st.integers(1, 4), st.integers(0, 3))
def test_theorems_3_4_and_5_are_special_cases(seed, m1, m2, extra):
    m, n = m1 + m2, m1 + extra + 1
    rng, major = np.random.default_rng(seed), list(range(m1))
    J = rng.normal(size=(m, n))
    J_m, J_s = J[:m1], J[m1:]
    W1, W2 = (rng.normal(size=(k, k)) + 3 * np.eye(k) for k in (n, m2))
    v_m, targets = (
        rng.normal(size=m1),
        {"joint": rng.normal(size=n), "secondary": rng.normal(size=m2)},
    )
    for W, (major_gain, goals_gain), goals, atol in (
        ((W1, W2), theorem_3(J_m, J_s, W1, W2), ["joint", "secondary"], 1e-8),
        ((W1, None), theorem_4(J_m, W1), ["joint"], 1e-8),
        ((None, W2), theorem_5(J_m, J_s, W2), ["secondary"], 1e-6),
    ):
        mapping = velocity_mapping(J, major, None, *W)
        rates = mapping(v_m, *targets.values())  # before gains are computed
        expected = major_gain @ v_m + goals_gain @ np.concatenate([targets[goal] for goal in goals])
        np.testing.assert_allclose(rates, expected, atol=10 * atol)
        result = np.hstack([getattr(mapping, goal) for goal in goals])
        np.testing.assert_allclose(mapping.major, major_gain, atol=atol)
        np.testing.assert_allclose(result, goals_gain, atol=atol)


@given(st.data(), systems())
def test_rates_are_the_lexicographic_optimum_over_all_coordinates(data, sample):
    """Compare with active and passive rates together, the loops as hard rows."""
    system = data.draw(failures(sample.system))
    kin, rng = system.kinematics(), sample.rng
    m, n = kin.J.shape
    major, others = major_and_secondary(data, m)
    W1, W2 = data.draw(weights(n, rng)), data.draw(weights(len(others), rng))
    M, T = of_rank(rng, len(major) + 1, len(major), len(major)), data.draw(weights(n, rng))
    mapping = kin.velocity_mapping(major, None, W1, W2, major_metric=M, tie_metric=T)
    targets = [rng.normal(size=size) for size in (len(major), n, len(others))]
    rates = mapping(*targets)

    # xi of eq. (10) is not commanded: passive rates contain no self-motion.
    hard = np.vstack([spaces.closure(system), spaces.self_motions(system, kin).T])
    J_T, to_rates = system.J_T, np.eye(system.J_T.shape[1])[kin.active]
    W1, W2, T = as_matrix(W1, n), as_matrix(W2, len(others)), as_matrix(T, n)
    levels = [
        (M @ J_T[major], M @ targets[0]),
        (
            np.vstack([W1 @ to_rates, W2 @ J_T[others]]),
            np.concatenate([W1 @ targets[1], W2 @ targets[2]]),
        ),
        (T @ to_rates, np.zeros(len(T))),
        (to_rates, np.zeros(n)),
    ]
    best = spaces.dense_lexicographic(hard, levels)
    # Random sub-blocks may be ill-conditioned, hence the tolerance of 1e-6.
    np.testing.assert_allclose(rates, best[kin.active], atol=1e-6)
    if n:
        np.testing.assert_allclose(kin.passive_rates(rates), best[kin.passive], atol=1e-6)
    np.testing.assert_allclose(
        mapping.residual(targets[0]), targets[0] - J_T[major] @ best, atol=1e-6
    )


@given(st.integers(1, 5), st.integers(1, 5), st.data(), SEEDS)
def test_without_weights_the_gain_is_the_moore_penrose_inverse(m, n, data, seed):
    """Check Penrose's four conditions, which determine the matrix, for any shape and rank."""
    rank = data.draw(st.integers(0, min(m, n)))
    size = 10.0 ** data.draw(st.integers(-100, 100))
    A = size * of_rank(np.random.default_rng(seed), m, n, rank)
    X = velocity_mapping(A, list(range(m))).major
    AX, XA = A @ X, X @ A  # products of A and A^+ are of order one for any size
    np.testing.assert_allclose(AX @ A / size, A / size, atol=1e-12)
    np.testing.assert_allclose(XA @ X * size, X * size, atol=1e-12)
    np.testing.assert_allclose(AX, AX.T, atol=1e-12)
    np.testing.assert_allclose(XA, XA.T, atol=1e-12)


@given(SEEDS)
def test_major_directions_are_as_good_as_rows_in_any_order(seed):
    rng = np.random.default_rng(seed)
    J, turned = rng.normal(size=(6, 6)), orthogonal(rng, 6)
    by_rows = velocity_mapping(J, [0, 1], secondary_weight=np.ones(4))
    by_directions = velocity_mapping(turned @ J, np.eye(6)[:2] @ turned.T, None, None, np.ones(4))
    np.testing.assert_allclose(by_rows.major, by_directions.major, atol=1e-8)
    J = np.random.default_rng(0).normal(size=(6, 6))
    paper = velocity_mapping(J, [0, 1], secondary=[3, 4, 5, 2], secondary_weight=[10, 10, 1, 1])
    ascending = velocity_mapping(J, [0, 1], secondary_weight=np.diag([1, 10, 10, 1]))
    np.testing.assert_allclose(paper.major, ascending.major, atol=1e-12)


SIZES = (5e-324, 1e-310, 1e-308, 1e-200, 1e-60, 1e60, 1e110)


@pytest.mark.parametrize("size", SIZES)
def test_a_common_factor_of_all_weights_changes_nothing(size):
    """Check ratios of 1, 2 and 4, exact even for denormals; factors of 1e-309 gave NaN."""
    J, v = np.random.default_rng(5).normal(size=(3, 4)), np.array([0.3, -0.2])
    W1, W2 = np.array([1.0, 2.0, 4.0, 1.0]), np.array([2.0])
    plain = velocity_mapping(J, [0, 1], joint_weight=W1, secondary_weight=W2)
    scaled = velocity_mapping(J, [0, 1], joint_weight=size * W1, secondary_weight=size * W2)
    assert scaled.status is Status.EXACT
    np.testing.assert_allclose(scaled(v, np.ones(4), [0.1]), plain(v, np.ones(4), [0.1]), rtol=1e-9)
    np.testing.assert_allclose(scaled.joint, plain.joint, atol=1e-9)
    one, same = (velocity_mapping(J, [0], tie_metric=factor * W1) for factor in (1.0, size))
    np.testing.assert_allclose(same([1.0]), one([1.0]), rtol=1e-9)
    one, same = (force_mapping(J, [0], torque_weight=factor * W1) for factor in (1.0, size))
    np.testing.assert_allclose(same([1.0], np.ones(4)), one([1.0], np.ones(4)), rtol=1e-9)
    many = np.array([1.0, size, 1e60])[:, None, None] * np.diag(W1)
    rates = velocity_mapping(J, [0, 1], joint_weight=many)(v)
    one = velocity_mapping(J, [0, 1], joint_weight=W1)(v)
    np.testing.assert_allclose(rates, [one, one, one], rtol=1e-9)


@given(SEEDS, st.floats(0, 14), st.floats(0, 12), st.integers(0, 2))
def test_damping_bounds_the_rates_near_any_singularity(seed, nearness, small, bound):
    """Check that sigma / (sigma^2 + lambda^2) <= 1 / (2 lambda), with closed loops."""
    rng = np.random.default_rng(seed)
    n, damping = 2 + bound, 10.0**-small
    C = of_rank(rng, bound, n, bound)
    Z = np.linalg.svd(np.vstack([C, np.zeros((n, n))]))[2][bound:]
    J = orthogonal(rng, 2) @ np.diag([1.0, 10.0**-nearness]) @ Z
    M = of_rank(rng, 2, 2, 2)
    mapping = velocity_mapping(
        J, [0, 1], active_constraint=C, major_metric=M, damping=damping, rank_tolerance=1e-16
    )
    v = rng.normal(size=2)
    rates = mapping(v)
    assert np.linalg.norm(rates) <= np.linalg.norm(M @ v) / (2 * damping) * (1 + 1e-9)
    assert np.linalg.norm(C @ rates) <= 1e-12 * np.linalg.norm(rates)
    assert mapping.status is Status.DAMPED
    miss = M.T @ M @ mapping.residual(v)
    # Round-off of J rates, where large terms cancel, in the metric.
    round_off = 1e-14 * float((1.0 + np.linalg.norm(rates)) * (1.0 + np.linalg.norm(M, 2) ** 2))
    np.testing.assert_allclose(Z @ J.T @ miss, damping**2 * Z @ rates, rtol=1e-6, atol=round_off)


FADING = st.one_of(st.integers(0, 300), st.integers(153, 161))  # their squares are denormal


@given(SEEDS, st.integers(1, 3), FADING)
@examples(200)
def test_a_relatively_small_weight_has_no_effect(seed, m2, exponent):
    """Check that rates are finite: a weight of 1e-160 with one of 3.3 gave infinity."""
    rng = np.random.default_rng(seed)
    J, weights = rng.normal(size=(2 + m2, 4)), rng.uniform(0.5, 4, 4 + m2)
    targets = [rng.normal(size=size) for size in (2, 4, m2)]

    def rates(at: int, factor: float) -> np.ndarray:
        own = weights * np.where(np.arange(4 + m2) == at, factor, 1.0)
        return velocity_mapping(J, [0, 1], None, own[:4], own[4:])(*targets)

    for at in range(4 + m2):
        small = rates(at, 10.0**-exponent)
        assert np.isfinite(small).all()
        if exponent > 20:
            np.testing.assert_allclose(small, rates(at, 0.0), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("limits", [None, (-1.0, 1.0)])
def test_an_overflowing_product_of_goal_and_weight_raises(limits):
    """Check numbers that are valid each, but whose product is not."""
    weights = {"joint_weight": np.ones(3), "secondary_weight": [2.5]}
    mapping = velocity_mapping(np.eye(2, 3), [0], rate_limits=limits, **weights)
    assert np.isfinite(mapping([0.1], secondary_velocity=[1e100])).all()
    with pytest.raises(ValueError, match="times their weights must be below 1e120"):
        mapping([0.1], secondary_velocity=[8e119])
