"""Laws of the velocity mapping, Problem 1, over random shapes, ranks and weights."""

import numpy as np
import pytest
import scipy.linalg
from hypothesis import given
from hypothesis import strategies as st

from prioritized import Status, velocity_mapping

SEEDS = st.integers(0, 2**32 - 1)


def random_task(seed: int, m: int, n: int, rank: int | None = None) -> np.ndarray:
    """A task Jacobian of the given rank with singular values between 0.5 and 2."""
    rng = np.random.default_rng(seed)
    U = np.linalg.qr(rng.normal(size=(m, m)))[0]
    V = np.linalg.qr(rng.normal(size=(n, n)))[0]
    k = min(m, n) if rank is None else rank
    return U[:, :k] * rng.uniform(0.5, 2.0, size=k) @ V[:k]


def pinv_and_null(A: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return np.linalg.pinv(A), scipy.linalg.null_space(A)


def theorem_3(J_m, J_s, W1, W2):
    """Eq. (25), as printed: gains of v_md, and of the stacked [rates_d; v_sd]."""
    J_m_pinv, N = pinv_and_null(J_m)
    K = N @ np.linalg.pinv(np.vstack([W1 @ N, W2 @ J_s @ N]))
    major = J_m_pinv - K @ np.vstack([W1 @ J_m_pinv, W2 @ J_s @ J_m_pinv])
    return major, K @ scipy.linalg.block_diag(W1, W2)


def theorem_4(J_m, W1):
    """Eq. (28), as printed."""
    J_m_pinv, N = pinv_and_null(J_m)
    K = N @ np.linalg.pinv(W1 @ N) @ W1
    return J_m_pinv - K @ J_m_pinv, K


def theorem_5(J_m, J_s, W2):
    """Eq. (30), as printed."""
    J_m_pinv, N = pinv_and_null(J_m)
    A, B = W2 @ J_s @ N, W2 @ J_s @ J_m_pinv
    NA = N @ scipy.linalg.null_space(A)
    least_norm = np.eye(J_m.shape[1]) - NA @ np.linalg.pinv(NA)
    A_pinv = np.linalg.pinv(A)
    return least_norm @ (J_m_pinv - N @ A_pinv @ B), least_norm @ N @ A_pinv @ W2


@given(SEEDS, st.integers(1, 3), st.integers(1, 4), st.integers(0, 3))
def test_theorems_3_4_and_5_are_special_cases(seed, m1, m2, extra):
    m, n = m1 + m2, m1 + extra + 1
    rng = np.random.default_rng(seed)
    J = rng.normal(size=(m, n))
    J_m, J_s = J[:m1], J[m1:]
    W1, W2 = (rng.normal(size=(k, k)) + 3 * np.eye(k) for k in (n, m2))
    major = list(range(m1))

    both = velocity_mapping(J, major, joint_weight=W1, secondary_weight=W2)
    expected, goals = theorem_3(J_m, J_s, W1, W2)
    np.testing.assert_allclose(both.major, expected, atol=1e-8)
    np.testing.assert_allclose(np.hstack([both.joint, both.secondary]), goals, atol=1e-8)

    joint = velocity_mapping(J, major, joint_weight=W1)
    expected, goals = theorem_4(J_m, W1)
    np.testing.assert_allclose(joint.major, expected, atol=1e-8)
    np.testing.assert_allclose(joint.joint, goals, atol=1e-8)

    secondary = velocity_mapping(J, major, secondary_weight=W2)
    expected, goals = theorem_5(J_m, J_s, W2)
    np.testing.assert_allclose(secondary.major, expected, atol=1e-6)
    np.testing.assert_allclose(secondary.secondary, goals, atol=1e-6)


@given(SEEDS, st.integers(2, 6), st.integers(0, 2), st.integers(0, 6), st.integers(0, 4))
def test_no_admissible_change_of_the_rates_improves_any_level(seed, n, c, w1_rank, w2_rank):
    """Optimality, level by level, for singular, wide and zero weights and with constraints."""
    rng = np.random.default_rng(seed)
    m1, m2 = 2, 3
    J = rng.normal(size=(m1 + m2, n))
    C = random_task(seed + 1, c, n) if c else np.zeros((0, n))
    W1 = random_task(seed + 2, n, n, min(w1_rank, n))
    W2 = random_task(seed + 3, 4, m2, min(w2_rank, m2))
    mapping = velocity_mapping(J, [0, 1], joint_weight=W1, secondary_weight=W2, active_constraint=C)
    v_m, rates_d, v_sd = rng.normal(size=m1), rng.normal(size=n), rng.normal(size=m2)
    x = mapping(v_m, rates_d, v_sd)

    assert np.abs(C @ x).max(initial=0.0) < 1e-9
    null_C = scipy.linalg.null_space(C) if c else np.eye(n)
    J_m = J[:m1]
    # Gradient of |J_m x - v_m|^2 along the admissible rates is zero.
    np.testing.assert_allclose(null_C.T @ J_m.T @ (J_m @ x - v_m), 0, atol=1e-8)
    np.testing.assert_allclose(mapping.residual(v_m), v_m - J_m @ x, atol=1e-8)
    # Gradient of the weighted sum along what leaves the major task alone is zero.
    free = null_C @ scipy.linalg.null_space(J_m @ null_C, rcond=1e-9) if null_C.size else null_C
    G = np.vstack([W1, W2 @ J[m1:]])
    miss = G @ x - np.concatenate([W1 @ rates_d, W2 @ v_sd])
    np.testing.assert_allclose(free.T @ G.T @ miss, 0, atol=1e-7)
    # Among equals the rates are the shortest: nothing of x lies where no level looks.
    if free.size:
        unseen = free @ scipy.linalg.null_space(G @ free, rcond=1e-9)
        np.testing.assert_allclose(unseen.T @ x, 0, atol=1e-7)


@given(SEEDS)
def test_secondary_goals_never_move_the_major_task(seed):
    rng = np.random.default_rng(seed)
    J = rng.normal(size=(6, 6))
    mapping = velocity_mapping(
        J, [0, 1], joint_weight=rng.uniform(0, 1e3, 6), secondary_weight=rng.uniform(0, 1e3, 4)
    )
    np.testing.assert_allclose(J[:2] @ mapping.major, np.eye(2), atol=1e-9)
    np.testing.assert_allclose(J[:2] @ mapping.joint, 0, atol=1e-9)
    np.testing.assert_allclose(J[:2] @ mapping.secondary, 0, atol=1e-9)
    assert mapping.status is Status.EXACT


def test_a_major_task_out_of_reach_comes_out_as_the_least_squares_best_and_says_so():
    J = np.array([[1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 1.0]])
    mapping = velocity_mapping(J, [0, 1], joint_weight=np.ones(3))
    assert mapping.status is Status.LEAST_SQUARES
    assert mapping.rank == 1
    assert "residual" in mapping.status.value
    np.testing.assert_allclose(mapping([1.0, 3.0]), [2.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(mapping.residual([1.0, 3.0]), [-1.0, 1.0], atol=1e-12)


@pytest.mark.parametrize("distance", [1e-14, 1e-12, 1e-8, 1e-4])
def test_near_a_singularity_the_rank_decision_and_its_gap_are_stated(distance):
    J = np.array([[1.0, 0.0], [1.0, distance]])
    mapping = velocity_mapping(J, [0, 1])
    assert mapping.rank == (2 if distance > 1e-10 else 1)
    assert mapping.gap > 1.0
    assert np.isfinite(mapping.major).all()


def test_the_rank_is_decided_against_the_scale_given_not_against_what_is_left_of_a_difference():
    left_over = 1e-17 * np.ones((1, 3))
    assert velocity_mapping(left_over, [0], scale=1.0).rank == 0
    assert velocity_mapping(left_over, [0]).rank == 1


@given(SEEDS)
def test_a_batch_is_its_elements_one_by_one(seed):
    rng = np.random.default_rng(seed)
    J, W1 = rng.normal(size=(5, 6, 6)), rng.normal(size=(5, 6, 6))
    J[0] = 0.0  # one of them has nothing to offer
    v = rng.normal(size=(5, 2))
    batch = velocity_mapping(J, [0, 1], joint_weight=W1, secondary_weight=[1, 2, 3, 4])
    for k in range(5):
        one = velocity_mapping(J[k], [0, 1], joint_weight=W1[k], secondary_weight=[1, 2, 3, 4])
        np.testing.assert_allclose(batch(v)[k], one(v[k]), atol=1e-9)
        assert batch.rank[k] == one.rank


@given(SEEDS)
def test_weights_that_change_at_every_tick_never_move_the_major_task(seed):
    """Remark 10: goals on the fly; the major task does not see what the weights do."""
    rng = np.random.default_rng(seed)
    J, v_major = rng.normal(size=(6, 6)), np.array([1.0, -2.0])
    travelled = np.zeros(6)
    for _ in range(10):
        mapping = velocity_mapping(
            J, [0, 1], joint_weight=rng.uniform(0, 9, 6), secondary_weight=rng.uniform(0, 9, 4)
        )
        travelled += mapping(v_major, rng.normal(size=6), rng.normal(size=4)) / 10
    np.testing.assert_allclose(J[:2] @ travelled, v_major, atol=1e-8)


def test_the_answer_has_the_batch_axes_of_all_arguments_together():
    """A batch of weights on one mechanism, or of mechanisms under one weight: ranks for each."""
    J = np.random.default_rng(0).normal(size=(6, 6))
    W = np.ones((4, 1, 6, 6))
    for mapping in (
        velocity_mapping(J, [0, 1], joint_weight=W),
        velocity_mapping(np.stack([J] * 5), [0, 1], joint_weight=W),
    ):
        assert mapping.rank.shape == mapping.gap.shape == mapping.major.shape[:-2]


@given(SEEDS)
def test_major_directions_are_as_good_as_rows(seed):
    rng = np.random.default_rng(seed)
    J = rng.normal(size=(6, 6))
    by_rows = velocity_mapping(J, [0, 1], secondary_weight=np.ones(4))
    turned = np.linalg.qr(rng.normal(size=(6, 6)))[0]
    by_directions = velocity_mapping(turned @ J, np.eye(6)[:2] @ turned.T, None, None, np.ones(4))
    np.testing.assert_allclose(by_rows.major, by_directions.major, atol=1e-8)


def test_the_order_of_the_secondary_rows_is_the_order_of_their_weights():
    J = np.random.default_rng(0).normal(size=(6, 6))
    paper = velocity_mapping(J, [0, 1], secondary=[3, 4, 5, 2], secondary_weight=[10, 10, 1, 1])
    ascending = velocity_mapping(J, [0, 1], secondary_weight=np.diag([1, 10, 10, 1]))
    np.testing.assert_allclose(paper.major, ascending.major, atol=1e-12)


def test_a_weighted_pseudo_inverse_spoils_the_major_task_and_the_mapping_does_not():
    """The paper's introduction, section 1: weighting all rows trades pointing for the rest."""
    J = np.random.default_rng(1).normal(size=(6, 4))
    v = np.array([1.0, -1.0, 0.0, 0.0, 0.0, 0.0])
    weighted = np.linalg.pinv(np.diag([10.0, 10, 1, 1, 1, 1]) @ J) @ (v * [10, 10, 1, 1, 1, 1])
    prioritized = velocity_mapping(J, [0, 1], secondary_weight=np.ones(4))(v[:2])
    assert np.linalg.norm(J[:2] @ weighted - v[:2]) > 1e-3
    assert np.linalg.norm(J[:2] @ prioritized - v[:2]) < 1e-12


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"J": [1.0, 2.0]}, r"J must have shape \(\.\.\., any, any\)"),
        ({"J": [[np.nan, 1.0]]}, "J must be finite"),
        ({"major": [2]}, r"major must lie in 0\.\.1, got \[2\]"),
        ({"major": [0, 0]}, "major must not repeat"),
        ({"major": [0.5]}, "major must be a list of integers"),
        ({"joint_weight": [1.0]}, r"joint_weight must have shape \(3,\) or \(\.\.\., any, 3\)"),
        ({"joint_weight": 2.0}, r"joint_weight must have shape \(3,\) or \(\.\.\., any, 3\)"),
        (
            {"secondary_weight": [[1.0, 2.0]]},
            r"secondary_weight must have shape \(1,\) or \(\.\.\., any, 1\)",
        ),
        ({"secondary_weight": [np.inf]}, "secondary_weight must be finite"),
        ({"scale": np.nan}, "scale must be finite"),
        ({"scale": -1.0}, "scale must not be negative"),
        ({"rank_tolerance": -1e-9}, r"rank_tolerance must be from 0 to 0\.5"),
        ({"J": [[1j, 0.0]]}, "J must hold real numbers"),
        ({"J": [[1.0, 2.0], [3.0]]}, "J must be a rectangular array"),
        (
            {"active_constraint": [[1.0, 2.0]]},
            r"active_constraint must have shape \(\.\.\., any, 3\)",
        ),
    ],
)
def test_wrong_input_is_refused_by_name(arguments, message):
    good = {"J": [[1.0, 0.0, 2.0], [0.0, 1.0, 0.0]], "major": [0]}
    with pytest.raises(ValueError, match=message):
        velocity_mapping(**(good | arguments))


def test_a_velocity_of_the_wrong_size_is_refused_by_name():
    mapping = velocity_mapping(np.eye(3), [0, 1])
    with pytest.raises(ValueError, match=r"v_major must have shape \(\.\.\., 2\), got \(3,\)"):
        mapping([1.0, 2.0, 3.0])
    with pytest.raises(ValueError, match="secondary_velocity must be finite"):
        mapping([1.0, 2.0], secondary_velocity=[np.nan])
