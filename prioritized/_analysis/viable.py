"""Position, rate and acceleration limits as one box of rates that never becomes empty."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np
from numpy.typing import ArrayLike

import argument_checks as check
from argument_checks import Array, Mask
from argument_checks.ties import ACCURACY, exceeds
from prioritized._solver.arrays import ReadOnly

_ROUND_OFF = 1e-12
"""Part of positions and rates by which limits may be missed and still count as kept."""


@dataclass(frozen=True)
class RateBox(ReadOnly):
    """Rates that joints may have in the next tick, made by :func:`viable_rates`.

    Attributes:
        lower: Smallest rates, shape (..., n), [m]/[s] or [rad]/[s].
        upper: Largest rates, never below `lower`.
        viable: Whether all limits can hold at the next tick and every later one, shape (..., n).
            Where they cannot, `lower` and `upper` are the one rate that violates them least.
    """

    lower: Array
    upper: Array
    viable: Mask


def viable_rates(
    position: ArrayLike,
    rate: ArrayLike,
    *,
    position_limits: Sequence[ArrayLike] | Array,
    rate_limits: Sequence[ArrayLike] | Array,
    acceleration_limits: Sequence[ArrayLike] | Array,
    period_s: float,
) -> RateBox:
    """The largest box of rates for the next tick from which every limit can be kept for ever.

    Rates w are constant during a tick: the position becomes x + T w, and (w - v) / T is the
    acceleration. Every rate in the box keeps all limits at the next tick and leaves a state whose
    box is not empty; no rate outside does. The theory page has the proof. It extends Del Prete,
    "Joint position and velocity bounds in discrete-time acceleration/torque control of robot
    manipulators" (2018), whose condition is that of continuous braking.

    Where no rate keeps all limits (a disturbance, limits that moved), accelerations are within
    theirs all the same, then rates, then the position limit on the far side; the violated position
    limit yields: the joint brakes as hard as it can, then returns as fast as the others allow.

    Args:
        position: Present positions x, shape (..., n), [m] or [rad].
        rate: Present rates v, those of the last tick, shape (..., n).
        position_limits: Pair (lower, upper); each is one number, or has shape (..., n). Infinite
            where there is none.
        rate_limits: Likewise, with lower <= 0 <= upper: joints must be able to rest.
        acceleration_limits: Likewise, with lower < 0 < upper: joints must be able to brake.
        period_s: Duration T of a tick.

    Raises:
        ValueError: An argument has a wrong shape or is not a number, a pair is not a lower and an
            upper limit, or zero is not between them as said above.
    """
    x = check.real("position", position)
    if not x.ndim:
        raise ValueError("position must have shape (..., n), got one number")
    n, T = x.shape[-1], check.positive("period_s", period_s)
    v = check.vector("rate", rate, n)
    x_min, x_max = check.limits("position_limits", position_limits, n)
    v_min, v_max = check.limits("rate_limits", rate_limits, n)
    a_min, a_max = check.limits("acceleration_limits", acceleration_limits, n)
    if (v_min > 0).any() or (v_max < 0).any():
        raise ValueError(f"rate_limits must be on both sides of 0, got {check.shown(rate_limits)}")
    if (a_min > -check.SMALLEST).any() or (a_max < check.SMALLEST).any():
        raise ValueError(
            f"acceleration_limits must be below and above 0, got {check.shown(acceleration_limits)}"
        )
    leads = {"position": x, "rate": v, "position_limits": x_min}
    leads |= {"rate_limits": v_min, "acceleration_limits": a_min}
    check.common_axes({name: A.shape[:-1] for name, A in leads.items()})

    slowest, fastest = v + T * a_min, v + T * a_max
    least, most = -_stoppable(x - x_min, a_max, T), _stoppable(x_max - x, -a_min, T)
    size = np.maximum(abs(x), np.maximum(_finite(abs(x_min)), _finite(abs(x_max))))
    lower = reduce(np.maximum, (slowest, v_min, least))
    upper = reduce(np.minimum, (fastest, v_max, most))
    viable = lower - upper <= _ROUND_OFF * (size / T + abs(v))
    # Beyond a limit, the return must not be so fast that the other one cannot be kept.
    most = np.where(x > x_max, np.maximum(most, least), most)
    least = np.where(x < x_min, np.minimum(least, most), least)
    lower, upper = _nearest(v_min, v_max, slowest, fastest)
    lower, upper = _nearest(least, most, lower, upper)
    # Where braking just suffices, one rate is left: round-off would make a direction of it.
    upper = np.where(exceeds(upper, lower, zero=ACCURACY * abs(v)), upper, lower)
    return RateBox(lower, upper, viable)


def _stoppable(distance: Array, braking: Array, T: float) -> Array:
    """The largest rate w of the next tick after which hard braking ends within a distance d.

    In n ticks the joint moves by T (w + (w - a T) + ... + (w - (n - 1) a T)), most far in
    n = ceil(w / (a T)) of them, the terms above zero. As the largest over n is to be d,
    w = min over n of d / (n T) + a T (n - 1) / 2, and the least is where d / (a T^2) lies between
    n (n - 1) / 2 and n (n + 1) / 2. A negative distance is to be made good in one tick.
    """
    d, a = _finite(distance), _finite(braking)
    # sqrt(8 d / (a T^2)), in an order that neither over- nor underflows
    root = np.sqrt(8.0 * np.maximum(d, 0.0) / braking) / T
    n = np.maximum(np.ceil((np.hypot(1.0, root) - 1.0) / 2.0), 1.0)
    return np.where(np.isinf(distance), distance, d / (n * T) + a * T * (n - 1.0) / 2.0)


def _finite(A: Array) -> Array:
    """Zero where infinite: another term decides there."""
    return np.where(np.isinf(A), 0.0, A)


def _nearest(lower: Array, upper: Array, least: Array, most: Array) -> tuple[Array, Array]:
    """Part of [lower, upper] inside [least, most]; the point nearest to it if there is none."""
    return np.clip(lower, least, most), np.clip(upper, least, most)
