"""Batches of small lexicographic problems, as the kernel solves them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from kernels import ffi, lib, pointer
from tests.lexicographic_oracles import RANK, Known, enumerated, sizes, times


@dataclass(frozen=True)
class Batch:
    """B problems of one shape: levels A (B, k, n), b (B, k), and bounds (B, n)."""

    levels: Sequence[tuple[np.ndarray, np.ndarray]]
    lower: np.ndarray
    upper: np.ndarray

    def with_levels(self, *levels: tuple[np.ndarray, np.ndarray]) -> "Batch":
        """Others within the same bounds."""
        return Batch(levels, self.lower, self.upper)

    def residuals(self, k: int, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """|A_k x - b_k|, and the size of what it is computed from, (B,)."""
        A, b = self.levels[k]
        size = sizes(A) * (1 + np.linalg.norm(x, axis=1)) + np.linalg.norm(b, axis=1)
        return np.linalg.norm(times(A, x) - b, axis=1), size


def one(levels: Any, lower: Any, upper: Any) -> Batch:
    """A single problem."""
    made = [(np.array(A, float)[None], np.array(b, float)[None]) for A, b in levels]
    return Batch(made, np.array(lower, float)[None], np.array(upper, float)[None])


class Found(NamedTuple):
    """What the kernel writes."""

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
    beside: bool = False,
    damping: Sequence[float] | None = None,
    most: int = 1000,
    room: float = 0.0,
) -> Found:
    """Solve a batch: cold, or warm from (x, state).

    |x| is made least at last, before it |weight (x - wanted)| if given; `room` is what the kernel
    finds in the room for its work.
    """
    count, n = len(batch.levels[0][0]) if batch.levels else len(batch.lower), batch.lower.shape[1]
    A = np.concatenate([np.zeros((count, 0, n)), *(A for A, _ in batch.levels)], axis=1)
    b = np.concatenate([np.zeros((count, 0)), *(b for _, b in batch.levels)], axis=1)
    scales = np.zeros((count, len(batch.levels)))
    for k, (rows, _) in enumerate(batch.levels):
        scales[:, k] = sizes(rows)
    given = (
        A,
        b,
        scales,
        np.ascontiguousarray(np.stack([batch.lower, batch.upper], axis=1), float),
    )
    before = [each.copy() for each in given]
    x, state = np.full((count, n), np.nan), np.full((count, n), 7, np.int8)
    if start is not None:
        x, state = np.array(start[0], float), np.array(start[1], np.int8)
    ends = np.cumsum([len(b[0]) for _, b in batch.levels]).astype(np.int32)
    damped = ffi.NULL if damping is None else pointer(np.array(damping, float))
    weighed = ffi.NULL if weight is None else pointer(weight)
    goal = np.zeros((count, n)) if wanted is None else np.ascontiguousarray(wanted, float)
    shape = count, n, len(batch.levels), count, len(batch.lower), most, start is not None, beside
    fields = (*shape, RANK, pointer(ends), damped, weighed)
    problem = ffi.new("lexicographic_problem *", fields)
    work = np.full(lib.lexicographic_room(problem), room)
    report = np.zeros((count, 4))
    made = goal, work, x, state, report
    ranks = np.append(np.zeros(scales.size, np.int32), np.int32(-9))
    lib.lexicographic_solve(problem, *map(pointer, (*given, *made, ranks)))
    assert ranks[-1] == -9, "more ranks than levels"
    for each, copy in zip(given, before, strict=True):
        assert each.tobytes() == copy.tobytes(), "an input was written"
    assert ((batch.lower <= x) & (x <= batch.upper)).all(), "a bound is not kept"
    for side, bound in ((-1, batch.lower), (1, batch.upper)):
        at = state == side
        assert (x[at] == np.broadcast_to(bound, x.shape)[at]).all(), "an active bound is not met"
    steps, ended = report[:, 0].astype(int), report[:, 1] > 0
    gap = report[:, 2:].min(axis=1)
    return Found(x, state, steps, ended, gap, ranks[:-1].reshape(scales.shape))


def unlimited(batch: Batch) -> Batch:
    """The same without bounds."""
    side = np.full(batch.lower.shape, np.inf)
    return Batch(batch.levels, -side, side)


def starts(rng: np.random.Generator, batch: Batch) -> list[Found]:
    """Solved cold, and warm from the optima without bounds, from far outside and from vertices."""
    shape = batch.lower.shape
    states = rng.integers(-1, 2, shape), rng.choice([-1, 1], shape)
    far = 1e3 * rng.normal(size=shape)
    optimum = kernel(unlimited(batch)).x
    free = np.zeros(shape, np.int8)
    begun = [None, (optimum, free), *((far, state) for state in states)]
    return [kernel(batch, start=start) for start in begun]


def random_batch(
    rng: np.random.Generator, count: int, n: int, rows: Sequence[int], heavy: bool = False
) -> Batch:
    """Problems with dependent, repeated and nearly repeated rows, zero columns, equal bounds.

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


def known(batch: Batch) -> Known:
    """By enumeration."""
    return enumerated(batch.levels, batch.lower, batch.upper)


def assert_alike(batch: Batch, x: np.ndarray, known: Known) -> None:
    """Every level as good, and x as far as it is determined, where no rank is in doubt."""
    clear = known.gap > 100
    assert clear.mean() > 0.6  # of six problems
    allowed = 1e-10 * known.condition
    for k in range(len(batch.levels)):
        got, size = batch.residuals(k, x)
        best, _ = batch.residuals(k, known.x)
        assert (np.abs(got - best) <= allowed * size)[clear].all()
    off = np.linalg.norm(x - known.x, axis=1) / (1 + np.linalg.norm(known.x, axis=1))
    assert (off <= allowed)[clear].all()
