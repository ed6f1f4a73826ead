"""The dual active set finds the optimum of the lexicographic solver, or leaves it to that one."""

from collections import Counter
from typing import Any

import numpy as np
import pytest

from prioritized import lexicographic_least_squares, velocity_mapping
from prioritized._mapping.limited import Limiting, optimum
from prioritized._solver.packed import solve

KINDS = ("feasible", "far", "redundant", "fixed", "touching", "infinite", "fast", "at zero")


def random_levels(kind: str, rng: np.random.Generator) -> tuple[list[Any], Any, Any]:
    """One to three levels of 2 to 9 unknowns, all but the last within reach unless `far`."""
    n, count = int(rng.integers(2, 10)), int(rng.integers(1, 4))
    rows = rng.integers(1, 4, size=count)
    if rng.random() < 0.5:
        rows[-1] = n + rng.integers(0, 3)
    matrices = [rng.normal(size=(k, n)) for k in rows]
    inside, some = rng.uniform(-0.7, 0.7, size=n), rng.random((2, n)) < 0.4
    lower, upper = -np.ones(n), np.ones(n)
    if kind == "redundant":
        matrices[0] = np.vstack([matrices[0], -2.0 * matrices[0][0]])
    if kind == "fixed":
        lower[0] = upper[0] = inside[0] if rng.random() < 0.7 else 0.3
    if kind == "touching":
        inside = np.where(some[0], np.sign(inside), inside)
    if kind == "infinite":
        lower[some[0]], upper[some[1]] = -np.inf, np.inf
    if kind == "at zero":
        lower[some[0]], inside = 0.0, abs(inside)
    targets = [A @ (rng.uniform(-4.0, 4.0, size=n) if kind == "far" else inside) for A in matrices]
    if kind != "touching":
        targets[-1] = targets[-1] + 3.0 * rng.normal(size=len(targets[-1]))
    if kind == "fast":
        targets[-1] = targets[-1] * 10.0 ** rng.integers(1, 7)
    return list(zip(matrices, targets, strict=True)), lower, upper


def compare(kind: str, seed: int) -> bool:
    """Whether the dual method answered; the other one must say the same."""
    levels, lower, upper = random_levels(kind, np.random.default_rng(seed))
    found = lexicographic_least_squares(levels, lower, upper)
    other = solve(found.packed)
    assert other.ended[0]
    np.testing.assert_allclose(found.x, other.x[0], rtol=0, atol=1e-11 * (1 + abs(found.x).max()))
    np.testing.assert_array_equal(found.active, found.packed.at_bounds(other.x)[0])
    again = lexicographic_least_squares(levels, lower, upper, start=found)
    np.testing.assert_allclose(again.x, found.x, rtol=0, atol=1e-11 * (1 + abs(found.x).max()))
    assert other.gap is not None
    assert found.gap == other.gap[0]
    return found.point.gap is None


@pytest.mark.parametrize("kind", KINDS)
def test_levels_within_limits_have_one_optimum_whichever_method_finds_it(kind):
    assert sum(compare(kind, seed) for seed in range(60)) > 10


@pytest.mark.long
@pytest.mark.parametrize("kind", KINDS)
def test_ten_thousand_problems_have_the_optimum_of_the_lexicographic_solver(kind):
    answered = Counter(compare(kind, 1000 + seed) for seed in range(1250))
    assert answered[True] > 300


@pytest.mark.parametrize("weights", ["diagonal", "full"])
def test_problem_1_within_limits_is_its_levels_within_limits(weights):
    rng = np.random.default_rng(5)
    held = 0
    for _ in range(40):
        n, p = int(rng.integers(4, 9)), int(rng.integers(1, 4))
        J, inside = rng.normal(size=(6, n)), rng.uniform(-0.7, 0.7, size=n)
        W1 = rng.uniform(0.5, 2.0, size=n) if weights == "diagonal" else rng.normal(size=(n, n))
        W2, limit = rng.uniform(0.5, 2.0, size=6 - p), np.ones(n)
        limit[0] = np.inf if rng.random() < 0.3 else 0.2
        box = -limit, limit
        mapping = velocity_mapping(J, list(range(p)), None, W1, W2, rate_limits=box)
        reach = 3.0 if rng.random() < 0.3 else 1.0
        v, joint, secondary = reach * J[:p] @ inside, 2.0 * rng.normal(size=n), np.ones(6 - p)
        given, without = (
            np.concatenate([v, joint, secondary]),
            velocity_mapping(J, list(range(p)), None, W1, W2)(v, joint, secondary),
        )
        best = optimum(mapping.levels, given, without, Limiting(box), mapping.tolerance)
        found = mapping.solve(v, joint, secondary)
        scale = 1.0 + abs(best.x).max()
        for rates in (found.rates, mapping(v, joint, secondary)):
            np.testing.assert_allclose(rates, best.x, rtol=0, atol=1e-11 * scale)
            assert (abs(rates) <= limit).all()
        np.testing.assert_array_equal(found.active_limits, best.active)
        again = mapping.solve(v, joint, secondary, start=found)
        np.testing.assert_allclose(again.rates, found.rates, rtol=0, atol=1e-11 * scale)
        held += bool(best.active.any())
    assert held > 20


def test_a_row_that_is_met_twice_is_left_to_the_rank_decision():
    """A row equal to another but for a fraction: each step towards it, one verdict, no NaN."""
    rng = np.random.default_rng(3)
    A, limit = rng.normal(size=(2, 5)), np.full(5, 0.4)
    off, x = rng.normal(size=5), rng.uniform(-0.3, 0.3, size=5)
    methods = set()
    for exponent in np.linspace(-16, 0, 65):
        rows = np.vstack([A, A[0] + 10.0**exponent * off])
        found = lexicographic_least_squares(
            [(rows, rows @ x), (np.eye(5), np.ones(5))], -limit, limit
        )
        other = solve(found.packed)
        error = 1e-15 * 10.0**-exponent if found.point.gap is None else 0.0
        np.testing.assert_allclose(found.x, other.x[0], rtol=0, atol=1e-12 + 10.0 * error)
        methods.add(found.point.gap is None)
    assert methods == {True, False}
