"""Bounded lexicographic least squares: against enumeration, interior points, and as an attack."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prioritized import Status, lexicographic_least_squares
from prioritized._mapping.lexicographic import Solution
from tests.lexicographic_oracles import by_active_sets, by_interior_point, certificate
from tests.lexicographic_problems import Problem, problems, random_problem
from tests.profiles import examples
from tests.random_systems import SEEDS, of_rank

INF = np.inf
KINDS = ["any rank", "redundant rows", "dependent levels", "nearly singular", "zero"]


def given_rows(problem: Problem) -> dict[str, Any]:
    if problem.rows is None:
        return {}
    return dict(zip(("rows", "rows_lower", "rows_upper"), problem.rows, strict=True))


def solve(problem: Problem, **others: Any) -> Solution:
    found = lexicographic_least_squares(
        problem.levels, problem.lower, problem.upper, **given_rows(problem), **others
    )
    assert ((problem.lower <= found.x) & (found.x <= problem.upper)).all()  # exactly
    return found


def worst(problem: Problem, x: np.ndarray) -> float:
    return certificate(problem.levels, problem.lower, problem.upper, x, problem.rows).worst


def drawn(seed: int, n: int, reach: float = 3.0) -> Problem:
    """Any kinds of levels, bounds and rows."""
    rng = np.random.default_rng(seed)
    kinds = [KINDS[k] for k in rng.integers(0, len(KINDS), rng.integers(1, 4))]
    bounds = ("finite", "mixed")[rng.integers(2)]
    return random_problem(rng, n, kinds, bounds, reach, seed % 3)


@examples(60)
@given(problems(most=4))
def test_every_active_set_tried_finds_no_better_answer(problem):
    found = solve(problem)
    x = by_active_sets(problem.levels, problem.lower, problem.upper, problem.rows)
    assert found.status is Status.OPTIMAL
    np.testing.assert_allclose(found.x, x, rtol=0, atol=1e-7 * (1 + abs(x).max()))
    for (A, b), residual in zip(problem.levels, found.residuals, strict=True):
        size = float(np.linalg.norm(A) * (1 + np.linalg.norm(x)) + np.linalg.norm(b))
        np.testing.assert_allclose(residual, b - A @ x, rtol=0, atol=1e-9 * (size + 1))


@pytest.mark.long
@pytest.mark.parametrize("seed", range(60))
def test_interior_points_find_no_better_answer(seed):
    rng = np.random.default_rng(seed)
    kinds = ["any rank", "redundant rows", "dependent levels"]
    problem = random_problem(rng, 12, kinds, reach=float(rng.choice([0.5, 5.0])), rows=seed % 3)
    x = by_interior_point(problem.levels, problem.lower, problem.upper, problem.rows)
    np.testing.assert_allclose(solve(problem).x, x, rtol=0, atol=1e-7 * (1 + abs(x).max()))


@pytest.mark.parametrize("n", [2, 5, 9, 17])
def test_the_conditions_of_an_optimum_hold_at_every_level(n):
    for seed in range(25):
        for reach in (0.3, 3.0, 100.0):
            problem = drawn(seed, n, reach)
            found = solve(problem)
            assert found.status is Status.OPTIMAL
            assert worst(problem, found.x) < 1e-9


@pytest.mark.long
@given(st.integers(1, 30), SEEDS, st.sampled_from([0.3, 0.9, 3.0, 100.0]))
@examples(3000)
def test_the_conditions_hold_in_thousands_of_problems(n, seed, reach):
    problem = drawn(seed, n, reach)
    found = solve(problem)
    assert found.status is Status.OPTIMAL
    assert worst(problem, found.x) < 1e-9


@given(SEEDS, st.integers(2, 8))
def test_a_level_never_sees_the_levels_after_it(seed, n):
    """Its residual is the same whatever follows; the last digits of 1e-9 of its terms aside."""
    rng = np.random.default_rng(seed)
    problem = drawn(seed, n)
    first = solve(problem).residuals[0]
    size = sum(np.linalg.norm(part) for part in problem.levels[0]) * (1 + n)
    for _ in range(3):
        later = [(rng.normal(size=(3, n)) * 10.0 ** rng.integers(-3, 4), rng.normal(size=3))] * 2
        other = Problem((problem.levels[0], *later), problem.lower, problem.upper, problem.rows)
        np.testing.assert_allclose(solve(other).residuals[0], first, rtol=0, atol=1e-9 * size)


def test_ties_are_broken_by_the_least_norm_or_by_the_metric():
    """By hand: of x + y = 2 the nearest to zero is (1, 1), with weights 1 and 2 (1.6, 0.4)."""
    level = [(np.ones((1, 2)), np.array([2.0]))]
    np.testing.assert_allclose(lexicographic_least_squares(level).x, [1, 1], atol=1e-15)
    of_metric = lexicographic_least_squares(level, tie_metric=[1.0, 2.0])
    np.testing.assert_allclose(of_metric.x, [1.6, 0.4], atol=1e-15)
    held = lexicographic_least_squares(level, upper=[1.5, INF], tie_metric=[1.0, 2.0])
    np.testing.assert_allclose(held.x, [1.5, 0.5], atol=1e-15)
    assert held.active.tolist() == [1, 0]


@given(SEEDS, st.integers(1, 3))
@examples(30)
def test_an_interval_at_a_later_level_is_met_as_nearly_as_the_levels_before_let(seed, n):
    """Enumeration with the values of its rows as unknowns: |G x - s| least, s in the interval."""
    rng = np.random.default_rng(seed)
    A, G = rng.normal(size=(1, n)), rng.normal(size=(2, n))
    lower, upper, low = -rng.uniform(0.1, 1, n), rng.uniform(0.1, 1, n), rng.normal(size=2)
    high = low + rng.uniform(0, 0.5, 2)
    found = lexicographic_least_squares([(A, [0.1]), (G, low, high)], lower, upper)
    lacking = np.clip(G @ found.x, low, high) - G @ found.x
    np.testing.assert_allclose(found.residuals[1], lacking, atol=1e-12)
    levels = [
        (np.hstack([A, np.zeros((1, 2))]), np.array([0.1])),
        (np.hstack([G, -np.eye(2)]), np.zeros(2)),
    ]
    x = by_active_sets(levels, np.append(lower, low), np.append(upper, high))
    np.testing.assert_allclose(abs(A @ (found.x - x[:n])), 0, atol=1e-9)
    np.testing.assert_allclose(lacking, x[n:] - G @ x[:n], atol=1e-8)


def proves(found: Solution, G: Any, low: Any, high: Any, lower: Any, upper: Any) -> bool:
    """Whether y . (G x - s) > 0 for all x between the bounds and s between the limits."""
    assert found.certificate is not None
    y = found.certificate[: len(G)]
    y = np.where(abs(y) > 1e-12 * abs(y).max(), y, 0.0)
    a = y @ G
    a = np.where(abs(a) > 1e-12 * np.abs(y).dot(np.abs(G)), a, 0.0)
    with np.errstate(invalid="ignore"):
        parts = np.where(a > 0, a * lower, np.where(a < 0, a * upper, 0.0))
        sides = np.where(y > 0, -y * high, np.where(y < 0, -y * low, 0.0))
    return bool(parts.sum() + sides.sum() > 0)


@given(SEEDS, st.integers(1, 8))
def test_infeasible_rows_come_with_a_proof_and_the_bounds_still_hold(seed, n):
    """By interval arithmetic over the box; no exception, no NaN."""
    rng = np.random.default_rng(seed)
    G = rng.normal(size=(3, n))
    lower, upper = -rng.uniform(0.1, 1, n), rng.uniform(0.1, 1, n)
    beyond = np.abs(G) @ np.maximum(-lower, upper)
    low = np.array([beyond[0] + rng.uniform(0.01, 1), -1.0, -INF])
    high = np.array([INF, 1.0, INF])
    levels = [(rng.normal(size=(2, n)), rng.normal(size=2))]
    problem = Problem(tuple(levels), lower, upper, (G, low, high))
    found = solve(problem)
    assert found.status is Status.INFEASIBLE
    assert np.isfinite(found.x).all()
    assert proves(found, G, low, high, lower, upper)


def test_feasible_rows_have_no_certificate():
    """Even where they leave one point, far below where the levels would go."""
    rows = np.array([[1.0, 1.0], [-1.0, -1.0]]), np.array([1e-9, -1e-9]), np.full(2, INF)
    target = [(np.eye(2) * [[1.0], [1e-4]], np.array([3.0, 50.0]))]
    found = solve(Problem(tuple(target), np.full(2, -INF), np.full(2, INF), rows))
    assert found.certificate is None
    assert found.status is Status.OPTIMAL
    assert abs(found.x.sum() - 1e-9) < 1e-14


def test_feasible_rows_far_below_the_optimum_without_limits_are_not_called_infeasible():
    """From 5e4, where a singular value of 1e-4 leads, to rows of size one: round-off of 5e4."""
    rng = np.random.default_rng(0)
    for _ in range(200):
        n = int(rng.integers(2, 6))
        problem = random_problem(rng, n, ["any rank", "nearly singular"], "none", 3.0, 3)
        found = solve(problem)
        assert found.status is Status.OPTIMAL
        assert worst(problem, found.x) < 1e-9


def test_a_neighbouring_solution_gives_the_same_answer_in_fewer_steps():
    rng, cold, warm = np.random.default_rng(0), 0, 0
    for seed in range(40):
        problem = random_problem(rng, 10, ["any rank", "any rank"], "finite", 3.0, seed % 3)
        moved = tuple((A, b + 1e-3 * rng.normal(size=len(b))) for A, b in problem.levels)
        near = Problem(moved, problem.lower, problem.upper, problem.rows)
        begun, other = solve(near, start=solve(problem)), solve(near)
        np.testing.assert_allclose(begun.x, other.x, rtol=0, atol=1e-9)
        cold, warm = cold + other.steps, warm + begun.steps
    assert warm < 0.7 * cold


def test_too_few_steps_leave_a_point_within_the_bounds_and_say_so():
    unfinished = 0
    for seed in range(20):
        problem = random_problem(np.random.default_rng(seed), 8, ["any rank"], "finite", 100.0)
        for most in range(3):
            found = solve(problem, most_steps=most)
            assert np.isfinite(found.x).all()
            assert found.steps <= most
            unfinished += found.status is Status.UNFINISHED
            if found.status is Status.OPTIMAL:
                assert worst(problem, found.x) < 1e-9
    assert unfinished > 20


def degenerate(rng: np.random.Generator, n: int) -> Problem:
    """Repeated columns, parallel rows, targets on the bounds, ties everywhere."""
    lower, upper = np.round(-rng.uniform(0, 1, n) * 2) / 2, np.round(rng.uniform(0, 1, n) * 2) / 2
    corner = np.where(rng.random(n) < 0.5, lower, upper)
    repeated = rng.normal(size=(n + 1, n))
    repeated[:, rng.integers(0, n, n // 2)] = repeated[:, :1]
    matrices = (
        repeated,
        np.outer(rng.normal(size=n), rng.integers(-1, 2, n)),
        np.eye(n)[rng.integers(0, n, n + 2)],
        rng.integers(-1, 2, (n, n)).astype(float),
        np.zeros((2, n)),
    )
    levels = [matrices[k] for k in rng.integers(0, len(matrices), 3)]
    return Problem(
        tuple((A, A @ corner if rng.random() < 0.5 else rng.normal(size=len(A))) for A in levels),
        lower,
        upper,
    )


@pytest.mark.parametrize("n", [2, 6, 15, 30])
def test_degenerate_problems_end_and_are_optimal(n):
    """A bound released and taken again for ever would end as UNFINISHED."""
    rng = np.random.default_rng(n)
    for _ in range(60):
        problem = degenerate(rng, n)
        found = solve(problem)
        assert found.status is Status.OPTIMAL
        assert found.steps <= 4 * (n + 1) * 4
        assert worst(problem, found.x) < 1e-9


@pytest.mark.parametrize("n", [4, 10])
def test_klee_mintys_cube_does_not_take_its_path(n):
    """Rows 4 x_1 + ... + x_k <= 5^k, the largest sum as the level: 2^n corners for a bad pivot."""
    G = np.array(
        [[2.0 ** (i - j + 1) if j < i else float(i == j) for j in range(n)] for i in range(n)]
    )
    high = 5.0 ** np.arange(1, n + 1)
    cost = 2.0 ** np.arange(n - 1, -1, -1)
    bounds = np.zeros(n), np.full(n, INF)
    problem = Problem(
        (((cost[None]), np.array([2 * high[-1]])),), *bounds, (G, np.full(n, -INF), high)
    )
    found = solve(problem)
    assert found.status is Status.OPTIMAL
    assert found.steps < 20 * n
    assert cost @ found.x == pytest.approx(high[-1], rel=1e-12)


@pytest.mark.parametrize("size", [1e-100, 1e-30, 1e30, 1e100])
def test_the_answer_does_not_depend_on_the_units_of_a_level(size):
    for seed in range(20):
        problem = random_problem(
            np.random.default_rng(seed), 5, ["any rank", "dependent levels"], reach=3.0
        )
        scaled = tuple((A * size, b * size) for A, b in problem.levels)
        other = Problem(scaled, problem.lower, problem.upper)
        np.testing.assert_allclose(solve(other).x, solve(problem).x, rtol=0, atol=1e-9)


@pytest.mark.parametrize("size", [1e-50, 1e50])
def test_the_answer_scales_with_bounds_and_targets(size):
    for seed in range(20):
        problem = random_problem(
            np.random.default_rng(seed), 5, ["any rank", "any rank"], reach=3.0
        )
        scaled = tuple((A, b * size) for A, b in problem.levels)
        other = Problem(scaled, problem.lower * size, problem.upper * size)
        np.testing.assert_allclose(solve(other).x / size, solve(problem).x, rtol=0, atol=1e-9)


def test_a_bound_below_the_rank_tolerance_decides_no_rank():
    """Columns 1e-12 of the level are dependent, 1e-8 are not: its target is met or left alone."""
    for small, met in ((1e-12, False), (1e-8, True)):
        level = [(np.diag([1.0, small]), np.array([1.0, small]))]
        found = lexicographic_least_squares(level, upper=[1.0, 2.0])
        np.testing.assert_allclose(found.x, [1.0, 1.0 if met else 0.0], atol=1e-7)


def test_results_do_not_share_memory_with_arguments():
    A, b, lower = np.eye(2), np.array([2.0, 0.5]), -np.ones(2)
    found = lexicographic_least_squares([(A, b)], lower, 1.0, rows=A, rows_lower=lower)
    x, residual = found.x.copy(), found.residuals[0].copy()
    A[:], b[:], lower[:] = 7.0, 7.0, 7.0
    np.testing.assert_array_equal(found.x, x)
    np.testing.assert_array_equal(found.residuals[0], residual)
    assert found.status is Status.OPTIMAL


@pytest.mark.parametrize(
    ("named", "arguments"),
    [
        ("levels", {"levels": []}),
        ("levels[0]", {"levels": [(np.eye(2),)]}),
        ("levels[0][1]", {"levels": [(np.eye(2), [1.0])]}),
        ("levels[1][0]", {"levels": [(np.eye(2), [1, 1]), (np.eye(3), [1, 1, 1])]}),
        ("lower and upper", {"lower": 1.0, "upper": 0.0}),
        ("lower", {"lower": [np.nan, 0.0]}),
        ("lower and upper", {"upper": [1.0, 1.0, 1.0]}),
        ("rows_lower and rows_upper", {"rows": np.eye(2), "rows_lower": 1, "rows_upper": 0}),
        ("rows", {"rows_lower": 0.0}),
        ("rows", {"rows": np.eye(3)}),
        ("tie_metric", {"tie_metric": np.ones(3)}),
        ("start", {"start": 1.0}),
        ("most_steps", {"most_steps": -1}),
        ("rank_tolerance", {"rank_tolerance": 2.0}),
    ],
)
def test_wrong_input_is_named_in_one_sentence(named, arguments):
    good: dict[str, Any] = {"levels": [(np.eye(2), np.ones(2))]}
    with pytest.raises((ValueError, TypeError), match="must") as error:
        lexicographic_least_squares(**(good | arguments))
    assert str(error.value).startswith(named)
    assert "\n" not in str(error.value)


def test_bounds_that_are_equal_everywhere_are_the_answer():
    """Nothing is free: the answer is the bounds, whatever the levels."""
    rng = np.random.default_rng(0)
    for n in (1, 3, 6):
        x, A = rng.normal(size=n), of_rank(rng, 3, n, 1)
        found = lexicographic_least_squares([(A, rng.normal(size=3))], x, x)
        np.testing.assert_array_equal(found.x, x)
        assert (found.active == -1).all()
