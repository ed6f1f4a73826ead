"""Rates from which limits can be kept for ever, compiled: one joint after another.

All compiled code stands in one file, because the compiler's cache notices a change of that file
alone.
"""

import math

import numpy as np
from numba import njit, types

from argument_checks.arrays import LARGEST, SMALLEST
from argument_checks.compilation import kernel
from argument_checks.ties import ACCURACY

_ROUND_OFF = 1e-12
"""Part of positions and rates by which limits may be missed and still count as kept."""

_given = types.Array(types.float64, 1, "A", readonly=True)
_new, _mask = types.Array(types.float64, 1, "C"), types.Array(types.boolean, 1, "C")
_inlined = njit(error_model="numpy")


@_inlined
def _are_limits(lower, upper):
    """Whether these are a lower and an upper limit, infinite where there is none; NaN is not."""
    is_number = abs(lower) < LARGEST or lower == -math.inf
    return is_number and (abs(upper) < LARGEST or upper == math.inf) and lower <= upper


@_inlined
def _stoppable(distance, braking, T):
    """The largest rate w of the next tick after which hard braking ends within a distance d.

    In n ticks the joint moves by T (w + (w - a T) + ... + (w - (n - 1) a T)), most far in
    n = ceil(w / (a T)) of them, the terms above zero. As the largest over n is to be d,
    w = min over n of d / (n T) + a T (n - 1) / 2, and the least is where d / (a T^2) lies between
    n (n - 1) / 2 and n (n + 1) / 2. A negative distance is to be made good in one tick.
    """
    if math.isinf(distance):
        return distance
    # sqrt(8 d / (a T^2)), in an order that neither over- nor underflows
    root = math.sqrt(8.0 * max(distance, 0.0) / braking) / T
    n = max(np.ceil((math.hypot(1.0, root) - 1.0) / 2.0), 1.0)
    return distance / (n * T) + _finite(braking) * T * (n - 1.0) / 2.0


@_inlined
def _finite(number):
    """Zero where infinite: another term decides there."""
    return 0.0 if math.isinf(number) else number


@_inlined
def _clip(number, least, most):
    """The nearest number in an interval."""
    return min(max(number, least), most)


@_inlined
def _exceeds(value, bound, zero):
    """:func:`argument_checks.ties.exceeds` of two numbers."""
    room = max(ACCURACY * _finite(max(abs(value), abs(bound))), zero)
    return value > bound and not value - bound <= room


@kernel(types.boolean(*(_given,) * 8, types.float64, _new, _new, _mask))
def viable_box(x, v, x_min, x_max, v_min, v_max, a_min, a_max, T, lower, upper, viable):
    """The box of :func:`prioritized.viable_rates`, written into `lower`, `upper` and `viable`.

    All arrays are (n,). It returns whether the arguments are such as that function takes; else
    what is written means nothing.
    """
    for k in range(len(x)):
        if not (
            abs(x[k]) < LARGEST
            and abs(v[k]) < LARGEST
            and _are_limits(x_min[k], x_max[k])
            and _are_limits(v_min[k], v_max[k])
            and _are_limits(a_min[k], a_max[k])
            and v_min[k] <= 0.0 <= v_max[k]
            and a_min[k] <= -SMALLEST
            and a_max[k] >= SMALLEST
        ):
            return False
        slowest, fastest = v[k] + T * a_min[k], v[k] + T * a_max[k]
        least = -_stoppable(x[k] - x_min[k], a_max[k], T)
        most = _stoppable(x_max[k] - x[k], -a_min[k], T)
        size = max(abs(x[k]), _finite(abs(x_min[k])), _finite(abs(x_max[k])))
        lack = max(slowest, v_min[k], least) - min(fastest, v_max[k], most)
        viable[k] = lack <= _ROUND_OFF * (size / T + abs(v[k]))
        # Beyond a limit, the return must not be so fast that the other one cannot be kept.
        if x[k] > x_max[k]:
            most = max(most, least)
        if x[k] < x_min[k]:
            least = min(least, most)
        slow, fast = _clip(v_min[k], slowest, fastest), _clip(v_max[k], slowest, fastest)
        low, high = _clip(least, slow, fast), _clip(most, slow, fast)
        # Where braking just suffices, one rate is left: round-off would make a direction of it.
        lower[k], upper[k] = low, high if _exceeds(high, low, ACCURACY * abs(v[k])) else low
    return True
