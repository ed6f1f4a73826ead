"""How accurately the numbers of a model state its geometry."""

import mujoco
import numpy as np

from sim.array import Array

FEWEST_DIGITS, MOST_DIGITS = 5, 11
"""Of a length: fewer are taken for a design value that is exact, more for a number in full."""
_DIGITS = np.arange(1, 9)
"""Of axes and quaternions as they were written; up to three are taken for a design value."""
_FEWEST_OF_UNITS = 4
COARSEST = 0.5e-4
"""What these digits amount to at most."""
_NEARBY = np.arange(-2, 3)
SMALLEST_ANGLE_RAD = 1e-5
"""Smaller ones are nobody's design: the component should be zero and was rounded."""


def written_accuracy(model: mujoco.MjModel) -> float:
    """Rounding of the numbers in a model, in rad or relative length; 0 where it shows none.

    A length of five to eleven significant digits, and an axis or quaternion of four to eight, was
    rounded in its last one; a component of an axis or quaternion that is not zero and below 1e-5
    should have been zero.
    """
    points = np.isin(model.eq_type, (mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD))
    lengths = [model.body_pos, model.jnt_pos, model.site_pos, model.eq_data[points, :3]]
    of_lengths = np.abs(np.concatenate([A.ravel() for A in lengths]))
    largest = of_lengths.max(initial=0.0)
    of_points = _largest_rounding(of_lengths[of_lengths > 0.0]) / largest if largest else 0.0
    directions = model.jnt_axis, model.body_quat, model.site_quat
    return max(of_points, *(float(halves_of_units(A).max(initial=0.0)) for A in directions))


def halves_of_units(unit: Array) -> Array:
    """Half units of the last digits in which unit vectors (n, k) were rounded, else zero; (n, k).

    Their norms are not in the file. The ratios of their components are those of the written ones,
    of so many digits each: few enough are tried for the largest component.
    """
    unit = np.abs(unit)
    largest, tiny = unit.max(axis=1, keepdims=True, initial=0.0), unit < SMALLEST_ANGLE_RAD
    most, nearby = (A.ravel() for A in np.meshgrid(_DIGITS, _NEARBY, indexing="ij"))
    tried = np.round(largest * 10.0**most) + nearby  # (n, tries)
    written = (tried / 10.0**most)[..., None] * (unit / largest)[:, None]
    written[np.broadcast_to(tiny[:, None], written.shape)] = 1.0
    whole = _shows(written, most[:, None]).all(axis=-1)
    first = whole.argmax(axis=1)
    written, most = written[np.arange(len(unit)), first], most[first][:, None]
    halves = half_units(written, most, last_places(written).min(axis=1, keepdims=True))
    halves[~whole.any(axis=-1) | (most[:, 0] < _FEWEST_OF_UNITS)] = 0.0
    return np.where(tiny, np.where(unit > 1e-15, unit, 0.0), halves)


def half_units(x: Array, most: Array | int, last: Array | float) -> Array:
    """Half units of the last digits of positive numbers as they were written.

    Short ones may have lost their zeros: down to the last place, or to the most digits of any.
    """
    own, lost = last_places(x), np.maximum(np.floor(np.log10(x)) - most + 1, last)
    short = significant_digits(x) < FEWEST_DIGITS
    return 0.5 * 10.0 ** np.where(short, np.minimum(own, lost), own)


def last_places(x: Array) -> Array:
    """Exponents of the last digits of positive numbers as they were written."""
    return np.floor(np.log10(x)) - significant_digits(x) + 1


def significant_digits(x: Array) -> Array:
    """Of positive numbers as they were written; :data:`MOST_DIGITS` + 1 for those in full."""
    digits = np.full(x.shape, MOST_DIGITS + 1)
    for n in range(MOST_DIGITS, 0, -1):
        digits[_shows(x, n)] = n
    return digits


def _shows(x: Array, digits: Array | int) -> Array:
    """Whether so many digits are all that numbers have."""
    unit = 10.0 ** (np.floor(np.log10(x)) - digits + 1)
    return np.abs(np.round(x / unit) * unit - x) < 1e-14 * x


def _largest_rounding(x: Array) -> float:
    """Half a unit in the last digit, the largest among positive numbers of which it shows."""
    digits = significant_digits(x)
    rounded = x[(digits >= FEWEST_DIGITS) & (digits <= MOST_DIGITS)]
    return float((0.5 * 10.0 ** last_places(rounded)).max(initial=0.0))
