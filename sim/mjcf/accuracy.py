"""How accurately the numbers of a model state its geometry."""

import mujoco
import numpy as np

from sim.array import Array

_FEWEST_DIGITS, _MOST_DIGITS = 5, 11
"""Of a length: fewer are taken for a design value that is exact, more for a number in full."""
_DECIMALS = np.arange(1, 9)
"""Of axes and quaternions as they were written; up to three are taken for a design value."""
_FEWEST_DECIMALS = 4
COARSEST = 0.5e-4
"""What these digits and decimals amount to at most."""
_NEARBY = np.arange(-2, 3)
_INTEGER = 1e-6
SMALLEST_ANGLE_RAD = 1e-5
"""Smaller ones are nobody's design: the component should be zero and was rounded."""


def written_accuracy(model: mujoco.MjModel) -> float:
    """Rounding of the numbers in a model, in rad or relative length; 0 where it shows none.

    A length of five to eleven significant digits, and an axis or quaternion of four to eight
    decimals, was rounded in its last one; a component of an axis or quaternion that is not zero and
    below 1e-5 should have been zero.
    """
    points = np.isin(model.eq_type, (mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD))
    lengths = [model.body_pos, model.jnt_pos, model.site_pos, model.eq_data[points, :3]]
    of_lengths = np.abs(np.concatenate([A.ravel() for A in lengths]))
    largest = of_lengths.max(initial=0.0)
    of_points = _largest_rounding(of_lengths[of_lengths > 0.0]) / largest if largest else 0.0
    directions = model.jnt_axis, model.body_quat, model.site_quat
    return max(of_points, *(_rounding_of_units(np.abs(A)) for A in directions))


def _rounding_of_units(unit: Array) -> float:
    """The largest rounding of unit vectors (n, k) without signs."""
    tiny = unit[(unit > 1e-15) & (unit < SMALLEST_ANGLE_RAD)].max(initial=0.0)
    return max(float(tiny), float((0.5 * 10.0 ** -decimals_of_units(unit)).max(initial=0.0)))


def decimals_of_units(unit: Array) -> Array:
    """With how many decimals unit vectors (n, k), without signs, were written; else infinite, (n,).

    Their norms are not in the file. The ratios of their components are those of the written ones,
    which are whole numbers of the last decimal: few enough are tried for the largest component.
    """
    if not len(unit):
        return np.zeros(0)
    largest = unit.max(axis=1)
    ratio = unit / largest[:, None]
    candidates = np.round(largest * 10.0 ** _DECIMALS[:, None])[..., None] + _NEARBY
    written = candidates[..., None] * ratio[:, None, :]  # (decimals, n, nearby, k)
    whole = (np.abs(written - np.round(written)) < _INTEGER).all(axis=-1).any(axis=-1)
    decimals = _DECIMALS[whole.argmax(axis=0)].astype(float)
    decimals[~whole.any(axis=0) | (decimals < _FEWEST_DECIMALS)] = np.inf
    return decimals


def significant_digits(x: Array) -> Array:
    """Of positive numbers as they were written; :data:`_MOST_DIGITS` + 1 for those in full."""
    digits = np.full(x.shape, _MOST_DIGITS + 1)
    for n in range(_MOST_DIGITS, 0, -1):
        unit = 10.0 ** (np.floor(np.log10(x)) - n + 1)
        digits[np.abs(np.round(x / unit) * unit - x) < 1e-14 * x] = n
    return digits


def _largest_rounding(x: Array) -> float:
    """Half a unit in the last digit, the largest among positive numbers of which it shows."""
    digits = significant_digits(x)
    rounded = x[(digits >= _FEWEST_DIGITS) & (digits <= _MOST_DIGITS)]
    shown = digits[(digits >= _FEWEST_DIGITS) & (digits <= _MOST_DIGITS)]
    units = 10.0 ** (np.floor(np.log10(rounded)) - shown + 1)
    return float(units.max(initial=0.0)) / 2.0
