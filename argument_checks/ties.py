"""Argmin and argmax that return the first of all values equal to within round-off.

On a symmetric machine many computed numbers are equal except for their last bits, which depend on
the processor. Numbers that agree within the accuracy are treated as equal here, and the first one
in the caller's order is selected.
"""

from math import isfinite

import numpy as np
from numpy.typing import ArrayLike

from argument_checks.arrays import Indices, Mask

ACCURACY = 1e-9
"""Relative accuracy, as in :func:`math.isclose`: above round-off, below differences that matter."""


def exceeds(
    value: ArrayLike, bound: ArrayLike, accuracy: float = ACCURACY, zero: ArrayLike = 0.0
) -> Mask:
    """Return where values exceed bounds by more than their accuracy; the arrays are broadcast.

    Args:
        value: Any numbers, also infinite; NaN exceeds nothing.
        bound: Numbers to compare with.
        accuracy: Relative difference up to which two numbers count as equal.
        zero: Absolute difference up to which they count as equal, for terms that cancel to
            round-off.
    """
    a, b = np.asarray(value, dtype=float), np.asarray(bound, dtype=float)
    with np.errstate(invalid="ignore"):  # infinity less infinity
        margin = accuracy * np.maximum(np.abs(a), np.abs(b))
        return (a > b) & ~(a - b <= np.maximum(np.where(np.isinf(margin), 0.0, margin), zero))


def greatest(values: ArrayLike, accuracy: float = ACCURACY, zero: float = 0.0) -> int:
    """Return the index of the first maximum of numbers (n,), with tolerances of :func:`exceeds`.

    NaN is the greatest, as in numpy.
    """
    x = np.asarray(values, dtype=float)
    most = float(x.max())
    margin = max(accuracy * abs(most), zero) if isfinite(most) else 0.0
    return int(np.argmax((x >= most - margin) | (x != x)))


def least(values: ArrayLike, accuracy: float = ACCURACY, zero: float = 0.0) -> int:
    """Return the index of the first minimum of numbers (n,), with tolerances of :func:`exceeds`."""
    return greatest(-np.asarray(values, dtype=float), accuracy, zero)


def ascending(*keys: ArrayLike, accuracy: float = ACCURACY, zero: float = 0.0) -> Indices:
    """Return indices that sort by the first key, then by the second, etc.; ties keep their order.

    Args:
        keys: Numbers, shape (n,) each; NaN is sorted last.
        accuracy: Relative tolerance of :func:`ranks`.
        zero: Absolute tolerance of :func:`ranks`.
    """
    return np.lexsort([ranks(key, accuracy, zero) for key in reversed(keys)])


def ranks(values: ArrayLike, accuracy: float = ACCURACY, zero: float = 0.0) -> Indices:
    """Return dense ranks of numbers (n,), 0 for the least and all equal to it; NaN is ranked last.

    The tolerances are those of :func:`exceeds`. Equality is transitive: numbers connected by a
    chain of equal ones are equal.
    """
    x = np.asarray(values, dtype=float)
    order, result = np.argsort(x, kind="stable"), np.zeros(len(x), dtype=np.intp)
    before, after = x[order[:-1]], x[order[1:]]
    larger = exceeds(after, before, accuracy, zero) | (np.isnan(after) & ~np.isnan(before))
    result[order[1:]] = np.cumsum(larger)
    return result
