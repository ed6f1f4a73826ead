"""Problem 1 with diagonal weights and without constraints: one call of a compiled kernel."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

import argument_checks as check
from argument_checks import Array
from kernels import Struct, ffi, lib, pointer
from prioritized._mapping.problem import Problem
from prioritized._solver.arrays import none
from prioritized._solver.limits import Limits
from prioritized._solver.rank import frobenius

_FLOAT64 = np.dtype(np.float64)
NAMES = "v_major", "joint_velocity", "secondary_velocity"


class Plain:
    """Problem 1 for J (..., m, n), tasks S (m1 + m2, m) and diagonal weights.

    Attributes:
        J: One matrix or a batch, contiguous.
        S: Major directions, multiplied by `metric` if there is one, then the secondary ones.
        metric: M (k, m1) of the major velocity, or None.
        weights: w1 (n,) and w2 (m2,), or None.
        scale: Size of J against which ranks are decided, (...); None is its norm.
        tolerance: Tolerance of the rank decisions.
        threshold: Fraction of the scale above which a singular value of the major rows is
            certainly not zero.
        m1: Number of major directions.
    """

    __slots__ = ("J", "S", "_args", "m1", "metric", "scale", "threshold", "tolerance", "weights")

    def __init__(
        self,
        J: Array,
        S: Array,
        m1: int,
        weights: tuple[Array | None, Array | None],
        metric: Array | None,
        scale: Array | None,
        tolerance: float,
        threshold: float = 0.0,
        shape: tuple[Struct, int] | None = None,
    ) -> None:
        self.J, self.S, self.m1, self.weights, self.metric = J, S, m1, weights, metric
        self.scale, self.tolerance, self.threshold = scale, tolerance, threshold
        if shape is None:
            rows = m1 if metric is None else len(metric)
            has = weights[0] is not None, weights[1] is not None
            count = int(np.prod(J.shape[:-2]))
            shape = shape_of(S, rows, J.shape[-1], has, tolerance, threshold, count)
        self._args = *shape, pointer(J), *map(_or_none, (scale, *weights))

    def __reduce__(self) -> tuple[Any, ...]:
        # Pointers cannot be pickled.
        others = self.weights, self.metric, self.scale, self.tolerance, self.threshold
        return Plain, (self.J, self.S, self.m1, *others)

    def problem(self, S_m: Array, S_s: Array) -> Problem:
        """Return the equivalent general problem."""
        *lead, m, n = self.J.shape
        W1, W2 = (
            none((0, k)) if w is None else np.diag(w)
            for w, k in zip(self.weights, (n, len(S_s)), strict=True)
        )
        size = frobenius(self.J) if self.scale is None else self.scale.reshape(lead)
        nothing = none((0, n)), none((m, 0)), self.metric, none((0, n))
        return Problem(
            self.J, S_m, S_s, W1, W2, *nothing, np.asarray(size), self.tolerance, tuple(lead)
        )

    @property
    def is_moderate(self) -> bool:
        """Return whether all numbers are finite, and no product of them over- or underflows."""
        problem, _, J, _, w1, w2 = self._args
        return lib.problem1_fits(problem.pointer, J, w1, w2)

    def rates(
        self,
        v_major: ArrayLike,
        joint_velocity: ArrayLike | None,
        secondary_velocity: ArrayLike | None,
        box: Limits | None,
    ) -> Array | None:
        """Return the optimal rates (..., n) within limits (2, n); None requires the general solver.

        This is the case for targets with other leading axes than J, and if a rank may be deficient.
        """
        values = v_major, joint_velocity, secondary_velocity
        problem, workspace, *first = self._args
        lead, n, m1 = self.J.shape[:-2], self.J.shape[-1], self.m1
        sizes = m1, n, len(self.S) - (m1 if self.metric is None else len(self.metric))
        targets: list[Any] = []
        for i, value in enumerate(values):
            # Argument checks would take as long as the arithmetic.
            if type(value) is np.ndarray and value.dtype is _FLOAT64:
                target = value
            else:
                target = (
                    None if value is None and i else check.array(NAMES[i], value, ..., sizes[i])
                )
            if target is not None and target.shape != (*lead, sizes[i]):
                check.array(NAMES[i], target, ..., sizes[i])
                if target.ndim > 1:
                    return None
                target = np.broadcast_to(target, (*lead, sizes[i]))
            if target is not None and not i and self.metric is not None:
                target = target.dot(self.metric.T)
            targets.append(target)
        x, limits = np.empty((*lead, sizes[1])), None if box is None else np.asarray(box)
        room = ffi.NULL if workspace <= lib.OWN_ROOM else pointer(np.empty(workspace))
        try:
            inputs = [_or_none(target) for target in (*targets, limits)]
        except ValueError:  # not contiguous, which is rare
            inputs = [
                _or_none(None if A is None else np.array(A, order="C")) for A in (*targets, limits)
            ]
        code = lib.problem1_solve(problem.pointer, *first, *inputs, room, pointer(x))
        if code == lib.PROBLEM1_REFUSED:
            for name, value, size in zip(NAMES, values, sizes, strict=True):
                if value is not None:
                    check.array(name, value, ..., size)
        return x if code == lib.PROBLEM1_SOLVED else None


def shape_of(
    S: Array,
    m1: int,
    n: int,
    has: tuple[bool, bool],
    tolerance: float,
    threshold: float = 0.0,
    count: int = 1,
) -> tuple[Struct, int]:
    """Return the kernel's description of a problem without J and weights, and its workspace size.

    The arguments are those of :class:`Plain`, n rates, whether it has w1 and w2, and `count` J.
    """
    problem = Struct(
        "problem1",
        count=count,
        jacobians=count,
        m=S.shape[1],
        n=n,
        m1=m1,
        m2=len(S) - m1,
        joint=has[0],
        secondary=has[1],
        tolerance=tolerance,
        clear=threshold,
        S=S,
    )
    return problem, lib.problem1_room(problem.pointer)


def _or_none(A: Array | None) -> Any:
    return ffi.NULL if A is None else pointer(A)


def plain_of(problem: Problem, threshold: float = 0.0) -> Plain | None:
    """Convert a checked problem if its weights are diagonal and it has no constraints; else None.

    The kernel does not solve it if singular values may be below `threshold` times the scale.
    """
    J, S_m, S_s, W1, W2, C, _, M, T, scale, tolerance, lead = problem
    if C.size or T.size or J.shape[:-2] != lead or not tolerance:
        return None
    w1, w2 = (_diagonal(W) if W.size else None for W in (W1, W2))
    if (W1.size and w1 is None) or (W2.size and w2 is None):
        return None
    if M is not None and M.ndim > 2:
        return None
    S = np.ascontiguousarray(np.concatenate([S_m if M is None else M @ S_m, S_s]))
    sizes = np.ascontiguousarray(np.broadcast_to(scale, lead), float).reshape(-1)
    J = np.ascontiguousarray(J)
    plain = Plain(J, S, len(S_m), (w1, w2), M, sizes, tolerance, threshold)
    return plain if plain.is_moderate else None


def _diagonal(W: Array) -> Array | None:
    if W.ndim != 2 or W.shape[0] != W.shape[1] or (W - np.diag(W.diagonal())).any():
        return None
    return np.ascontiguousarray(W.diagonal())
