"""Which of several computed numbers is the least or the greatest: one rule for ties.

On a symmetric machine whole lists of numbers are equal, but for their last bits, which depend on
the processor. Here numbers that are equal within their accuracy are equal, and what comes first of
them, in the order in which the caller named them, is first.
"""

from math import isfinite

import numpy as np
from numpy.typing import ArrayLike

from argument_checks.arrays import Indices, Mask

ACCURACY = 1e-9
"""Part of a number, as in :func:`math.isclose`: well above round-off, and below what matters."""


def exceeds(
    value: ArrayLike, bound: ArrayLike, accuracy: float = ACCURACY, zero: ArrayLike = 0.0
) -> Mask:
    """Whether numbers are above others by more than their accuracy; broadcast, shape (...).

    Args:
        value: Any numbers; they may be infinite. NaN is above nothing.
        bound: Likewise.
        accuracy: Part of the larger of two numbers by which equal ones may differ.
        zero: Size of what may be round-off of terms that cancel: equal ones may differ by it, too.
    """
    a, b = np.asarray(value, dtype=float), np.asarray(bound, dtype=float)
    with np.errstate(invalid="ignore"):  # infinity less infinity
        margin = accuracy * np.maximum(np.abs(a), np.abs(b))
        return (a > b) & ~(a - b <= np.maximum(np.where(np.isinf(margin), 0.0, margin), zero))


def greatest(values: ArrayLike, accuracy: float = ACCURACY, zero: float = 0.0) -> int:
    """Index of the first of the greatest of numbers (n,); NaN is the greatest of all, as in numpy.

    Arguments as of :func:`exceeds`.
    """
    x = np.asarray(values, dtype=float)
    most = float(x.max())
    margin = max(accuracy * abs(most), zero) if isfinite(most) else 0.0
    return int(np.argmax((x >= most - margin) | (x != x)))


def least(values: ArrayLike, accuracy: float = ACCURACY, zero: float = 0.0) -> int:
    """Index of the first of the least of numbers (n,), or of NaN; arguments likewise."""
    return greatest(-np.asarray(values, dtype=float), accuracy, zero)


def ascending(*keys: ArrayLike, accuracy: float = ACCURACY, zero: float = 0.0) -> Indices:
    """Indices that sort by the first key, then by the second, and so on; ties keep their order.

    Args:
        keys: Numbers, shape (n,) each; NaN comes last.
        accuracy: As of :func:`ranks`.
        zero: Likewise.
    """
    return np.lexsort([ranks(key, accuracy, zero) for key in reversed(keys)])


def ranks(values: ArrayLike, accuracy: float = ACCURACY, zero: float = 0.0) -> Indices:
    """0 for the least of numbers (n,) and all that equal it, 1 for the next, and so on; NaN last.

    Arguments as of :func:`exceeds`. Numbers are equal, too, if others between them connect them.
    """
    x = np.asarray(values, dtype=float)
    order, result = np.argsort(x, kind="stable"), np.zeros(len(x), dtype=np.intp)
    before, after = x[order[:-1]], x[order[1:]]
    larger = exceeds(after, before, accuracy, zero) | (np.isnan(after) & ~np.isnan(before))
    result[order[1:]] = np.cumsum(larger)
    return result
