"""Test bounded lexicographic least squares: certificates, interior points, enumeration."""

from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from prioritized import Status, lexicographic_least_squares
from prioritized._mapping.lexicographic import Solution
from tests.lexicographic_oracles import by_active_sets, by_interior_point, certificate
from tests.lexicographic_problems import KINDS, Problem, problems, random_problem
from tests.profiles import examples
from tests.random_systems import SEEDS

INF = np.inf
LONG = pytest.mark.long


def solve(problem: Problem, **others: Any) -> Solution:
    if problem.rows is not None:
        others |= dict(zip(("rows", "rows_lower", "rows_upper"), problem.rows, strict=True))
    result = lexicographic_least_squares(problem.levels, problem.lower, problem.upper, **others)
    assert ((problem.lower <= result.x) & (result.x <= problem.upper)).all()  # exactly
    return result


def worst(problem: Problem, x: np.ndarray) -> float:
    return certificate(problem.levels, problem.lower, problem.upper, x, problem.rows)


def interior(problem: Problem) -> np.ndarray:
    return by_interior_point(problem.levels, problem.lower, problem.upper, problem.rows)


def enumerated(problem: Problem) -> np.ndarray:
    x = by_active_sets(problem.levels, problem.lower, problem.upper, problem.rows)
    assume(np.isfinite(x).all())
    return x


def sample(seed: int, n: int, extent: float = 3.0) -> Problem:
    """Sample any kinds of levels, bounds and rows."""
    rng = np.random.default_rng(seed)
    kinds = [KINDS[k] for k in rng.integers(0, len(KINDS), rng.integers(1, 4))]
    bounds = ("finite", "mixed")[rng.integers(2)]
    return random_problem(rng, n, kinds, bounds, extent, seed % 3)


def assert_optimal(problem: Problem, **others: Any) -> Solution:
    result = solve(problem, **others)
    assert result.status is Status.OPTIMAL
    assert worst(problem, result.x) < 1e-9
    return result


@examples(60)
@given(problems(most=4))
def test_enumeration_of_active_sets_finds_no_better_solution(problem):
    result, x = assert_optimal(problem), enumerated(problem)
    np.testing.assert_allclose(result.x, x, rtol=0, atol=1e-7 * (1 + abs(x).max()))
    for (A, b), residual in zip(problem.levels, result.residuals, strict=True):
        size = float(np.linalg.norm(A) * (1 + np.linalg.norm(x)) + np.linalg.norm(b))
        np.testing.assert_allclose(residual, b - A @ x, rtol=0, atol=1e-9 * (size + 1))


@pytest.mark.parametrize("seeds", [range(3), pytest.param(range(3, 60), marks=LONG)])
def test_interior_points_find_no_better_solution(seeds):
    for seed in seeds:
        rng = np.random.default_rng(seed)
        kinds = ["any rank", "redundant rows", "dependent levels"]
        problem = random_problem(
            rng, 12, kinds, extent=float(rng.choice([0.5, 5.0])), rows=seed % 3
        )
        x = interior(problem)
        np.testing.assert_allclose(solve(problem).x, x, rtol=0, atol=1e-7 * (1 + abs(x).max()))


@given(st.integers(1, 30), SEEDS, st.sampled_from([0.3, 0.9, 3.0, 100.0]))
@examples(600)
def test_the_conditions_of_an_optimum_hold_at_every_level(n, seed, extent):
    assert_optimal(sample(seed, n, extent))


def test_ties_are_broken_by_the_least_norm_or_by_the_metric():
    """Check x + y = 2: the least norm is (1, 1), with weights 1 and 2 it is (1.6, 0.4)."""
    level = [(np.ones((1, 2)), np.array([2.0]))]
    np.testing.assert_allclose(lexicographic_least_squares(level).x, [1, 1], atol=1e-15)
    of_metric = lexicographic_least_squares(level, tie_metric=[1.0, 2.0])
    np.testing.assert_allclose(of_metric.x, [1.6, 0.4], atol=1e-15)
    fixed = lexicographic_least_squares(level, upper=[1.5, INF], tie_metric=[1.0, 2.0])
    np.testing.assert_allclose(fixed.x, [1.5, 0.5], atol=1e-15)
    assert fixed.active.tolist() == [1, 0]


@given(SEEDS, st.integers(1, 3))
@examples(30)
def test_a_later_interval_has_the_least_violation(seed, n):
    """Compare with enumeration over s in the interval that minimizes |G x - s|."""
    rng = np.random.default_rng(seed)
    A, G = rng.normal(size=(1, n)), rng.normal(size=(2, n))
    lower, upper, low = -rng.uniform(0.1, 1, n), rng.uniform(0.1, 1, n), rng.normal(size=2)
    high = low + rng.uniform(0, 0.5, 2)
    result = lexicographic_least_squares([(A, [0.1]), (G, low, high)], lower, upper)
    violation = np.clip(G @ result.x, low, high) - G @ result.x
    np.testing.assert_allclose(result.residuals[1], violation, atol=1e-12)
    levels = [
        (np.hstack([A, np.zeros((1, 2))]), np.array([0.1])),
        (np.hstack([G, -np.eye(2)]), np.zeros(2)),
    ]
    x = by_active_sets(levels, np.append(lower, low), np.append(upper, high))
    np.testing.assert_allclose(abs(A @ (result.x - x[:n])), 0, atol=1e-9)
    np.testing.assert_allclose(violation, x[n:] - G @ x[:n], atol=1e-8)


def proves(result: Solution, G: Any, low: Any, high: Any, lower: Any, upper: Any) -> bool:
    """Return whether y . (G x - s) > 0 for all x within the bounds and s within the limits."""
    assert result.certificate is not None
    y = result.certificate[: len(G)]
    y = np.where(abs(y) > 1e-12 * abs(y).max(), y, 0.0)
    a = y @ G
    a = np.where(abs(a) > 1e-12 * np.abs(y).dot(np.abs(G)), a, 0.0)
    with np.errstate(invalid="ignore"):
        parts = np.where(a > 0, a * lower, np.where(a < 0, a * upper, 0.0))
        sides = np.where(y > 0, -y * high, np.where(y < 0, -y * low, 0.0))
    return bool(parts.sum() + sides.sum() > 0)


@given(SEEDS, st.integers(1, 8))
def test_infeasible_rows_have_a_certificate_and_the_bounds_hold(seed, n):
    """Check the certificate by interval arithmetic over the box."""
    rng = np.random.default_rng(seed)
    G = rng.normal(size=(3, n))
    lower, upper = -rng.uniform(0.1, 1, n), rng.uniform(0.1, 1, n)
    beyond = np.abs(G) @ np.maximum(-lower, upper)
    low = np.array([beyond[0] + rng.uniform(0.01, 1), -1.0, -INF])
    high = np.array([INF, 1.0, INF])
    levels = [(rng.normal(size=(2, n)), rng.normal(size=2))]
    problem = Problem(tuple(levels), lower, upper, (G, low, high))
    result = solve(problem)
    assert result.status is Status.INFEASIBLE
    assert np.isfinite(result.x).all()
    assert proves(result, G, low, high, lower, upper)


def test_feasible_rows_are_never_reported_as_infeasible():
    """Check rows with a single feasible point, and solutions of 5e4 with rows of size one."""
    rows = np.array([[1.0, 1.0], [-1.0, -1.0]]), np.array([1e-9, -1e-9]), np.full(2, INF)
    target = [(np.eye(2) * [[1.0], [1e-4]], np.array([3.0, 50.0]))]
    result = solve(Problem(tuple(target), np.full(2, -INF), np.full(2, INF), rows))
    assert result.certificate is None and result.status is Status.OPTIMAL
    assert abs(result.x.sum() - 1e-9) < 1e-14
    rng = np.random.default_rng(0)
    for _ in range(100):
        n = int(rng.integers(2, 6))
        assert_optimal(random_problem(rng, n, ["any rank", "nearly singular"], "none", 3.0, 3))


@pytest.mark.parametrize("n", [4, 10])
def test_klee_mintys_cube_needs_few_steps(n):
    """Check rows 4 x_1 + ... + x_k <= 5^k, the largest sum: 2^n corners for a bad pivot rule."""
    G = np.array(
        [[2.0 ** (i - j + 1) if j < i else float(i == j) for j in range(n)] for i in range(n)]
    )
    high = 5.0 ** np.arange(1, n + 1)
    cost = 2.0 ** np.arange(n - 1, -1, -1)
    bounds = np.zeros(n), np.full(n, INF)
    problem = Problem(
        (((cost[None]), np.array([2 * high[-1]])),), *bounds, (G, np.full(n, -INF), high)
    )
    result = solve(problem)
    assert result.status is Status.OPTIMAL
    assert result.steps < 20 * n
    assert cost @ result.x == pytest.approx(high[-1], rel=1e-12)


@examples(60)
@given(problems(most=4))
def test_the_oracles_agree_and_both_solutions_are_certified(problem):
    """Compare enumeration with interior points, and check the optimality conditions of both."""
    x = enumerated(problem)
    assert worst(problem, x) < 1e-11
    try:
        other = interior(problem)
    except RuntimeError:  # Clarabel fails for some nearly singular problems
        assume(not [s for A, _ in problem.levels for s in np.linalg.svd(A)[1] if 1e-9 < s < 1e-3])
        raise
    assert worst(problem, other) < 1e-11
    np.testing.assert_allclose(other, x, rtol=0, atol=1e-8 * (1 + abs(x).max()))
