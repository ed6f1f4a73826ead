"""Position, rate and acceleration limits combined in a box of rates that never becomes empty."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

import argument_checks as check
from argument_checks import Array, Mask
from kernels import lib, pointer
from prioritized._solver.arrays import ReadOnly


@dataclass(frozen=True)
class RateBox(ReadOnly):
    """Admissible rates of joints in the next tick, computed by :func:`viable_rates`.

    Attributes:
        lower: Smallest rates, shape (..., n), [m]/[s] or [rad]/[s].
        upper: Largest rates, never below `lower`.
        viable: Whether all limits can hold at the next tick and every later one, shape (..., n).
            Where they cannot, `lower` and `upper` equal the rate that violates them least.
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
    """Return the largest box of next rates from which all limits can be satisfied forever.

    Rates w are constant during a tick: the position becomes x + T w, and (w - v) / T is the
    acceleration. Every rate in the box satisfies all limits at the next tick and leads to a state
    whose box is not empty; no rate outside does. The theory page has the proof. It extends Del
    Prete, "Joint position and velocity bounds in discrete-time acceleration/torque control of robot
    manipulators" (2018), whose condition is that of continuous braking.

    Where no rate satisfies all limits (a disturbance, or limits that moved), acceleration limits
    have priority, then rate limits, then the position limit on the far side. The joint brakes as
    hard as it can, then returns to the violated position limit as fast as the other limits allow.

    Args:
        position: Present positions x, shape (..., n), [m] or [rad].
        rate: Rates v of the last tick, shape (..., n), [m]/[s] or [rad]/[s].
        position_limits: Pair (lower, upper), each one number or of shape (..., n), infinite where
            there is no limit.
        rate_limits: Pair with lower <= 0 <= upper: joints must be able to stop.
        acceleration_limits: Pair with lower < 0 < upper: joints must be able to brake.
        period_s: Duration T of a tick [s].
    """
    T = check.number("period_s", period_s, check.SMALLEST)
    pairs = position_limits, rate_limits, acceleration_limits
    plain = _plain(position, rate, pairs)
    box = None if plain is None else _box(plain, T)
    if box is not None:
        return box
    every = np.broadcast_arrays(*_checked(position, rate, pairs))
    box = _box([A.ravel() for A in every], T)
    assert box is not None  # _checked raises for all that _box refuses
    lead = every[0].shape
    return RateBox(box.lower.reshape(lead), box.upper.reshape(lead), box.viable.reshape(lead))


def _plain(position: Any, rate: Any, pairs: tuple[Any, ...]) -> list[Array] | None:
    """Return all arguments if they are plain arrays (n,), whose checks would take far longer."""
    if type(position) is not np.ndarray or position.ndim != 1:
        return None
    for pair in pairs:
        is_pair = type(pair) is tuple or (type(pair) is np.ndarray and pair.ndim)
        if not is_pair or len(pair) != 2:
            return None
    every = [position, rate, *pairs[0], *pairs[1], *pairs[2]]
    for A in every:
        if type(A) is not np.ndarray or A.dtype is not _FLOAT64 or A.shape != position.shape:
            return None
    return every


def _box(arguments: list[Array], T: float) -> RateBox | None:
    """Return the box of plain arrays (n,); None if one of them is invalid."""
    n = len(arguments[0])
    lower, upper, viable = np.empty(n), np.empty(n), np.empty(n, dtype=bool)
    box = pointer(lower), pointer(upper), pointer(viable)
    if not lib.viable_box(n, pointer(np.concatenate(arguments)), T, *box):
        return None
    result = object.__new__(RateBox)  # without checks: the arrays are new
    for name, A in (("lower", lower), ("upper", upper), ("viable", viable)):
        A.setflags(write=False)
        result.__dict__[name] = A
    return result


def _checked(position: ArrayLike, rate: ArrayLike, pairs: tuple[Any, ...]) -> list[Array]:
    """Return all arguments as arrays (..., n) or one number, with broadcastable leading axes."""
    x = check.array("position", position)
    if not x.ndim:
        raise ValueError("position must have shape (..., n), got one number")
    v = check.array("rate", rate, ..., n := x.shape[-1])
    names = "position_limits", "rate_limits", "acceleration_limits"
    positions, rates, accelerations = (
        check.limits(name, pair, n, batch=True) for name, pair in zip(names, pairs, strict=True)
    )
    if (rates[0] > 0).any() or (rates[1] < 0).any():
        got = check.short_repr(pairs[1])
        raise ValueError(f"rate_limits must have lower <= 0 <= upper, got {got}")
    if (accelerations[0] > -check.SMALLEST).any() or (accelerations[1] < check.SMALLEST).any():
        got = check.short_repr(pairs[2])
        raise ValueError(f"acceleration_limits must have lower < 0 < upper, got {got}")
    leads = {"position": x, "rate": v, "position_limits": positions[0]}
    leads |= {"rate_limits": rates[0], "acceleration_limits": accelerations[0]}
    check.common_axes({name: A.shape[:-1] for name, A in leads.items()})
    return [x, v, *positions, *rates, *accelerations]


_FLOAT64 = np.dtype(np.float64)
