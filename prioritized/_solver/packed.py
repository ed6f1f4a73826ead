"""Levels of least squares in the form that the kernel takes."""

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
"""As it is looked up faster."""


class Packed(NamedTuple):
    """Minimize |A_k x - b_k| level by level, lower <= x <= upper; B problems of one shape.

    Attributes:
        A: Rows of all levels, one after the other, shape (B, k, n).
        b: Shape (B, k).
        ends: Where each level ends in A.
        scales: Size of the matrices that each level's rows were made from, (B, levels); None is
            their norms.
        tolerance: Fraction of the scale below which a row depends on others.
        box: Lower and upper limits, (1, 2, n) or (B, 2, n).
        own: Unknowns whose norm is least at last, the first ones; the others are of inequality
            rows.
        damping: Of each level, in units of its singular values; () is none.
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
        """Shape (1, n) or (B, n)."""
        return self.box[:, 0]

    @property
    def upper(self) -> Array:
        """Likewise."""
        return self.box[:, 1]

    def residual(self, x: Array) -> Array:
        """What each row lacks, b - A x, shape (B, k)."""
        return self.b - times(self.A, x)

    @property
    def _sizes(self) -> Array:
        if self.scales is not None:
            return self.scales
        parts = np.split(self.A, self.ends[:-1], axis=1)
        return np.stack([frobenius(part) for part in parts], axis=1)

    @property
    def _target_size(self) -> Array:
        """Size of the x that any level asks for, (B,)."""
        parts = np.split(self.b, self.ends[:-1], axis=1)
        norms = np.stack([np.linalg.norm(part, axis=1) for part in parts], axis=1)
        sizes = self._sizes
        size = np.divide(norms, sizes, out=np.zeros_like(norms), where=sizes > 0.0)
        return size.max(axis=1)

    def at_bounds(self, x: Array) -> NDArray[np.int8]:
        """-1 where x is at its lower bound, 1 where at the upper one, 0 elsewhere, (B, n).

        By the values: which of several bounds that are reached at once a solver counts as active
        depends on round-off.
        """
        zero = self._target_size[:, None] * ACCURACY
        at_lower = ~exceeds(x, self.lower, zero=zero)
        at_upper = ~exceeds(self.upper, x, zero=zero)
        nearer = at_lower & ~(at_upper & (self.upper - x < x - self.lower))
        return np.where(nearer, -1, at_upper).astype(np.int8)

    def level_residual(self, k: int, x: Array) -> Array:
        """The same of one level, (B, .)."""
        first = self.ends[k - 1] if k else 0
        return self.residual(x)[:, first : self.ends[k]]

    def is_violated(self, levels: slice, x: Array) -> Mask:
        """Whether these levels lack more than round-off, (B,)."""
        first = 0 if not levels.start else self.ends[levels.start - 1]
        rows = slice(first, self.ends[levels.stop - 1])
        residual = self.residual(x)[:, rows]
        A, largest = np.abs(self.A[:, rows]), np.maximum(np.abs(self.lower), np.abs(self.upper))
        terms = times(A, np.abs(x)) + np.abs(self.b[:, rows])
        # Where only zero is feasible, x is what the limits leave of round-off.
        tiny = 10.0 * ROUND_OFF * times(A, np.where(np.isfinite(largest), largest, 0.0))
        # Of the size of what any level asks for, x has round-off even where it is zero.
        round_off = self._target_size * self._sizes[:, levels].max(axis=1)
        allowed = self.tolerance * (np.linalg.norm(terms, axis=-1) + round_off)
        return np.linalg.norm(residual, axis=-1) > allowed + np.linalg.norm(tiny, axis=-1)


class Point(NamedTuple):
    """Where the solver ended, the batch axis first.

    Attributes:
        x: Shape (B, n).
        active: Bounds that the solver held last: -1 the lower, 1 the upper, 0 none, (B, n). Of
            those that x is at, :meth:`Packed.at_bounds`, they are some.
        report: What ``lexicographic_solve`` says of each problem, (B, 4).
    """

    x: Array
    active: NDArray[np.int8]
    report: Array

    @property
    def steps(self) -> NDArray[np.int64]:
        """Of the active set, (B,)."""
        return self.report[:, 0].astype(np.int64)

    @property
    def ended(self) -> Mask:
        """Whether x is the optimum: it always obeys the bounds, (B,)."""
        return self.report[:, 1] > 0.0

    @property
    def is_invalid(self) -> bool:
        """Whether a number of the first problem is not finite or too large."""
        return bool(self.report[0, 1] < 0.0)

    @property
    def gap(self) -> Array:
        """Smallest gap of the rank decisions, (B,)."""
        return self.report[:, 2:].min(axis=1)


def solve(packed: Packed, start: Point | None = None, most_steps: int | None = None) -> Point:
    """The solution of each problem.

    Args:
        packed: The problems.
        start: The solution of similar problems: they start from its active set.
        most_steps: Of the active set, for each problem; None is 20 (n + 1) for each level.
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
    """The solution of each problem, of numbers that were checked one by one.

    Raises:
        ValueError: A target times its weight is too large.
    """
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
    """Problems of one shape as the kernel takes them, and the room that it needs."""
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
    """Inequality rows: lower <= G x <= upper, G (..., r, n)."""

    G: Array
    limits: Limits


class Equations(NamedTuple):
    """A level: |A x - b| is to be least, A (..., k, n), b (..., k).

    `scale` is the size of the matrices that A was made from.
    """

    A: Array
    b: Array
    scale: Array | float
    damping: float = 0.0


def equations(A: Array) -> Equations:
    """A x = 0, of one matrix."""
    return Equations(A, none((len(A),)), norm(A))


@lru_cache
def ends_of(*rows: int) -> tuple[int, ...]:
    """Where levels of so many rows each end."""
    return tuple(np.cumsum(rows).tolist())


def pack(levels: Sequence[Equations | Rows], box: Limits, tolerance: float) -> Packed:
    """The levels as the solver takes them.

    An inequality row g becomes the equation g x = |g| s, with one more unknown s between the limits
    over |g|: its residual is what g x lacks to lie between them.
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
