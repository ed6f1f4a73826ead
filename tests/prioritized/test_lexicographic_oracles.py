"""The three oracles of bounded lexicographic least squares against each other."""

import numpy as np
import pytest
from hypothesis import assume, given
from scipy.optimize import lsq_linear

from tests.lexicographic_oracles import by_active_sets, by_interior_point, certificate
from tests.lexicographic_problems import Problem, problems, random_problem
from tests.profiles import examples

INF = np.inf


def solved(problem: Problem) -> np.ndarray:
    return by_active_sets(problem.levels, problem.lower, problem.upper, problem.rows)


def worst(problem: Problem, x: np.ndarray) -> float:
    return certificate(problem.levels, problem.lower, problem.upper, x, problem.rows).worst


@examples(60)
@given(problems(most=4))
def test_the_oracles_agree_and_both_answers_are_certified(problem):
    """Enumeration and interior points know nothing of each other; the conditions prove both."""
    x = solved(problem)
    assert worst(problem, x) < 1e-11
    try:
        other = by_interior_point(problem.levels, problem.lower, problem.upper, problem.rows)
    except RuntimeError:  # Clarabel gives up on some that are nearly singular
        singular = [s for A, _ in problem.levels for s in np.linalg.svd(A)[1] if 1e-9 < s < 1e-3]
        assume(not singular)
        raise
    assert worst(problem, other) < 1e-11
    np.testing.assert_allclose(other, x, rtol=0, atol=1e-8 * (1 + abs(x).max()))


@pytest.mark.parametrize("seed", range(4))
def test_the_oracles_agree_in_six_unknowns(seed):
    problem = random_problem(np.random.default_rng(seed), 6, ["any rank", "dependent levels"])
    x = by_interior_point(problem.levels, problem.lower, problem.upper)
    np.testing.assert_allclose(solved(problem), x, atol=1e-9)


@pytest.mark.parametrize("seed", range(10))
def test_interior_points_are_certified_in_many_unknowns(seed):
    rng = np.random.default_rng(seed)
    kinds = ["any rank", "redundant rows", "dependent levels"]
    problem = random_problem(rng, 20, kinds, reach=5.0, rows=2)
    x = by_interior_point(problem.levels, problem.lower, problem.upper, problem.rows)
    assert worst(problem, x) < 1e-11


@pytest.mark.parametrize("seed", range(10))
def test_the_first_level_is_least_squares_with_bounds(seed):
    """SciPy's own solver of one level reaches the same residual."""
    problem = random_problem(np.random.default_rng(seed), 4, ["any rank"], "finite", reach=3.0)
    ((A, b),) = problem.levels
    known = lsq_linear(A, b, (problem.lower, problem.upper), method="bvls", tol=1e-14)
    residual = np.linalg.norm(A @ solved(problem) - b)
    assert residual == pytest.approx(np.linalg.norm(A @ known.x - b), abs=1e-9)


def test_an_answer_known_by_hand():
    """Of x + y = 3 with x <= 1; x - y = 0 comes nearest at x = 1, y = 2; z is least."""
    sum_, difference = np.array([[1.0, 1.0, 0.0]]), np.array([[1.0, -1.0, 0.0]])
    levels = [(sum_, np.array([3.0])), (difference, np.array([0.0]))]
    lower, upper = np.array([-INF, -INF, 0.5]), np.array([1.0, INF, INF])
    for oracle in (by_active_sets, by_interior_point):
        np.testing.assert_allclose(oracle(levels, lower, upper), [1, 2, 0.5], atol=1e-12)


def test_a_row_binds_like_a_bound():
    """The nearest point of the line x + y = 1 to (2, 0), with x <= 1.2 as a row."""
    levels = [(np.eye(2), np.array([2.0, 0.0]))]
    rows = np.array([[1.0, 1.0], [2.0, 0.0]]), np.array([1.0, -INF]), np.array([1.0, 2.4])
    free = np.full(2, -INF), np.full(2, INF)
    for oracle in (by_active_sets, by_interior_point):
        np.testing.assert_allclose(oracle(levels, *free, rows), [1.2, -0.2], atol=1e-12)


@given(problems(most=3))
def test_no_other_x_is_certified(problem):
    """A step from the answer fails: beyond a limit, or in a level's value, or in the norm."""
    x = solved(problem)
    for step in (*np.eye(len(x)), *-np.eye(len(x))):
        moved = x + 1e-2 * (1 + np.linalg.norm(x)) * step
        seen = [np.linalg.norm(A @ step) for A, _ in problem.levels]
        assume(all(s < 1e-9 or s > 1e-2 for s in seen))  # s^2 d is all that shows
        assert worst(problem, moved) > 1e-9


def test_a_lower_level_may_not_pay_with_a_higher_one():
    """The best of level 2 alone, and the best of the sum of both, fail at level 1."""
    A1, A2 = np.array([[1.0, 0.0]]), np.array([[1.0, 1.0]])
    levels, bounds = [(A1, np.ones(1)), (A2, np.zeros(1))], (np.full(2, -0.5), np.full(2, 2.0))
    found = certificate(levels, *bounds, by_active_sets(levels, *bounds))
    assert found.worst < 1e-12
    compromise = lsq_linear(np.vstack([A1, A2]), np.array([1.0, 0.0]), bounds).x
    for wrong in (np.zeros(2), compromise):
        assert certificate(levels, *bounds, wrong).stationarity[0] > 1e-2


@pytest.mark.parametrize("seed", range(5))
def test_a_level_that_repeats_an_earlier_one_changes_nothing(seed):
    """What is left of it is round-off, whose directions mean nothing."""
    rng = np.random.default_rng(seed)
    A, B = rng.normal(size=(2, 4)), rng.normal(size=(1, 4))
    first, last = (A, rng.normal(size=2)), (B, np.ones(1))
    again = (rng.normal(size=(1, 2)) @ A, np.array([7.0]))
    free = np.full(4, -INF), np.full(4, INF)
    for oracle in (by_active_sets, by_interior_point):
        x = oracle([first, last], *free)
        np.testing.assert_allclose(oracle([first, again, last], *free), x, atol=1e-9)


def test_rows_that_contradict_the_bounds_are_refused():
    rows = np.ones((1, 2)), np.array([5.0]), np.array([6.0])
    levels, bounds = [(np.eye(2), np.zeros(2))], (np.zeros(2), np.ones(2))
    with pytest.raises(ValueError, match="feasible"):
        by_active_sets(levels, *bounds, rows)
    with pytest.raises(RuntimeError, match="Infeasible"):
        by_interior_point(levels, *bounds, rows)


def test_far_targets_are_held_back_by_the_bounds_and_near_ones_are_met():
    """What the generator says of itself, over 20 problems of each sort."""
    rng = np.random.default_rng(0)
    for _ in range(20):
        far = random_problem(rng, 3, ["any rank"], "finite", reach=100.0)
        x = solved(far)
        assert ((x <= far.lower + 1e-9) | (x >= far.upper - 1e-9)).any()
        near = random_problem(rng, 3, ["any rank", "any rank"], "finite", reach=0.9)
        A, b = near.levels[0]
        assert np.linalg.norm(A @ solved(near) - b) < 1e-9
