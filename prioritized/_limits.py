"""Limits of rates or torques: a lower and an upper one for each actuator."""

import numpy as np
from numpy.typing import ArrayLike

import argument_checks as check
from argument_checks import Array, Indices


def limits(name: str, value: tuple[ArrayLike, ArrayLike] | None, n: int) -> tuple[Array, Array]:
    """Lower and upper limits of n actuators, read-only, shape (n,) each; None is infinite.

    Each of the pair is n numbers, or one for all. Equal limits are a lock.

    Raises:
        ValueError: Not a pair, a wrong length, NaN, or a lower limit above the upper one.
    """
    if value is None:
        value = (-np.inf, np.inf)
    try:
        lower, upper = value
    except (TypeError, ValueError):
        raise ValueError(
            f"{name} must be a pair (lower, upper), got {check.shown(value)}"
        ) from None
    lower, upper = _side(name, lower, n), _side(name, upper, n)
    crossed = (lower > upper) | (lower == np.inf) | (upper == -np.inf)
    for k in np.flatnonzero(crossed):
        pair = f"{lower[k]:g} and {upper[k]:g} for actuator {k}"
        raise ValueError(f"{name} must have lower limits below the upper ones, got {pair}")
    return check.frozen(lower), check.frozen(upper)


def _side(name: str, value: ArrayLike, n: int) -> Array:
    """Numbers (n,), infinite ones among them."""
    try:
        infinite = np.asarray(False if check.is_masked(value) else np.isinf(value))
    except (TypeError, ValueError):  # no numbers: the check says so
        infinite = np.asarray(False)
    x = check.real(name, np.where(infinite, 0.0, value) if infinite.any() else value)
    if x.shape not in ((), (n,)):
        raise ValueError(f"{name} must be two numbers or two rows of {n}, got shape {x.shape}")
    return np.broadcast_to(np.where(infinite, value, x) if infinite.any() else x, (n,))


def limits_of_survivors(
    name: str, value: tuple[ArrayLike, ArrayLike] | None, n: int, survivors: Indices
) -> tuple[Array, Array]:
    """The same of the survivors among n actuators; limits of all n are cut to them."""
    sides = () if value is None else value
    try:
        of_all = any(np.shape(side) == (n,) for side in sides)
    except (TypeError, ValueError):  # no pair of numbers: the check says so
        of_all = False
    if not of_all:
        return limits(name, value, len(survivors))
    lower, upper = limits(name, value, n)
    return check.frozen(lower[survivors]), check.frozen(upper[survivors])
