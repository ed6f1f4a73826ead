"""How accurately the numbers of a model state its geometry."""

import mujoco
import numpy as np

from sim.array import Array

_FEWEST_DIGITS, _MOST_DIGITS = 5, 11
"""Fewer are taken for a design value that is meant exactly, more for a number that is exact."""
_SMALLEST_ANGLE_RAD = 1e-5
"""Smaller ones are nobody's design: the component should be zero and was rounded."""


def written_accuracy(model: mujoco.MjModel) -> float:
    """Rounding of the numbers in a model, in rad or relative length; 0 where it shows none.

    A length of five to eleven significant digits was rounded in its last one; a component of an
    axis or quaternion that is not zero and below 1e-5 should have been zero.
    """
    anchors = model.eq_data[:, :6]
    lengths = [model.body_pos, model.jnt_pos, model.site_pos, anchors]
    of_lengths = np.abs(np.concatenate([A.ravel() for A in lengths]))
    directions = [model.jnt_axis, model.body_quat, model.site_quat]
    components = np.abs(np.concatenate([A.ravel() for A in directions]))
    components = components[(components > 1e-15) & (components < _SMALLEST_ANGLE_RAD)]
    largest = of_lengths.max(initial=0.0)
    rounding = _largest_rounding(of_lengths[of_lengths > 0.0]) / largest if largest else 0.0
    return max(float(components.max(initial=0.0)), rounding)


def _largest_rounding(x: Array) -> float:
    """Half a unit in the last digit, the largest among positive numbers of which it shows."""
    digits = np.full(x.shape, _MOST_DIGITS + 1)
    for n in range(_MOST_DIGITS, 0, -1):
        unit = 10.0 ** (np.floor(np.log10(x)) - n + 1)
        digits[np.abs(np.round(x / unit) * unit - x) < 1e-14 * x] = n
    rounded = x[(digits >= _FEWEST_DIGITS) & (digits <= _MOST_DIGITS)]
    shown = digits[(digits >= _FEWEST_DIGITS) & (digits <= _MOST_DIGITS)]
    units = 10.0 ** (np.floor(np.log10(rounded)) - shown + 1)
    return float(units.max(initial=0.0)) / 2.0
