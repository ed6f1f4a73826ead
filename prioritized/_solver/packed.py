"""Levels of least squares in the form of the compiled solver."""

from collections.abc import Sequence
from functools import lru_cache
from math import prod
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from argument_checks import Array, Mask
from argument_checks.ties import ACCURACY, exceeds
from kernels import Struct, ffi, lib, pointer
from prioritized._solver.arrays import concatenated, none, read_only, times
from prioritized._solver.limits import Limits
from prioritized._solver.rank import ROUND_OFF, frobenius, norm

_INT8 = np.dtype(np.int8)
"""Data type of active sets; a constant because np.dtype(...) is slower."""


class Packed(NamedTuple):
    """Batch of B lexicographic problems min |A_k x - b_k|, lower <= x <= upper, of one shape.

    Attributes:
        A: Rows of all levels, one after the other, shape (B, k, n).
        b: Right-hand sides, shape (B, k).
        ends: Index of the row in A after the last one of each level.
        scales: Size of the matrices that each level's rows were computed from, (B, levels); None is
            the norms of the rows.
        tolerance: Fraction of the scale below which a row is linearly dependent.
        box: Lower and upper limits, (1, 2, n) or (B, 2, n).
        unknowns: Number of unknowns whose norm breaks ties; the others are slacks of inequality
            rows.
        damping: Damping of each level, in units of its singular values; () is none.
    """

    A: Array
    b: Array
    ends: tuple[int, ...]
    scales: Array | None
    tolerance: float
    box: Array
    unknowns: int
    damping: tuple[float, ...] = ()

    @property
    def lower(self) -> Array:
        """Lower bounds, shape (1, n) or (B, n)."""
        return self.box[:, 0]

    @property
    def upper(self) -> Array:
        """Upper bounds, shape (1, n) or (B, n)."""
        return self.box[:, 1]

    def residual(self, x: Array) -> Array:
        """Return the residual b - A x of all rows, shape (B, k)."""
        return self.b - times(self.A, x)

    @property
    def _sizes(self) -> Array:
        if self.scales is not None:
            return self.scales
        parts = np.split(self.A, self.ends[:-1], axis=1)
        return np.stack([frobenius(part) for part in parts], axis=1)

    @property
    def _target_size(self) -> Array:
        """Size of the solution that the targets require: largest |b_k| / |A_k|, (B,)."""
        parts = np.split(self.b, self.ends[:-1], axis=1)
        norms = np.stack([np.linalg.norm(part, axis=1) for part in parts], axis=1)
        sizes = self._sizes
        size = np.divide(norms, sizes, out=np.zeros_like(norms), where=sizes > 0.0)
        return size.max(axis=1)

    def at_bounds(self, x: Array) -> NDArray[np.int8]:
        """Return -1 where x is at its lower bound, 1 at the upper one, 0 elsewhere, (B, n).

        The values decide: if several bounds become active at once, the solver's choice among them
        depends on round-off.
        """
        zero = self._target_size[:, None] * ACCURACY
        at_lower = ~exceeds(x, self.lower, zero=zero)
        at_upper = ~exceeds(self.upper, x, zero=zero)
        nearer = at_lower & ~(at_upper & (self.upper - x < x - self.lower))
        return np.where(nearer, -1, at_upper).astype(np.int8)

    def level_residual(self, k: int, x: Array) -> Array:
        """Return the residual of one level, (B, .)."""
        return self.residual(x)[:, self.ends[k - 1] if k else 0 : self.ends[k]]

    def is_violated(self, levels: slice, x: Array) -> Mask:
        """Return whether the residual of these levels exceeds round-off, (B,)."""
        first = 0 if not levels.start else self.ends[levels.start - 1]
        rows = slice(first, self.ends[levels.stop - 1])
        residual = self.residual(x)[:, rows]
        A, largest = np.abs(self.A[:, rows]), np.maximum(np.abs(self.lower), np.abs(self.upper))
        terms = times(A, np.abs(x)) + np.abs(self.b[:, rows])
        # Where only zero is feasible, x is round-off that the limits admit.
        tiny = 10.0 * ROUND_OFF * times(A, np.where(np.isfinite(largest), largest, 0.0))
        # The round-off of x is relative to the largest solution that a level requires.
        round_off = self._target_size * self._sizes[:, levels].max(axis=1)
        allowed = self.tolerance * (np.linalg.norm(terms, axis=-1) + round_off)
        return np.linalg.norm(residual, axis=-1) > allowed + np.linalg.norm(tiny, axis=-1)


class Point(NamedTuple):
    """Result of the solver, the batch axis first.

    Attributes:
        x: Solution, shape (B, n).
        active: Final active set: -1 lower bound, 1 upper bound, 0 inactive, (B, n). It is a subset
            of the bounds that x is at, see :meth:`Packed.at_bounds`.
        report: Report of ``lexicographic_solve`` on each problem, (B, 4).
    """

    x: Array
    active: NDArray[np.int8]
    report: Array

    @property
    def steps(self) -> NDArray[np.int64]:
        """Number of steps of the active set, (B,)."""
        return self.report[:, 0].astype(np.int64)

    @property
    def ended(self) -> Mask:
        """Return whether x is the optimum, (B,); the bounds hold in any case."""
        return self.report[:, 1] > 0.0

    @property
    def is_invalid(self) -> bool:
        """Return whether a number of the first problem is not finite or too large."""
        return bool(self.report[0, 1] < 0.0)

    @property
    def gap(self) -> Array:
        """Smallest gap of the rank decisions, (B,)."""
        return self.report[:, 2:].min(axis=1)


def solve(packed: Packed, start: Point | None = None, most_steps: int | None = None) -> Point:
    """Return the solution of each problem.

    The active set of `start` is the initial one. `most_steps` bounds the steps for each problem;
    None is 20 (n + 1) for each level.
    """
    count, _, n = packed.A.shape
    warm = start is not None and start.x.shape == (count, n)
    x = start.x.copy() if start and warm else np.empty((count, n))
    active = start.active.copy() if start and warm else np.empty((count, n), _INT8)
    batch = count, len(packed.A), len(packed.box), warm, most_steps, packed.tolerance
    problem, workspace = _shape(n, packed.ends, packed.unknowns, packed.damping, batch)
    report, scales = np.empty((count, 4)), packed.scales
    sizes = ffi.NULL if scales is None else pointer(scales)
    desired = ffi.NULL if packed.unknowns == n else pointer(np.zeros((count, n)))
    inputs = pointer(packed.A), pointer(packed.b), sizes, pointer(packed.box), desired
    work = ffi.NULL if workspace <= lib.OWN_ROOM else pointer(np.empty(workspace))
    outputs = work, pointer(x), pointer(active), pointer(report)
    lib.lexicographic_solve(problem.pointer, *inputs, *outputs, ffi.NULL)
    return Point(read_only(x), active, read_only(report))


def solved(packed: Packed, start: Point | None = None, most_steps: int | None = None) -> Point:
    """Return the solution of each problem; refuse a target of 1e120 or more times its weight."""
    point = solve(packed, start, most_steps)
    if (point.report[:, 1] < 0.0).any():
        raise ValueError("targets times their weights must be below 1e120, got more")
    return point


@lru_cache(maxsize=512)
def _shape(
    n: int,
    ends: tuple[int, ...],
    unknowns: int,
    damping: tuple[float, ...],
    batch: tuple[int, int, int, bool, int | None, float],
) -> tuple[Struct, int]:
    """Return the kernel's description of problems of one shape, and its workspace size."""
    count, matrices, bounds, warm, most_steps, tolerance = batch
    problem = Struct(
        "lexicographic_problem",
        count=count,
        n=n,
        levels=len(ends),
        matrices=matrices,
        bounds=bounds,
        most_steps=20 * (n + 1) * (len(ends) + 1) if most_steps is None else most_steps,
        warm=warm,
        tolerance=tolerance,
        ends=np.array(ends, np.int32),
        damping=np.array(damping) if any(damping) else None,
        weight=None if unknowns == n else np.append(np.ones(unknowns), np.zeros(n - unknowns)),
    )
    return problem, lib.lexicographic_room(problem.pointer)


class Rows(NamedTuple):
    """Inequality rows lower <= G x <= upper, G (..., r, n)."""

    G: Array
    limits: Limits


class Equations(NamedTuple):
    """Level of least squares that minimizes |A x - b|, A (..., k, n), b (..., k).

    `scale` is the size of the matrices that A was computed from.
    """

    A: Array
    b: Array
    scale: Array | float
    damping: float = 0.0


def equations(A: Array) -> Equations:
    """Return the level A x = 0 of one matrix."""
    return Equations(A, none((len(A),)), norm(A))


@lru_cache
def ends_of(*rows: int) -> tuple[int, ...]:
    """Return the end index of each level, given its number of rows."""
    return tuple(np.cumsum(rows).tolist())


def pack(levels: Sequence[Equations | Rows], box: Limits, tolerance: float) -> Packed:
    """Convert levels to the form of the solver.

    An inequality row g becomes the equation g x = |g| s, with an additional unknown s between the
    limits divided by |g|: its residual is the violation of the limits.
    """
    n, blocks, slacks, (low, high), damping = box[0].shape[-1], [], 0, box, []
    for level in levels:
        damping.append(0.0 if isinstance(level, Rows) else level.damping)
        if isinstance(level, Rows):
            squares = (level.G**2).sum(axis=-1)
            size = np.sqrt(squares.max(axis=tuple(range(squares.ndim - 1)), initial=0.0))
            size[size == 0.0] = 1.0
            lower, upper = level.limits
            low, high = concatenated(low, lower / size), concatenated(high, upper / size)
            blocks.append((level.G, np.zeros(level.G.shape[:-1]), frobenius(level.G), slacks, size))
            slacks += len(size)
        else:
            blocks.append((*level[:3], 0, ()))
    vectors = [low, high, *(b for _, b, *_ in blocks)]
    matrices = (A.shape[:-2] for A, *_ in blocks)
    lead = np.broadcast_shapes(*matrices, *(vector.shape[:-1] for vector in vectors))
    ends = ends_of(*(A.shape[-2] for A, *_ in blocks))
    A, b = np.zeros((*lead, ends[-1], n + slacks)), np.zeros((*lead, ends[-1]))
    scales = np.zeros((*lead, len(blocks)))
    for k, (rows, target, scale, slack, size) in enumerate(blocks):
        first = ends[k] - rows.shape[-2]
        A[..., first : ends[k], :n], b[..., first : ends[k]], scales[..., k] = rows, target, scale
        for i, norm_of_row in enumerate(size):
            A[..., first + i, n + slack + i] = -norm_of_row
    both = np.stack(np.broadcast_arrays(low, high), axis=-2)
    box = np.ascontiguousarray(both.reshape(prod(both.shape[:-2]), *both.shape[-2:]))
    A, b, scales = (
        array.reshape(prod(lead), *array.shape[len(lead) :]) for array in (A, b, scales)
    )
    return Packed(A, b, ends, scales, tolerance, box, n, tuple(damping))
