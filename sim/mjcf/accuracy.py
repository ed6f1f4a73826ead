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
    return (*_of_lengths(model), *_of_units(model))


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


def _of_lengths(model: mujoco.MjModel) -> list[Rounding]:
    fields = _lengths(model)
    x = np.abs(np.concatenate([A.ravel() for A in fields.values()]))
    x = x[x > 0.0]
    digits = _significant_digits(x)
    is_rounded = (digits >= _FEWEST_DIGITS) & (digits <= _MOST_DIGITS)
    if not is_rounded.any():
        return []
    written_by_program = 2 * is_rounded.sum() >= (digits <= _MOST_DIGITS).sum()
    fewest = 1 if written_by_program else _FEWEST_DIGITS
    most, last, found = digits[is_rounded].max(), _last_places(x[is_rounded]).min(), []
    for name, A in fields.items():
        size = np.where(A == 0.0, 1.0, np.abs(A))
        digits, halves = _significant_digits(size), _half_units(size, most, last)
        halves[(A == 0.0) | (digits < fewest) | (digits > _MOST_DIGITS)] = 0.0
        found += _positive(name, halves, is_unit=False)
    return found


def _of_units(model: mujoco.MjModel) -> list[Rounding]:
    fields = {name: getattr(model, name) for name in ("jnt_axis", "body_quat", "site_quat")}
    halves = {name: _halves_of_units(A) for name, A in fields.items()}
    return [each for name, A in halves.items() for each in _positive(name, A, is_unit=True)]


def _positive(name: str, halves: Array, *, is_unit: bool) -> list[Rounding]:
    return [
        Rounding(name, row, column, float(halves[row, column]), is_unit)
        for row, column in np.argwhere(halves > 0.0).tolist()
    ]


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
    first = whole.argmax(axis=1)
    written, most = written[np.arange(len(unit)), first], most[first][:, None]
    halves = _half_units(written, most, _last_places(written).min(axis=1, keepdims=True))
    halves[~whole.any(axis=-1) | (most[:, 0] < _FEWEST_OF_UNITS)] = 0.0
    return np.where(tiny, np.where(unit > 1e-15, unit, 0.0), halves)


def _half_units(x: Array, most: Array | int, last: Array | float) -> Array:
    """Half units of the last digits of positive numbers as they were written.

    Short ones may have lost zeros, to the most digits or the last place of any, whichever is first.
    """
    own, is_short = _last_places(x), _significant_digits(x) < _FEWEST_DIGITS
    lost = np.minimum(own, np.maximum(_exponents(x) - most + 1, last))
    return 0.5 * 10.0 ** np.where(is_short, lost, own)


def _exponents(x: Array) -> Array:
    return np.floor(np.log10(x))


def _last_places(x: Array) -> Array:
    """Exponents of the last digits of positive numbers as they were written."""
    return _exponents(x) - _significant_digits(x) + 1


def _significant_digits(x: Array) -> Array:
    """Digits of positive numbers as they were written; _MOST_DIGITS + 1 of those in full."""
    shown = [_shows(x, n) for n in range(1, _MOST_DIGITS + 1)]
    return 1 + np.argmax([*shown, np.full(x.shape, True)], axis=0)


def _shows(x: Array, digits: Array | int) -> Array:
    """Whether so many digits are all that numbers have."""
    unit = 10.0 ** (_exponents(x) - digits + 1)
    return np.abs(np.round(x / unit) * unit - x) < 1e-14 * x
