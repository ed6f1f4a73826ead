"""Accuracy of the geometry in a model file, estimated from the digits of its numbers.

A program writes numbers in one format, of so many significant digits (%.6g; %.9g for a float32) or
of so many decimals (%.6f), and trailing zeros are lost. Hand-written numbers are short, and
computed ones written in full have 15 to 17 digits: both are treated as exact.
"""

from typing import NamedTuple

import mujoco
import numpy as np

from sim.array import Array

_POINTS = int(mujoco.mjtEq.mjEQ_CONNECT), int(mujoco.mjtEq.mjEQ_WELD)
_UNITS = "jnt_axis", "body_quat", "site_quat"
"""Fields of directions and quaternions."""

_FEWEST_DIGITS = 5
"""Least number of digits of a rounded length; a shorter one is a design value (0.1234 m)."""
_MOST_DIGITS = 11
"""Largest number of digits of a rounded length; a longer one was written in full.

Of 10,000 numbers written in full one ends in zeros and shows fewer digits."""
_FEWEST_OF_UNITS = 4
"""Least number of digits of a rounded direction: 0.8660 is a cosine; 0.3 -0.5 0.8 is exact."""
_CANDIDATES = np.arange(1, 9)
"""Candidate numbers of digits of directions. Nine would match a full number by chance more than
once in 10,000 times, as the comparison resolves 1e-14."""
_NEARBY = np.arange(-2, 3)
"""Candidate changes of the largest component by normalization, in units of its last digit: rounding
four components changes the norm by up to 1, and the component itself by 0.5."""
_SMALLEST_ANGLE_RAD = 1e-5
"""Largest component treated as a rounded zero: rotation by 3.1416 instead of pi leaves 7e-6."""
COARSEST = 0.5e-4
"""Coarsest accuracy that can result from these digits, in rad or relative length."""


class Rounding(NamedTuple):
    """Half a unit of the last digit of one number in a field of `MjModel`.

    `is_unit` is True if the row is a direction or a quaternion, of unit norm.
    """

    field: str
    row: int
    column: int
    half_unit: float
    is_unit: bool


def written_accuracy(model: mujoco.MjModel) -> float:
    """Return the largest rounding of a model's numbers, in rad or relative length; 0 if none."""
    largest = max(float(np.abs(A).max(initial=0.0)) for A in _lengths(model).values())
    relative = (r.half_unit if r.is_unit else r.half_unit / largest for r in roundings(model))
    return max(relative, default=0.0)


def roundings(model: mujoco.MjModel) -> tuple[Rounding, ...]:
    """Find the rounded numbers of bodies, joints, sites and closures.

    A length of five to eleven significant digits was rounded in its last one. If at least half of
    the lengths are rounded, a program wrote them all and shorter ones lost trailing zeros: their
    last place is that of the format, given by the most digits and decimals of the rounded ones.
    A direction or quaternion of four to eight digits was rounded in its last decimal; its non-zero
    components below 1e-5 are treated as rounded zeros.
    """
    lengths = _lengths(model)
    flat = _halves_of_lengths(np.concatenate([A.ravel() for A in lengths.values()]))
    half_units, start = {name: _halves_of_units(getattr(model, name)) for name in _UNITS}, 0
    for name, A in lengths.items():
        half_units[name], start = flat[start : start + A.size].reshape(A.shape), start + A.size
    return tuple(
        Rounding(name, row, column, float(half_units[name][row, column]), name in _UNITS)
        for name in (*lengths, *_UNITS)
        for row, column in np.argwhere(half_units[name] > 0.0).tolist()
    )


def moved(model: mujoco.MjModel, rounding: Rounding, by: float) -> Array:
    """Change a number in place by a fraction of its half unit; return a copy of the old row."""
    row = getattr(model, rounding.field)[rounding.row]
    before = row.copy()
    row[rounding.column] += by * rounding.half_unit
    if rounding.is_unit:
        row /= np.linalg.norm(row)
    return before


def _lengths(model: mujoco.MjModel) -> dict[str, Array]:
    """Return the numbers of each field that are lengths, with zeros for other numbers."""
    fields = {name: getattr(model, name) for name in ("body_pos", "jnt_pos", "site_pos")}
    of_points = np.isin(model.eq_type, _POINTS)[:, None]
    return fields | {"eq_data": np.where(of_points, model.eq_data, 0.0)[:, :3]}


def _halves_of_lengths(x: Array) -> Array:
    """Return half units of the last digits of rounded lengths (n,), zero for others; (n,)."""
    size = np.where(x == 0.0, 1.0, np.abs(x))
    digits = _significant_digits(size)
    counts = (x != 0.0) & (digits <= _MOST_DIGITS)
    rounded = counts & (digits >= _FEWEST_DIGITS)
    if not rounded.any():
        return np.zeros(len(x))
    if 2 * rounded.sum() < counts.sum():  # not a program
        counts = rounded
    halves = _half_units(size, digits[rounded].max(), _last_places(size[rounded]).min())
    return np.where(counts, halves, 0.0)


def _halves_of_units(unit: Array) -> Array:
    """Return half units of the last digits of rounded unit vectors (n, k), zero for others; (n, k).

    The file's vectors need not be normalized, so only ratios of components are known. Candidates
    for the largest component are tested: the ratios must give all components as many digits.
    Short components have lost trailing zeros, as short lengths have.
    """
    unit = np.abs(unit)
    largest, tiny = unit.max(axis=1, keepdims=True, initial=0.0), unit < _SMALLEST_ANGLE_RAD
    most, nearby = (A.ravel() for A in np.meshgrid(_CANDIDATES, _NEARBY, indexing="ij"))
    candidates = np.round(largest * 10.0**most) + nearby  # (n, tries)
    written = (candidates / 10.0**most)[..., None] * (unit / largest)[:, None]
    written[np.broadcast_to(tiny[:, None], written.shape)] = 1.0
    whole = _shows(written, most[:, None]).all(axis=-1)
    first = np.argmax(whole, axis=1)  # noqa: TID251 - truth values
    written, most = written[np.arange(len(unit)), first], most[first][:, None]
    halves = _half_units(written, most, _last_places(written).min(axis=1, keepdims=True))
    halves[~whole.any(axis=-1) | (most[:, 0] < _FEWEST_OF_UNITS)] = 0.0
    return np.where(tiny, np.where(unit > 1e-15, unit, 0.0), halves)


def _half_units(x: Array, most: Array | int, last: Array | float) -> Array:
    """Return half units of the last digits of positive numbers as they were written.

    Short ones may have lost zeros, up to the most digits or the last place of any number.
    """
    own = _last_places(x)
    lost = np.minimum(own, np.maximum(_last_places(x, most), last))
    places = np.where(_significant_digits(x) < _FEWEST_DIGITS, lost, own)
    # On some processors numpy's powers of ten are not the nearest numbers to them.
    return np.reshape([float(f"5e{place - 1:.0f}") for place in places.flat], places.shape)


def _last_places(x: Array, digits: Array | int | None = None) -> Array:
    """Return exponents of the last of `digits` digits; None counts the digits as written."""
    return np.floor(np.log10(x)) - (_significant_digits(x) if digits is None else digits) + 1


def _significant_digits(x: Array) -> Array:
    """Count the digits of positive numbers as written; _MOST_DIGITS + 1 for those in full."""
    matches = [_shows(x, n) for n in range(1, _MOST_DIGITS + 1)]
    matches.append(np.full(x.shape, True))
    return 1 + np.argmax(matches, axis=0)  # noqa: TID251 - truth values


def _shows(x: Array, digits: Array | int) -> Array:
    """Return whether positive numbers have at most `digits` significant digits."""
    unit = 10.0 ** _last_places(x, digits)
    return np.abs(np.round(x / unit) * unit - x) < 1e-14 * x
