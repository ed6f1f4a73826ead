"""The solver of levels under bounds: against enumeration and interior points, and by hand."""

import numpy as np
import pytest

from tests.kernels.batches import (
    Batch,
    assert_alike,
    enumerated,
    kernel,
    one,
    random_batch,
    starts,
    times,
    unlimited,
)
from tests.lexicographic_oracles import by_interior_point, certificate
from tests.lexicographic_problems import random_problem

INF = np.inf
SHAPES = [
    (1, (1, 2)),
    (2, (1, 2)),
    (2, (3, 2, 1)),
    (3, (2, 2)),
    (3, (1, 4, 2)),
    (4, (2, 3)),
    (4, (1, 2, 2)),
    (5, (3, 3)),
    (5, (2, 1, 2)),
]


def assert_every_row_is_met(batch: Batch, x: np.ndarray) -> None:
    """Where x meets all, also those that are 1e8 times as light as others of their level."""
    met = batch.with_levels(*((A, times(A, x)) for A, _ in batch.levels))
    found = kernel(met)
    for A, b in met.levels:
        size = np.linalg.norm(A, axis=2) * (1 + np.linalg.norm(x, axis=1, keepdims=True))
        assert (abs(times(A, found.x) - b) <= 1e-5 * size)[found.gap > 10].all()


def worst(batch: Batch, k: int, x: np.ndarray) -> float:
    """Of the conditions of an optimum, of problem k."""
    levels = [(A[k], b[k]) for A, b in batch.levels]
    return certificate(levels, batch.lower[k], batch.upper[k], x[k]).worst


def small_problems(seed: int, count: int, heavy: int) -> None:
    """So many of each shape against enumeration, and of those whose rows have other weights."""
    rng = np.random.default_rng(seed)
    for n, rows in SHAPES:
        batch = random_batch(rng, count, n, rows)
        known = enumerated(batch)
        for found in starts(rng, batch):
            assert found.ended.all()
            assert_alike(batch, found.x, known)
        batch = random_batch(rng, heavy, n, rows, heavy=True)
        clear = np.flatnonzero(enumerated(batch).gap > 100).tolist()
        for found in starts(rng, batch):
            assert found.ended.all()
            assert max((worst(batch, k, found.x) for k in clear), default=0.0) < 1e-6
        assert_every_row_is_met(unlimited(batch), rng.normal(size=(heavy, n)))


# Against oracles.


def test_every_active_set_tried_finds_no_better_answer():
    small_problems(0, 40, 6)


@pytest.mark.long
def test_every_active_set_tried_finds_no_better_answer_in_10_000_problems():
    for seed in range(1, 11):
        small_problems(seed, 100, 12)


def many_unknowns(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    for n in rng.integers(6, 26, count):
        batch = random_batch(rng, 2, n, rng.integers(1, n, 3).tolist())
        for found in starts(rng, batch):
            assert found.ended.all()
            assert max(worst(batch, k, found.x) for k in range(2)) < 1e-9


def test_the_conditions_of_an_optimum_hold_in_many_unknowns():
    many_unknowns(0, 20)


@pytest.mark.long
def test_the_conditions_of_an_optimum_hold_in_hundreds_with_many_unknowns():
    many_unknowns(1, 300)


def interior(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    kinds = ["any rank", "redundant rows", "dependent levels"]
    problem = random_problem(rng, n, kinds, reach=float(rng.choice([0.5, 5.0])))
    batch = one(problem.levels, problem.lower, problem.upper)
    x = by_interior_point(problem.levels, problem.lower, problem.upper)
    for found in starts(rng, batch):
        np.testing.assert_allclose(found.x[0], x, rtol=0, atol=1e-7 * (1 + abs(x).max()))


def test_interior_points_find_no_better_answer():
    for seed in range(24):
        interior(seed, 6 + seed % 5)


@pytest.mark.long
def test_interior_points_find_no_better_answer_in_hundreds():
    for seed in range(24, 324):
        interior(seed, 6 + seed % 20)


# Starts.


def test_a_warm_start_at_a_vertex_is_left():
    """Round-off of a level that is met there holds no bound: 1 of 3,000 was left a vertex off."""
    rng, shape = np.random.default_rng(0), (20_000, 4)
    side = rng.choice([-1, 1], shape)
    lower, upper = -rng.uniform(0.1, 1, shape), rng.uniform(0.1, 1, shape)
    A, other = rng.normal(size=(20_000, 2, 4)), rng.normal(size=(20_000, 4, 4))
    vertex = np.where(side > 0, upper, lower)
    levels = [(A, times(A, vertex)), (other, rng.normal(size=shape))]
    batch = Batch(levels, lower, upper)
    warm, cold = kernel(batch, start=(vertex, side)), kernel(batch)
    np.testing.assert_allclose(warm.x, cold.x, rtol=0, atol=1e-6)
    assert (abs(cold.x - vertex).max(axis=1) > 1e-3).mean() > 0.3


def test_no_bound_is_held_by_a_direction_that_counts_as_zero():
    """The level asks x_1 beyond its bound; x_3, of which it says nothing but round-off, is free.

    What counts as zero, 7e-12 of the size, turns what the level leaves by 1e-9: towards x_1.
    """
    A = [[0.0, 1.0, 0.0], [5e-3, 0.0, 5e-12], [0.0, 0.0, 7e-12]]
    batch = one([(A, [1.0, -1.0, 0.0])], [0.0, -INF, -3.0], [3.0, INF, 3.0])
    for third in (-3.0, 0.5, 3.0):
        start = np.array([[0.0, 1.0, third]]), np.array([[-1, 0, np.sign(third)]], np.int8)
        found = kernel(batch, start=start)
        np.testing.assert_allclose(found.x, [[0.0, 1.0, 0.0]], atol=1e-12)
        assert found.gap > 1.0


def test_a_bound_that_is_no_longer_there_is_no_start():
    batch = one([(np.eye(2), [3.0, 4.0])], [-INF, -INF], [INF, 1.0])
    for side in (-1, 1):
        found = kernel(batch, start=(np.full((1, 2), 2.0), np.full((1, 2), side)))
        np.testing.assert_allclose(found.x, [[3.0, 1.0]], rtol=1e-15)
        assert found.state.tolist() == [[0, 1]]


# By hand.


@pytest.mark.parametrize(
    ("levels", "lower", "upper", "x"),
    [
        ([], [-1, 1, -INF], [1, 2, -3], [0, 1, -3]),  # no levels: the nearest to zero
        ([(np.zeros((0, 2)), []), ([[1, 1]], [2])], [-9, -9], [9, 9], [1, 1]),  # no rows
        ([(np.zeros((2, 2)), [7, 7]), ([[1, 1]], [2])], [-9, -9], [9, 0.5], [1.5, 0.5]),
        ([([[2.0]], [3]), ([[1.0]], [0])], [-INF], [INF], [1.5]),
        ([([[2.0], [1.0]], [3, 0])], [-INF], [1.125], [1.125]),  # 1.2 without
        ([(np.eye(3), [5, 6, 7])], [1, 2, 3], [1, 2, 3], [1, 2, 3]),
        ([([[1, 1, 0]], [3]), ([[1, -1, 0]], [0])], [-INF, -INF, 0.5], [1, INF, INF], [1, 2, 0.5]),
        ([(1e100 * np.eye(2), [3e100, -3e100])], [-1, -INF], [1, INF], [1, -3]),
        ([(np.eye(2), [3e100, -3e100])], [-1e100, -INF], [1e100, INF], [1e100, -3e100]),
        (
            [([[1e-200, 0]], [3e-200]), (np.eye(2), [1, 1])],
            [-9, -9],
            [9, 9],
            [1, 1],
        ),  # as good as zero
        ([([[1, 5e-324]], [1])], [-9, -9], [9, 9], [1, 0]),
    ],
)
def test_answers_known_by_hand(levels, lower, upper, x):
    batch = one(levels, lower, upper)
    far = np.full((1, len(x)), 1e9), np.zeros((1, len(x)))
    for found in (kernel(batch), kernel(batch, start=far)):  # no round-off of 1e9 is left
        assert found.ended.all()
        np.testing.assert_allclose(found.x, [x], rtol=1e-14, atol=1e-14)


def test_what_is_below_1e_150_is_kept_within_bounds_and_else_counts_as_zero():
    for tiny in (5e-324, 1e-310, 1e-200):
        batch = one([([[1, 2]], [3 * tiny]), (np.eye(2), [tiny, 9 * tiny])], [-INF, 0], [tiny] * 2)
        for found in starts(np.random.default_rng(0), batch):
            assert found.ended.all()
            assert abs(found.x).max() < 1e-12  # from 1e3


@pytest.mark.parametrize("n", [3, 8, 20])
def test_vertices_where_many_bounds_meet_are_found_and_left(n):
    """Small integers: levels whose optimum is at a corner, repeated rows, ties everywhere."""
    rng = np.random.default_rng(n)
    lower, upper = -np.ones((10, n)), rng.integers(0, 2, (10, n)).astype(float)
    A, B = (rng.integers(-1, 2, (10, n, n)).astype(float) for _ in range(2))
    A[:, n // 2 :] = A[:, :1]
    corner = np.where(rng.random((10, n)) < 0.5, lower, upper)
    batch = Batch([(A, times(A, corner)), (B, 5 * times(B, corner))], lower, upper)
    for found in starts(rng, batch):
        assert found.ended.all()
        assert found.steps.max() < 10 * n
        assert max(worst(batch, k, found.x) for k in range(10)) < 1e-9
