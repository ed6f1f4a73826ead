"""Test the lexicographic solver against oracles, exact cases, and invariances."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import pytest

from kernels import ffi, lib, pointer
from tests.lexicographic_oracles import RANK, Known, certificate, enumerated, sizes, times

INF = np.inf
LONG = pytest.mark.long


@dataclass(frozen=True)
class Batch:
    """Batch of B problems of one shape: levels A (B, k, n), b (B, k), and bounds (B, n)."""

    levels: Sequence[tuple[np.ndarray, np.ndarray]]
    lower: np.ndarray
    upper: np.ndarray

    def residuals(self, k: int, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return |A_k x - b_k|, and the size of its terms, (B,)."""
        A, b = self.levels[k]
        size = sizes(A) * (1 + np.linalg.norm(x, axis=1)) + np.linalg.norm(b, axis=1)
        return np.linalg.norm(times(A, x) - b, axis=1), size


def one(levels: Any, lower: Any, upper: Any) -> Batch:
    """Return a single problem."""
    made = [(np.array(A, float)[None], np.array(b, float)[None]) for A, b in levels]
    return Batch(made, np.array(lower, float)[None], np.array(upper, float)[None])


class KernelOutput(NamedTuple):
    """Outputs of the kernel."""

    x: np.ndarray
    state: np.ndarray
    steps: np.ndarray
    ended: np.ndarray
    gap: np.ndarray
    ranks: np.ndarray


def kernel(
    batch: Batch,
    *,
    start: tuple[np.ndarray, np.ndarray] | None = None,
    weight: np.ndarray | None = None,
    wanted: np.ndarray | None = None,
    combined: bool = False,
    damping: Sequence[float] | None = None,
    most: int = 1000,
    fill: float = 0.0,
) -> KernelOutput:
    """Solve a batch: cold, or warm from (x, state).

    |x| is minimized last, before it |weight (x - wanted)| if given; `fill` fills the workspace.
    """
    count, n = len(batch.levels[0][0]) if batch.levels else len(batch.lower), batch.lower.shape[1]
    A = np.concatenate([np.zeros((count, 0, n)), *(A for A, _ in batch.levels)], axis=1)
    b = np.concatenate([np.zeros((count, 0)), *(b for _, b in batch.levels)], axis=1)
    scales = np.array([sizes(rows) for rows, _ in batch.levels]).reshape(-1, count).T.copy()
    given = A, b, scales, np.array(np.stack([batch.lower, batch.upper], axis=1), float, order="C")
    before = [each.copy() for each in given]
    x, state = np.full((count, n), np.nan), np.full((count, n), 7, np.int8)
    if start is not None:
        x, state = np.array(start[0], float), np.array(start[1], np.int8)
    ends = np.cumsum([len(b[0]) for _, b in batch.levels]).astype(np.int32)
    damped = ffi.NULL if damping is None else pointer(np.array(damping, float))
    weighed = ffi.NULL if weight is None else pointer(weight)
    goal = np.zeros((count, n)) if wanted is None else np.ascontiguousarray(wanted, float)
    shape = count, n, len(batch.levels), count, len(batch.lower), most, start is not None, combined
    fields = (*shape, RANK, pointer(ends), damped, weighed)
    problem = ffi.new("lexicographic_problem *", fields)
    work = np.full(lib.lexicographic_room(problem), fill)
    report = np.zeros((count, 4))
    made = goal, work, x, state, report
    ranks = np.append(np.zeros(scales.size, np.int32), np.int32(-9))
    lib.lexicographic_solve(problem, *map(pointer, (*given, *made, ranks)))
    assert ranks[-1] == -9, "more ranks than levels"
    for each, copy in zip(given, before, strict=True):
        assert each.tobytes() == copy.tobytes(), "an input was written"
    assert ((batch.lower <= x) & (x <= batch.upper)).all(), "a bound is violated"
    for side, bound in ((-1, batch.lower), (1, batch.upper)):
        at = state == side
        assert (x[at] == np.broadcast_to(bound, x.shape)[at]).all(), (
            "x differs from an active bound"
        )
    steps, ended = report[:, 0].astype(int), report[:, 1] > 0
    gap = report[:, 2:].min(axis=1)
    return KernelOutput(x, state, steps, ended, gap, ranks[:-1].reshape(scales.shape))


def unlimited(batch: Batch) -> Batch:
    """Return the same problems without bounds."""
    side = np.full(batch.lower.shape, INF)
    return Batch(batch.levels, -side, side)


def starts(rng: np.random.Generator, batch: Batch) -> list[KernelOutput]:
    """Yield solutions from a cold start, and warm from unbounded optima, far points, vertices."""
    shape = batch.lower.shape
    states = rng.integers(-1, 2, shape), rng.choice([-1, 1], shape)
    far = 1e3 * rng.normal(size=shape)
    optimum = kernel(unlimited(batch)).x
    free = np.zeros(shape, np.int8)
    warm_state = [None, (optimum, free), *((far, state) for state in states)]
    return [kernel(batch, start=start) for start in warm_state]


def random_batch(
    rng: np.random.Generator, count: int, n: int, rows: Sequence[int], heavy: bool = False
) -> Batch:
    """Return problems with dependent, repeated and nearly repeated rows, and equal bounds.

    Half of them have small integers, with many ties and degenerate vertices. Levels are scaled by
    1e-9 to 1e9. `heavy`: rows have weights 0, 1 and 1e8.
    """
    whole = rng.random(count) < 0.5

    def chance(p: float, *shape: int) -> np.ndarray:
        return rng.random((count, *shape)) < p

    lower, upper = -rng.uniform(0.1, 1.0, (count, n)), rng.uniform(0.1, 1.0, (count, n))
    lower[whole], upper[whole] = np.ceil(2 * lower[whole]) / 2, np.ceil(2 * upper[whole]) / 2
    lower[chance(0.2, n)], upper[chance(0.2, n)] = -np.inf, np.inf
    same = chance(0.1, n) & np.isfinite(upper)
    lower[same] = upper[same]
    levels: list[tuple[np.ndarray, np.ndarray]] = []
    seen, nowhere = np.zeros((count, 0, n)), chance(0.05, n)
    for k in rows:
        inner = min(k, n)
        left, right = rng.normal(size=(count, k, inner)), rng.normal(size=(count, inner, n))
        left[whole], right[whole] = np.round(left[whole]), np.round(right[whole])
        left *= np.arange(inner) < rng.integers(1, 2 * inner + 1, count)[:, None, None]
        A = np.where(chance(0.5)[:, None, None], left @ right, rng.normal(size=(count, k, n)))
        A[whole] = np.round(A[whole])
        A *= ~(nowhere | chance(0.05, n))[:, None]
        for row, others in ((-1, A[:, :-1]), (0, seen)):
            if others.shape[1]:
                other = others[:, rng.integers(others.shape[1])]
                size = 0.0 if heavy else 1e-13 * np.linalg.norm(other, axis=1, keepdims=True)
                near = size * rng.normal(size=(count, n)) * chance(0.5)[:, None]
                A[:, row] = np.where(chance(0.3)[:, None], 2 * other + near, A[:, row])
        goal = rng.normal(size=(count, n)) * rng.choice([0.3, 1.0, 10.0], (count, 1))
        goal[whole] = np.round(2 * goal[whole]) / 2
        if heavy:
            goal = np.clip(goal, lower, upper)
        noise = np.round(2 * rng.normal(size=(count, k))) * chance(0.2 if heavy else 0.5)[:, None]
        b = times(A, goal) + noise
        seen = np.concatenate([seen, A], axis=1)
        weights = rng.choice([0.0, 1.0, 1e8], (count, k), p=[0.2, 0.4, 0.4]) if heavy else 1.0
        weights = weights * 10.0 ** rng.uniform(-9, 9, (count, 1))
        levels.append((A * weights[..., None], b * weights))
    return Batch(levels, lower, upper)


def enumerate_batch(batch: Batch) -> Known:
    """Return the solutions by enumeration."""
    return enumerated(batch.levels, batch.lower, batch.upper)


def assert_equal_solutions(batch: Batch, x: np.ndarray, known: Known) -> None:
    """Assert equal residuals, and equal x if determined, unless a rank is uncertain."""
    clear = known.gap > 100
    assert clear.mean() > 0.6
    allowed = 1e-10 * known.condition
    for k in range(len(batch.levels)):
        got, size = batch.residuals(k, x)
        best, _ = batch.residuals(k, known.x)
        assert (np.abs(got - best) <= allowed * size)[clear].all()
    off = np.linalg.norm(x - known.x, axis=1) / (1 + np.linalg.norm(known.x, axis=1))
    assert (off <= allowed)[clear].all()


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


def worst(batch: Batch, k: int, x: np.ndarray) -> float:
    """Return the largest violation of the optimality conditions of problem k."""
    levels = [(A[k], b[k]) for A, b in batch.levels]
    return certificate(levels, batch.lower[k], batch.upper[k], x[k])


@pytest.mark.parametrize(
    ("seed", "count", "heavy"),
    [(0, 12, 4), *(pytest.param(k, 100, 12, marks=LONG) for k in range(1, 11))],
)
def test_enumeration_of_active_sets_finds_no_better_solution(seed, count, heavy):
    """Check problems of each shape, some with rows of different weights."""
    rng = np.random.default_rng(seed)
    for n, rows in SHAPES:
        batch = random_batch(rng, count, n, rows)
        best = enumerate_batch(batch)
        for result in starts(rng, batch):
            assert result.ended.all()
            assert_equal_solutions(batch, result.x, best)
        batch = random_batch(rng, heavy, n, rows, heavy=True)
        clear = np.flatnonzero(enumerate_batch(batch).gap > 100).tolist()
        for result in starts(rng, batch):
            assert result.ended.all()
            assert max((worst(batch, k, result.x) for k in clear), default=0.0) < 1e-6
        # Where x satisfies all rows, including those of 1e-8 times the weight.
        x = rng.normal(size=(heavy, n))
        result = kernel(
            unlimited(replace(batch, levels=[(A, times(A, x)) for A, _ in batch.levels]))
        )
        for A, _ in batch.levels:
            size = np.linalg.norm(A, axis=2) * (1 + np.linalg.norm(x, axis=1, keepdims=True))
            assert (abs(times(A, result.x - x)) <= 1e-5 * size)[result.gap > 10].all()


@pytest.mark.parametrize(("seed", "count"), [(0, 20), pytest.param(1, 300, marks=LONG)])
def test_the_conditions_of_an_optimum_hold_in_many_unknowns(seed, count):
    rng = np.random.default_rng(seed)
    for n in rng.integers(6, 26, count):
        batch = random_batch(rng, 2, n, rng.integers(1, n, 3).tolist())
        for result in starts(rng, batch):
            assert result.ended.all()
            assert max(worst(batch, k, result.x) for k in range(2)) < 1e-9


def test_a_warm_start_leaves_a_suboptimal_vertex():
    """Check that round-off of a level satisfied there keeps no bound active (1 of 3,000 failed)."""
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


def test_no_bound_is_active_due_to_a_zero_direction():
    """Check a level with target beyond the bound of x_1; x_3 has round-off and must be free."""
    A = [[0.0, 1.0, 0.0], [5e-3, 0.0, 5e-12], [0.0, 0.0, 7e-12]]
    batch = one([(A, [1.0, -1.0, 0.0])], [0.0, -INF, -3.0], [3.0, INF, 3.0])
    for third in (-3.0, 0.5, 3.0):
        start = np.array([[0.0, 1.0, third]]), np.array([[-1, 0, np.sign(third)]], np.int8)
        result = kernel(batch, start=start)
        np.testing.assert_allclose(result.x, [[0.0, 1.0, 0.0]], atol=1e-12)
        assert result.gap > 1.0


@pytest.mark.parametrize(
    ("levels", "lower", "upper", "x"),
    [
        ([], [-1, 1, -INF], [1, 2, -3], [0, 1, -3]),  # without levels, the nearest to zero
        ([(np.zeros((0, 2)), []), ([[1, 1]], [2])], [-9, -9], [9, 9], [1, 1]),  # no rows
        ([(np.zeros((2, 2)), [7, 7]), ([[1, 1]], [2])], [-9, -9], [9, 0.5], [1.5, 0.5]),
        ([([[2.0]], [3]), ([[1.0]], [0])], [-INF], [INF], [1.5]),
        ([([[2.0], [1.0]], [3, 0])], [-INF], [1.125], [1.125]),  # 1.2 without
        ([(np.eye(3), [5, 6, 7])], [1, 2, 3], [1, 2, 3], [1, 2, 3]),
        ([([[1, 1, 0]], [3]), ([[1, -1, 0]], [0])], [-INF, -INF, 0.5], [1, INF, INF], [1, 2, 0.5]),
        ([(1e100 * np.eye(2), [3e100, -3e100])], [-1, -INF], [1, INF], [1, -3]),
        ([(np.eye(2), [3e100, -3e100])], [-1e100, -INF], [1e100, INF], [1e100, -3e100]),
        ([([[1e-200, 0]], [3e-200]), (np.eye(2), [1, 1])], [-9, -9], [9, 9], [1, 1]),
        ([([[1, 5e-324]], [1])], [-9, -9], [9, 9], [1, 0]),
    ],
)
def test_small_problems_have_exact_solutions(levels, lower, upper, x):
    batch = one(levels, lower, upper)
    far = np.full((1, len(x)), 1e9), np.zeros((1, len(x)))
    for result in (kernel(batch), kernel(batch, start=far)):  # no round-off of 1e9 is left
        assert result.ended.all()
        np.testing.assert_allclose(result.x, [x], rtol=1e-14, atol=1e-14)


def test_numbers_below_1e_150_count_as_zero():
    for tiny in (5e-324, 1e-310, 1e-200):
        batch = one([([[1, 2]], [3 * tiny]), (np.eye(2), [tiny, 9 * tiny])], [-INF, 0], [tiny] * 2)
        for result in starts(np.random.default_rng(0), batch):
            assert result.ended.all()
            assert abs(result.x).max() < 1e-12  # from 1e3


@pytest.mark.parametrize("n", [3, 8, 20, 30])
def test_degenerate_problems_end_and_are_optimal(n):
    """Check optima at corners, repeated columns, parallel rows and ties, which could cycle."""
    rng, shape = np.random.default_rng(n), (10, n, n)
    lower, upper = -np.ones((10, n)), rng.integers(0, 2, (10, n)).astype(float)
    corner = np.where(rng.random((10, n)) < 0.5, lower, upper)
    whole, repeated = rng.integers(-1, 2, shape).astype(float), rng.normal(size=shape)
    whole[:, n // 2 :] = whole[:, :1]
    repeated[..., rng.integers(0, n, n // 2)] = repeated[..., :1]
    parallel = rng.normal(size=(10, n, 1)) * rng.integers(-1, 2, (10, 1, n))
    units = np.eye(n)[rng.integers(0, n, (10, n))]
    for A, B, extent in (
        (whole, rng.integers(-1, 2, shape).astype(float), 5.0),
        (repeated, parallel, 1.0),
        (units, whole, 9.0),
        (parallel, units, 1.0),
    ):
        batch = Batch([(A, times(A, corner)), (B, extent * times(B, corner))], lower, upper)
        for result in starts(rng, batch):
            assert result.ended.all()
            assert result.steps.max() < 10 * n
            assert max(worst(batch, k, result.x) for k in range(10)) < 1e-9


COUNT = 150


@pytest.fixture(scope="module")
def sample() -> tuple[Batch, Known]:
    batch = random_batch(np.random.default_rng(0), COUNT, 4, (2, 3))
    return batch, enumerate_batch(batch)


def assert_same(result: KernelOutput, other: KernelOutput) -> None:
    """Assert bit-wise equality."""
    for name, a, b in zip(KernelOutput._fields, result, other, strict=True):
        assert a.tobytes() == b.tobytes(), name


@pytest.mark.parametrize(
    ("base", "most", "size"),
    [(2, 300, 1.0), (10, 90, 1.0), *((1, 0, size) for size in (2.0**-300, 2.0**300, 3e-90, 7e90))],
)
def test_units_change_no_solution_and_powers_of_two_no_bit(sample, base, most, size):
    """Check a unit for each level, or another one for x."""
    batch, best = sample
    units = float(base) ** np.random.default_rng(1).integers(-most, most + 1, (2, COUNT))
    levels = [
        (A * unit[:, None, None], b * size * unit[:, None])
        for (A, b), unit in zip(batch.levels, units, strict=True)
    ]
    result = kernel(Batch(levels, batch.lower * size, batch.upper * size))
    result = result._replace(x=result.x / size)
    assert_equal_solutions(batch, result.x, best)
    if base < 10 and size in (1.0, 2.0**-300, 2.0**300):
        assert_same(result, kernel(batch))


def test_a_batch_equals_its_problems_bit_by_bit(sample):
    """Check as well that one pair of bounds for all equals a pair for each."""
    batch, *_ = sample
    common = Batch(batch.levels, batch.lower[:1], batch.upper[:1])
    same = Batch(
        batch.levels, *(np.repeat(side[:1], COUNT, 0) for side in (batch.lower, batch.upper))
    )
    assert_same(kernel(common), kernel(same))
    whole = kernel(batch)
    for k in range(0, COUNT, 5):
        only = slice(k, k + 1)
        levels = [(A[only], b[only]) for A, b in batch.levels]
        alone = kernel(Batch(levels, batch.lower[only], batch.upper[only]))
        assert_same(alone, KernelOutput(*(each[only] for each in whole)))


def test_x_does_not_depend_on_the_initial_workspace(sample):
    batch, *_ = sample
    kinds: list[dict[str, Any]] = [{}, {"combined": True}, {"damping": [0.1, 0.2]}]
    for weight in ([1.0, 2.0, 3.0, 4.0], [1.0, 1.0, 0.0, 0.0]):
        kinds.append({"weight": np.array(weight)})
    for others in kinds:
        assert_same(kernel(batch, fill=np.nan, **others), kernel(batch, fill=1e300, **others))


def test_too_few_steps_leave_x_within_bounds_with_status_unfinished(sample):
    batch, *_ = sample
    whole, unfinished = kernel(batch), 0
    for most in range(6):
        result = kernel(batch, most=most)
        assert np.isfinite(result.x).all()
        np.testing.assert_array_equal(result.ended, whole.steps <= most)
        np.testing.assert_array_equal(result.x[result.ended], whole.x[result.ended])
        assert (result.steps <= most).all()
        unfinished += np.count_nonzero(~result.ended)
    assert unfinished > COUNT


WEIGHTS = [
    None,
    [1.0, 0.0, 0.0, 0.0],
    [1.0, 1.0, 1.0, 0.0],
    [0.5, 1.0, 2.0, 3.0],
    [0.01, 1.0, 1.0, 100.0],
]


@pytest.mark.parametrize("combined", [False, True])
@pytest.mark.parametrize("weight", WEIGHTS)
def test_a_weighted_norm_is_its_rows_after_the_last_level_or_in_it(sample, weight, combined):
    batch, w = sample[0], np.ones(4) if weight is None else np.array(weight)
    first, (A, b) = batch.levels
    size = sizes(A) + (sizes(A) == 0)  # the factor of the last level is one
    A, b = A / size[:, None, None], b / size[:, None]
    batch = replace(batch, levels=[first, (A, b)])
    wanted = np.random.default_rng(0).normal(size=batch.lower.shape)
    wanted *= weight is not None
    rows, goal = np.broadcast_to(np.diag(w), (COUNT, 4, 4)), w * wanted
    last = [(np.concatenate([A, rows], axis=1), np.concatenate([b, goal], axis=1))]
    more = replace(batch, levels=[first, *(last if combined else [(A, b), (rows, goal)])])
    result, best = (
        kernel(batch, weight=weight and w, wanted=wanted, combined=combined).x,
        enumerate_batch(more),
    )
    clear = best.gap > 100
    weighed = np.linalg.norm(w * (result - best.x), axis=1) / (1 + np.linalg.norm(goal, axis=1))
    assert (weighed <= 1e-10 * best.condition)[clear].all()
    for k in range(2 - combined):
        (got, size), (least, _) = batch.residuals(k, result), batch.residuals(k, best.x)
        assert (np.abs(got - least) <= 1e-10 * best.condition * size)[clear].all()


@pytest.mark.parametrize("weight", WEIGHTS)
def test_ranks_are_those_of_all_rows_up_to_each_level(sample, weight):
    """Check all final norms, also weights that are rows of their own."""
    batch = unlimited(sample[0])
    result = kernel(batch, weight=weight and np.array(weight))
    rows = [A / np.maximum(sizes(A), 1e-300)[:, None, None] for A, _ in batch.levels]
    upto = [np.linalg.matrix_rank(np.hstack(rows[: k + 1]), tol=RANK) for k in range(len(rows))]
    clear = sample[1].gap > 100
    np.testing.assert_array_equal(result.ranks.cumsum(axis=1)[clear], np.transpose(upto)[clear])


def test_the_gap_equals_that_of_the_singular_values_within_20():
    """Check that the gap is within a factor of 20, and the rank correct if the gap is large."""
    rng, n = np.random.default_rng(0), 5
    sigma = 10.0 ** rng.uniform(-13, 0, (500, n))
    sigma[:, 0] = 1.0
    U, V = (np.linalg.qr(rng.normal(size=(500, n, n)))[0] for _ in range(2))
    A, b = (U * sigma[:, None]) @ V.mT, rng.normal(size=(500, n))
    result = kernel(unlimited(Batch([(A, b)], b, b)))
    least = RANK * sizes(A)[:, None]
    true = np.maximum(sigma / least, least / sigma).min(axis=1)
    assert (result.gap >= 1).all()
    assert (result.gap <= 1.01 * true).all()
    assert (result.gap >= true / 20).all()
    inverse = np.where(sigma > least, 1 / sigma, 0.0)
    x = times(V, inverse * times(U.mT, b))
    # Omitted terms, up to RANK of the size, rotate the others.
    large = inverse.max(axis=1)
    off = np.linalg.norm(result.x - x, axis=1) / np.linalg.norm(x, axis=1)
    assert (off < 10 * RANK * large**2 + 1e-13 * large)[true > 1.01].all()
