"""Levels of least squares in the form that the compiled solver takes."""

from collections.abc import Sequence
from functools import lru_cache
from math import prod
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from argument_checks import Array, Mask
from argument_checks.ties import ACCURACY, exceeds
from kernels import ffi, lib, pointer
from prioritized._solver.arrays import beside, none, read_only, times
from prioritized._solver.limits import Limits
from prioritized._solver.rank import frobenius, norm

_INT8, _INT32, _INT64 = np.dtype(np.int8), np.dtype(np.int32), np.dtype(np.int64)
_BOOL = np.dtype(np.bool_)
"""As they are looked up faster."""
_OF_LIMITS = 1e-14
"""Part of the limits that is round-off."""


class Packed(NamedTuple):
    """Minimize |A_k x - b_k| level by level, lower <= x <= upper; B problems of one shape.

    Attributes:
        A: Rows of all levels, one after the other, shape (B, k, n).
        b: Shape (B, k).
        ends: Where each level ends in A.
        scales: Size of the matrices that each level's rows were made from, (B, levels).
        tolerance: Fraction of the scale below which a row depends on others.
        lower: Shape (1, n) or (B, n).
        upper: Likewise.
    """

    A: Array
    b: Array
    ends: NDArray[np.int64]
    scales: Array
    tolerance: float
    lower: Array
    upper: Array

    def rest(self, x: Array) -> Array:
        """What each row lacks, b - A x, shape (B, k)."""
        return self.b - times(self.A, x)

    @property
    def _size_asked(self) -> Array:
        """Size of the x that any level asks for, (B,)."""
        parts = np.split(self.b, self.ends[:-1], axis=1)
        asked = np.stack([np.linalg.norm(part, axis=1) for part in parts], axis=1)
        size = np.divide(asked, self.scales, out=np.zeros_like(asked), where=self.scales > 0.0)
        return size.max(axis=1)

    def at_bounds(self, x: Array) -> NDArray[np.int8]:
        """-1 where x is at its lower bound, 1 where at the upper one, 0 elsewhere, (B, n).

        By the values: which of several bounds that are reached at once a solver counts as active
        depends on round-off.
        """
        asked = self._size_asked[:, None] * ACCURACY
        at_lower = ~exceeds(x, self.lower, zero=asked)
        at_upper = ~exceeds(self.upper, x, zero=asked)
        nearer = at_lower & ~(at_upper & (self.upper - x < x - self.lower))
        return np.where(nearer, -1, at_upper).astype(np.int8)

    def level(self, k: int, x: Array) -> Array:
        """The same of one level, (B, .)."""
        first = self.ends[k - 1] if k else 0
        return self.rest(x)[:, first : self.ends[k]]

    def unmet(self, levels: slice, x: Array) -> Mask:
        """Whether these levels lack more than round-off, (B,)."""
        first = 0 if not levels.start else self.ends[levels.start - 1]
        rows = slice(first, self.ends[levels.stop - 1])
        rest = self.rest(x)[:, rows]
        A, reach = np.abs(self.A[:, rows]), np.maximum(np.abs(self.lower), np.abs(self.upper))
        terms = times(A, np.abs(x)) + np.abs(self.b[:, rows])
        # Where only zero is feasible, x is what the limits leave of round-off.
        left = _OF_LIMITS * times(A, np.where(np.isfinite(reach), reach, 0.0))
        # Of the size of what any level asks for, x has round-off even where it is zero.
        round_off = self._size_asked * self.scales[:, levels].max(axis=1)
        allowed = self.tolerance * (np.linalg.norm(terms, axis=-1) + round_off)
        return np.linalg.norm(rest, axis=-1) > allowed + np.linalg.norm(left, axis=-1)


class Point(NamedTuple):
    """Where the solver ended, the batch axis first.

    Attributes:
        x: Shape (B, n).
        active: Bounds that the solver held last: -1 the lower, 1 the upper, 0 none, (B, n). Of
            those that x is at, :meth:`Packed.at_bounds`, they are some.
        steps: Of the active set, (B,).
        ended: Whether x is the optimum: it always obeys the bounds, (B,).
        gap: Smallest gap of the rank decisions, (B,); None where none was near its threshold.
    """

    x: Array
    active: NDArray[np.int8]
    steps: NDArray[np.int64]
    ended: NDArray[np.bool_]
    gap: Array | None


@lru_cache
def ends_of(*rows: int) -> NDArray[np.int64]:
    """Where levels of so many rows each end; looked up, since it is the same at every tick."""
    return read_only(np.cumsum(rows))


def solve(
    packed: Packed,
    optimum: Array | None = None,
    start: Point | None = None,
    most_steps: int | None = None,
) -> Point:
    """The solution of each problem.

    Args:
        packed: The problems.
        optimum: Their solutions without bounds, where known, (B, n).
        start: The solution of similar problems: they start from its active set.
        most_steps: Of the active set, for each problem; None is 20 (n + 1) for each level.
    """
    count, _, n = packed.A.shape
    shape, active = (count, n), np.zeros((count, n), _INT8)
    if start is not None and start.x.shape == shape:
        how, x, active = lib.LEXICOGRAPHIC_WARM, start.x.copy(), active_of(start, shape)
    elif optimum is not None:
        how, x = lib.LEXICOGRAPHIC_FROM_OPTIMUM, optimum.reshape(shape).copy()
    else:
        how, x = lib.LEXICOGRAPHIC_COLD, np.zeros(shape)
    most = 20 * (n + 1) * len(packed.ends) if most_steps is None else most_steps
    steps, ended, gap = np.empty(count, _INT64), np.empty(count, _BOOL), np.empty(count)
    ends = pointer(packed.ends.astype(_INT32))
    sizes = count, n, len(packed.ends), count, len(packed.lower), how, most, False
    problem = ffi.new("lexicographic_problem *", (*sizes, packed.tolerance, ends))
    room = np.empty(lib.lexicographic_room(problem))
    given = map(pointer, (packed.A, packed.b, packed.scales, packed.lower, packed.upper))
    made = map(pointer, (room, x, active, steps, ended, gap))
    lib.lexicographic_solve(problem, *given, ffi.NULL, *made)
    return Point(read_only(x), active, steps, ended, gap)


def active_of(start: Point | None, shape: tuple[int, int]) -> NDArray[np.int8]:
    """Active bounds to begin with, to be overwritten: none where the start is of another shape."""
    if start is None or start.active.shape != shape:
        return np.zeros(shape, _INT8)
    return start.active.copy()


def point_of(x: Array, active: NDArray[np.int8], steps: int) -> Point:
    """The solution of one problem (1, n) none of whose ranks was in doubt."""
    return Point(read_only(x), active, _count(steps), _ENDED, None)


@lru_cache
def _count(steps: int) -> NDArray[np.int64]:
    return read_only(np.array([steps]))


_ENDED = read_only(np.ones(1, dtype=bool))


def unpacked(
    given: Array, ends: NDArray[np.int64], tolerance: float, limits: Array, scales: Array
) -> Packed:
    """One problem with A_1, b_1, A_2 and so on, row by row, in `given`, and a last level |x|."""
    A, b = np.empty((1, ends[-1], limits.shape[1])), np.empty((1, ends[-1]))
    levels = len(ends), pointer(ends), pointer(given)
    lib.single_unpack(limits.shape[1], *levels, pointer(A), pointer(b))
    return Packed(A, b, ends, scales[None], tolerance, limits[:1], limits[1:])


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


def equations(A: Array) -> Equations:
    """A x = 0, of one matrix."""
    return Equations(A, none((len(A),)), norm(A))


class Unknowns(NamedTuple):
    """Bounds of the unknowns, and where known the solution without bounds, (..., n)."""

    box: Limits
    optimum: Array | None = None

    def and_also(self, lower: Array, upper: Array, optimum: Array | None) -> "Unknowns":
        """These and further ones."""
        low, high = self.box
        box = beside(low, lower), beside(high, upper)
        if self.optimum is None or optimum is None:
            return Unknowns(box)
        return Unknowns(box, beside(self.optimum, optimum))


def pack_one(levels: Sequence[Equations | Rows], box: Limits, tolerance: float) -> Packed:
    """One problem as :func:`pack`, in less time where it has no inequality rows."""
    plain = [each for each in levels if isinstance(each, Equations)]
    if len(plain) < len(levels):
        return pack(levels, Unknowns(box), tolerance)[0]
    matrices, vectors, scales = zip(*plain, strict=True)
    lower, upper = box
    return Packed(
        np.concatenate(matrices)[None],
        np.concatenate(vectors)[None],
        ends_of(*map(len, vectors)),
        np.array([scales]),
        tolerance,
        lower[None],
        upper[None],
    )


def pack(
    levels: Sequence[Equations | Rows], unknowns: Unknowns, tolerance: float
) -> tuple[Packed, Array | None]:
    """The levels as the solver takes them, and the optimum without bounds, if known.

    An inequality row g becomes the equation g x = |g| s, with one more unknown s between the limits
    over |g|: its residual is what g x lacks to lie between them.
    """
    n, blocks, slacks = unknowns.box[0].shape[-1], [], 0
    for each in levels:
        if isinstance(each, Rows):
            squares = (each.G**2).sum(axis=-1)
            size = np.sqrt(squares.max(axis=tuple(range(squares.ndim - 1)), initial=0.0))
            size[size == 0.0] = 1.0
            lower, upper = each.limits
            x = unknowns.optimum
            values = None if x is None else times(each.G, x[..., :n]) / size
            unknowns = unknowns.and_also(lower / size, upper / size, values)
            blocks.append((each.G, np.zeros(each.G.shape[:-1]), frobenius(each.G), slacks, size))
            slacks += len(size)
        else:
            blocks.append((*each, 0, ()))
    known = [unknowns.optimum] if unknowns.optimum is not None else []
    vectors = [*known, *unknowns.box, *(b for _, b, *_ in blocks)]
    matrices = (A.shape[:-2] for A, *_ in blocks)
    lead = np.broadcast_shapes(*matrices, *(each.shape[:-1] for each in vectors))
    ends = np.cumsum([A.shape[-2] for A, *_ in blocks])
    A, b = np.zeros((*lead, ends[-1], n + slacks)), np.zeros((*lead, ends[-1]))
    scales = np.zeros((*lead, len(blocks)))
    for k, (rows, target, scale, slack, size) in enumerate(blocks):
        first = ends[k] - rows.shape[-2]
        A[..., first : ends[k], :n], b[..., first : ends[k]], scales[..., k] = rows, target, scale
        for i, one in enumerate(size):
            A[..., first + i, n + slack + i] = -one
    low, high = (_flat(side, side.shape[:-1]) for side in unknowns.box)
    A, b, scales = (each.reshape(prod(lead), *each.shape[len(lead) :]) for each in (A, b, scales))
    packed = Packed(A, b, ends, scales, tolerance, low, high)
    x = unknowns.optimum
    return packed, None if x is None else _flat(np.broadcast_to(x, (*lead, n + slacks)), lead)


def _flat(A: Array, lead: tuple[int, ...]) -> Array:
    """A copy with one batch axis in place of the leading ones, laid out for the solver."""
    return np.array(A, order="C").reshape(prod(lead), *A.shape[len(lead) :])
