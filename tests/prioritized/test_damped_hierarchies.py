"""Damping of the levels of a hierarchy: normal equations, limits, and what damping costs."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prioritized import ConstrainedSystem, Kinematics, Status, Task, lexicographic_least_squares
from tests.lexicographic_oracles import by_active_sets
from tests.profiles import examples
from tests.random_systems import SEEDS, major_and_rest, of_rank, orthogonal, systems


def mechanism(J: np.ndarray) -> Kinematics:
    """An open chain with this Jacobian."""
    return ConstrainedSystem(J, None, range(J.shape[1])).kinematics()


def tikhonov(A: np.ndarray, b: np.ndarray, damping: float) -> np.ndarray:
    """The x that minimizes |A x - b|^2 + damping^2 |x|^2, by the normal equations."""
    return A.T @ np.linalg.solve(A @ A.T + damping**2 * np.eye(len(A)), b)


def null_projector(A: np.ndarray) -> np.ndarray:
    return np.eye(A.shape[1]) - np.linalg.pinv(A) @ A


@given(SEEDS, st.floats(1e-3, 3.0), st.floats(1e-3, 3.0))
@examples(60)
def test_two_damped_levels_solve_their_normal_equations(seed, first, second):
    """And the undamped level after them has the whole null space of both, damped or not."""
    rng = np.random.default_rng(seed)
    J, W, v, d = of_rank(rng, 4, 7, 4), rng.uniform(0.5, 2, 2), rng.normal(size=4), np.ones(7)
    levels = [Task([0, 1], W, damping=first), Task([2, 3], damping=second), Task.joints()]
    found = mechanism(J).hierarchy(levels).solve([v[:2], v[2:], d])
    x = tikhonov(W[:, None] * J[:2], W * v[:2], first)
    x = x + tikhonov(J[2:] @ null_projector(J[:2]), v[2:] - J[2:] @ x, second)
    x = x + null_projector(J) @ (d - x)
    np.testing.assert_allclose(found.rates, x, rtol=0, atol=1e-11)
    np.testing.assert_allclose(found.residuals[0], v[:2] - J[:2] @ x, rtol=0, atol=1e-11)
    np.testing.assert_allclose(found.residuals[1], v[2:] - J[2:] @ x, rtol=0, atol=1e-11)


@given(SEEDS, st.integers(2, 4), st.floats(0.01, 2.0), st.floats(0.01, 2.0))
@examples(40)
def test_damped_levels_within_limits_are_the_best_of_every_active_set(seed, n, first, second):
    """Damping is more rows: the singular vectors of a level on what those before it leave."""
    rng = np.random.default_rng(seed)
    J, v, d = of_rank(rng, 2, n, min(2, n)), 2 * rng.normal(size=2), rng.normal(size=n)
    lower, upper = -rng.uniform(0.1, 0.5, n), rng.uniform(0.1, 0.5, n)
    levels = [Task([0], damping=first), Task([1], damping=second), Task.joints()]
    found = mechanism(J).hierarchy(levels, rate_limits=(lower, upper)).solve([v[:1], v[1:], d])
    rows = J[:1], J[1:] @ null_projector(J[:1])
    units = [row / np.linalg.norm(row) for row in rows]
    problem = [
        (np.vstack([J[:1], first * units[0]]), np.append(v[:1], 0.0)),
        (np.vstack([J[1:], second * units[1]]), np.append(v[1:], 0.0)),
        (np.eye(n), d),
    ]
    np.testing.assert_allclose(
        found.rates, by_active_sets(problem, lower, upper), rtol=0, atol=1e-7
    )
    assert (lower <= found.rates).all() and (found.rates <= upper).all()


@given(st.data(), systems(tasks=(1, 4)), st.floats(1e-3, 1.0))
@examples(40)
def test_one_damped_level_is_a_damped_velocity_mapping(data, drawn, damping):
    """Of any mechanism, within limits: lost directions and constrained rates among them."""
    kin, rng = drawn.system.kinematics(), drawn.rng
    (m, n), W1 = kin.J.shape, rng.uniform(0.5, 2, len(drawn.system.active))
    major, _ = major_and_rest(data, m)
    limits = -rng.uniform(0.1, 1, n), rng.uniform(0.1, 1, n)
    v, d = 2 * rng.normal(size=len(major)), rng.normal(size=n)
    mapping = kin.velocity_mapping(major, [], W1, damping=damping, rate_limits=limits)
    levels = [Task(major, damping=damping), Task.joints(W1)]
    found = kin.hierarchy(levels, rate_limits=limits).solve([v, d])
    np.testing.assert_allclose(found.rates, mapping.solve(v, d).rates, rtol=0, atol=1e-7)


@pytest.mark.parametrize("least", [10.0**-k for k in range(1, 17)] + [0.0])
@pytest.mark.parametrize("level", [0, 1])
def test_rates_stay_bounded_as_a_singular_value_vanishes(least, level):
    """By |target| / (2 damping), whichever level is damped."""
    for seed in range(20):
        rng = np.random.default_rng(seed)
        damping, v = 10.0 ** -rng.uniform(0, 6), rng.normal(size=3)
        Q = orthogonal(rng, 6)
        near = orthogonal(rng, 3) @ np.diag([1.0, 0.7, least]) @ Q[:3]
        tasks, targets = [Task([0, 1, 2], damping=damping)], [v]
        if level:  # a level before it, orthogonal to it
            near = np.vstack([near, Q[3:4]])
            tasks, targets = [Task([3]), *tasks], [np.zeros(1), v]
        rates = mechanism(near).hierarchy(tasks)(targets)
        assert np.linalg.norm(rates) <= np.linalg.norm(v) / (2 * damping) * (1 + 1e-9)


@given(SEEDS, st.floats(1e-3, 10.0), st.integers(0, 9))
def test_levels_after_a_damped_one_have_its_null_space(seed, damping, nearness):
    """The second level is met exactly, and costs the first nothing; that has a row too many."""
    rng = np.random.default_rng(seed)
    Q = orthogonal(rng, 7)
    near = np.diag([1.0, 10.0**-nearness]) @ Q[:2]
    J = np.vstack([near, near.sum(axis=0), Q[2:]])
    kin, v = mechanism(J), rng.normal(size=8)
    damped = Task([0, 1, 2], damping=damping)
    alone = kin.hierarchy([damped]).solve([v[:3]])
    found = kin.hierarchy([damped, Task(range(3, 8))]).solve([v[:3], v[3:]])
    np.testing.assert_allclose(found.residuals[0], alone.residuals[0], rtol=0, atol=1e-11)
    np.testing.assert_allclose(found.residuals[1], 0.0, rtol=0, atol=1e-11)
    assert found.damping_errors[0] > 1e-9


@given(SEEDS, st.floats(0.01, 1.0), st.booleans())
@examples(40)
def test_what_damping_costs_is_what_is_achieved_without_less_what_is_with_it(
    seed, damping, limited
):
    """In every level, the undamped second one too: the other hierarchy is the oracle."""
    rng = np.random.default_rng(seed)
    J, v = of_rank(rng, 4, 5, 4), rng.normal(size=4)
    box = (-0.3, 0.3) if limited else None
    kin, targets = mechanism(J), [v[:2], v[2:]]
    found = kin.hierarchy([Task([0, 1], damping=damping), Task([2, 3])], rate_limits=box)
    found = found.solve(targets)
    plain = kin.hierarchy([Task([0, 1]), Task([2, 3])], rate_limits=box).solve(targets)
    expected = [np.linalg.norm(rows @ (plain.rates - found.rates)) for rows in (J[:2], J[2:])]
    np.testing.assert_allclose(found.damping_errors, expected, rtol=1e-9, atol=1e-12)
    assert plain.damping_errors == (0.0, 0.0)
    assert (found.status is Status.DAMPED) == (plain.status is Status.EXACT)
    assert plain.status is not Status.DAMPED


@given(SEEDS, st.integers(2, 8))
def test_without_damping_nothing_changes_by_a_bit(seed, n):
    """Levels are lexicographic least squares of their rows, as without this argument."""
    rng = np.random.default_rng(seed)
    J, v, d = of_rank(rng, 3, n, min(3, n)), rng.normal(size=3), rng.normal(size=n)
    levels = [Task([0], damping=0.0), Task([1, 2], damping=0.0), Task.joints(damping=0.0)]
    found = mechanism(J).hierarchy(levels, rate_limits=(-0.5, 0.5)).solve([v[:1], v[1:], d])
    expected = lexicographic_least_squares(
        [(J[:1], v[:1]), (J[1:], v[1:]), (np.eye(n), d)], -0.5, 0.5
    )
    np.testing.assert_array_equal(found.rates, expected.x)


@given(SEEDS, st.floats(0.01, 1.0))
def test_an_interval_holds_whether_the_level_after_it_is_damped_or_not(seed, damping):
    rng = np.random.default_rng(seed)
    J, low, v = of_rank(rng, 3, 4, 3), rng.normal(size=1), rng.normal(size=2)
    levels = [Task([0], interval=True), Task([1, 2], damping=damping), Task([1, 2])]
    found = mechanism(J).hierarchy(levels).solve([(low, low + 0.1), v, v])
    np.testing.assert_allclose(found.residuals[0], 0.0, atol=1e-12)
    # The level after it wants the same without damping, but has nothing left to move.
    np.testing.assert_allclose(found.residuals[2], found.residuals[1], atol=1e-12)
    assert found.damping_errors[1] > 0.0


@given(SEEDS, st.floats(0.01, 1.0))
def test_an_interval_that_holds_nothing_back_changes_no_damping(seed, damping):
    rng = np.random.default_rng(seed)
    J, v = of_rank(rng, 3, 4, 3), rng.normal(size=2)
    kin, damped = mechanism(J), Task([1, 2], damping=damping)
    found = kin.hierarchy([Task([0], interval=True), damped])([(-99.0, 99.0), v])
    np.testing.assert_allclose(found, kin.hierarchy([damped])([v]), rtol=0, atol=1e-12)


def test_a_solution_says_its_status_its_active_limits_and_what_damping_costs():
    kin = ConstrainedSystem(np.eye(3), None, [0, 1, 2]).with_failures(locked=[0]).kinematics()
    levels = [Task([1], damping=0.1), Task([2])]
    limits = (-2.0, np.array([9.0, 9.0, 0.5]))
    found = kin.hierarchy(levels, rate_limits=limits).solve([[1.01], [0.7]])
    assert str(found) == (
        "Damping makes the major task inexact: see the residual, or set damping=0. "
        "At the upper limit: actuator 2. Damping costs level 1 0.01."
    )
    plain = kin.hierarchy([Task([1]), Task([2])]).solve([[1.0], [0.7]])
    assert str(plain) == "The major task is met exactly."


def test_the_largest_damping_of_a_level_counts():
    kin = mechanism(np.eye(2))
    for dampings in ((0.5, 0.1), (0.0, 0.5)):
        tasks = [Task([row], damping=each) for row, each in enumerate(dampings)]
        rates = kin.hierarchy([tasks])([[[1.0], [1.0]]])
        np.testing.assert_allclose(rates, [0.8, 0.8], atol=1e-12)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"damping": -0.1}, "damping must"),
        ({"interval": True, "damping": 0.1}, "damping must be 0"),
    ],
)
def test_damping_that_has_no_meaning_is_refused(arguments, said):
    with pytest.raises(ValueError, match=said):
        Task([0], **arguments)
