"""Accuracy of the geometry that a file states: which numbers were rounded, and how far.

A program writes numbers in one format, of so many significant digits (%.6g; %.9g for a float32) or
of so many decimals (%.6f), and zeros at their ends are lost. Hand-written numbers are short, and
computed ones that are written in full have 15 to 17 digits: both are taken for exact.
"""

from typing import NamedTuple

import mujoco
import numpy as np

from sim.array import Array

_POINTS = int(mujoco.mjtEq.mjEQ_CONNECT), int(mujoco.mjtEq.mjEQ_WELD)
_UNITS = "jnt_axis", "body_quat", "site_quat"
"""Fields of directions and quaternions."""

_FEWEST_DIGITS = 5
"""Digits of a length that was rounded: fewer state a design, as 0.1234 m to 0.1 mm."""
_MOST_DIGITS = 11
"""Beyond, a length is in full. Of 10,000 such numbers one ends in zeros and shows fewer digits."""
_FEWEST_OF_UNITS = 4
"""Digits of a direction that was rounded: 0.8660 is a cosine; 0.3 -0.5 0.8 is chosen."""
_TRIED = np.arange(1, 9)
"""Digits of directions that are tried: by chance one in full seems to have nine more than once in
10,000 times, as the comparison resolves 1e-14."""
_NEARBY = np.arange(-2, 3)
"""Units of the last digit by which the largest component may differ once its direction has norm 1:
1 for the rounding of four components, which moves the norm, and 0.5 for its own."""
_SMALLEST_ANGLE_RAD = 1e-5
"""Smaller ones should be zero: 3.1416 for pi leaves 7e-6 of it. Nobody chooses such an angle."""
COARSEST = 0.5e-4
"""Coarsest accuracy that these digits amount to, in rad or relative length."""


class Rounding(NamedTuple):
    """Half a unit of the last digit of a number: of a field of `MjModel`, in a row and column.

    `is_unit` says whether the row is a direction or a quaternion, of unit norm.
    """

    field: str
    row: int
    column: int
    half_unit: float
    is_unit: bool


def written_accuracy(model: mujoco.MjModel) -> float:
    """Largest rounding of the numbers of a model, in rad or relative length; 0 if it shows none."""
    largest = max(float(np.abs(A).max(initial=0.0)) for A in _lengths(model).values())
    each = (r.half_unit if r.is_unit else r.half_unit / largest for r in roundings(model))
    return max(each, default=0.0)


def roundings(model: mujoco.MjModel) -> tuple[Rounding, ...]:
    """Rounded numbers of bodies, joints, sites and closures.

    A length of five to eleven significant digits was rounded in its last one. Where at least half
    of the lengths are such, a program wrote them all, and shorter ones lost their zeros: theirs is
    the last place of the format, whose digits and decimals are the most that the rounded ones show.
    A direction or quaternion of four to eight digits was rounded in its last decimal; a component
    of it that is not zero and below 1e-5 should have been zero.
    """
    lengths = _lengths(model)
    flat = _halves_of_lengths(np.concatenate([A.ravel() for A in lengths.values()]))
    found, start = {name: _halves_of_units(getattr(model, name)) for name in _UNITS}, 0
    for name, A in lengths.items():
        found[name], start = flat[start : start + A.size].reshape(A.shape), start + A.size
    return tuple(
        Rounding(name, row, column, float(found[name][row, column]), name in _UNITS)
        for name in (*lengths, *_UNITS)
        for row, column in np.argwhere(found[name] > 0.0).tolist()
    )


def moved(model: mujoco.MjModel, rounding: Rounding, by: float) -> Array:
    """Move a number by a part of its half unit, in place; return the row that was there."""
    row = getattr(model, rounding.field)[rounding.row]
    before = row.copy()
    row[rounding.column] += by * rounding.half_unit
    if rounding.is_unit:
        row /= np.linalg.norm(row)
    return before


def _lengths(model: mujoco.MjModel) -> dict[str, Array]:
    """Numbers of each field that are lengths, zero where they are none."""
    fields = {name: getattr(model, name) for name in ("body_pos", "jnt_pos", "site_pos")}
    of_points = np.isin(model.eq_type, _POINTS)[:, None]
    return fields | {"eq_data": np.where(of_points, model.eq_data, 0.0)[:, :3]}


def _halves_of_lengths(x: Array) -> Array:
    """Half units of the last digits in which lengths (n,) were rounded, else zero; (n,)."""
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
    """Half units of the last digits in which unit vectors (n, k) were rounded, else zero; (n, k).

    Their norms are not in the file. The ratios of their components are those of the written ones,
    of so many digits each: few enough are tried for the largest component. Short components have
    lost their zeros, as short lengths have.
    """
    unit = np.abs(unit)
    largest, tiny = unit.max(axis=1, keepdims=True, initial=0.0), unit < _SMALLEST_ANGLE_RAD
    most, nearby = (A.ravel() for A in np.meshgrid(_TRIED, _NEARBY, indexing="ij"))
    tried = np.round(largest * 10.0**most) + nearby  # (n, tries)
    written = (tried / 10.0**most)[..., None] * (unit / largest)[:, None]
    written[np.broadcast_to(tiny[:, None], written.shape)] = 1.0
    whole = _shows(written, most[:, None]).all(axis=-1)
    first = np.argmax(whole, axis=1)  # noqa: TID251 - truth values
    written, most = written[np.arange(len(unit)), first], most[first][:, None]
    halves = _half_units(written, most, _last_places(written).min(axis=1, keepdims=True))
    halves[~whole.any(axis=-1) | (most[:, 0] < _FEWEST_OF_UNITS)] = 0.0
    return np.where(tiny, np.where(unit > 1e-15, unit, 0.0), halves)


def _half_units(x: Array, most: Array | int, last: Array | float) -> Array:
    """Half units of the last digits of positive numbers as they were written.

    Short ones may have lost zeros, to the most digits or the last place of any, whichever is first.
    """
    own = _last_places(x)
    lost = np.minimum(own, np.maximum(_last_places(x, most), last))
    places = np.where(_significant_digits(x) < _FEWEST_DIGITS, lost, own)
    # On some processors numpy's powers of ten are not the nearest numbers to them.
    return np.reshape([float(f"5e{place - 1:.0f}") for place in places.flat], places.shape)


def _last_places(x: Array, digits: Array | int | None = None) -> Array:
    """Exponents of the last of so many digits of positive numbers; None is as they were written."""
    return np.floor(np.log10(x)) - (_significant_digits(x) if digits is None else digits) + 1


def _significant_digits(x: Array) -> Array:
    """Digits of positive numbers as they were written; _MOST_DIGITS + 1 of those in full."""
    shown = [_shows(x, n) for n in range(1, _MOST_DIGITS + 1)]
    shown.append(np.full(x.shape, True))
    return 1 + np.argmax(shown, axis=0)  # noqa: TID251 - truth values


def _shows(x: Array, digits: Array | int) -> Array:
    """Whether so many digits are all that numbers have."""
    unit = 10.0 ** _last_places(x, digits)
    return np.abs(np.round(x / unit) * unit - x) < 1e-14 * x
