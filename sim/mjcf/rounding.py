"""Which numbers of a model were rounded in their last printed digit, and by how much."""

from collections.abc import Iterator
from typing import NamedTuple

import mujoco
import numpy as np

from sim.array import Array
from sim.mjcf.accuracy import SMALLEST_ANGLE_RAD, decimals_of_units, significant_digits

_FEWEST_DIGITS, _MOST_DIGITS = 5, 11
"""Of the longest length to the file's last decimal: fewer are a design value, more are in full."""
_POINTS = int(mujoco.mjtEq.mjEQ_CONNECT), int(mujoco.mjtEq.mjEQ_WELD)


class Rounding(NamedTuple):
    """A number of the model and half a unit of its last digit.

    Attributes:
        field: Of `MjModel`.
        row: First index.
        column: Second index.
        half_unit: In the number's own unit.
        is_unit: Whether the row is a direction or a quaternion, of unit norm.
    """

    field: str
    row: int
    column: int
    half_unit: float
    is_unit: bool


def roundings(model: mujoco.MjModel) -> tuple[Rounding, ...]:
    """Those of bodies, joints, sites and closures. Zeros and ones are exact."""
    return (*_of_lengths(model), *_of_units(model))


def _of_lengths(model: mujoco.MjModel) -> Iterator[Rounding]:
    """Lengths of one file have one last decimal; those of fewer digits have lost their zeros."""
    eq_data = np.where(np.isin(model.eq_type, _POINTS)[:, None], model.eq_data, 0.0)[:, :3]
    fields = {name: getattr(model, name) for name in ("body_pos", "jnt_pos", "site_pos")}
    fields["eq_data"] = eq_data
    x = np.abs(np.concatenate([A.ravel() for A in fields.values()]))
    x = x[x > 0.0]
    digits = significant_digits(x)
    written = digits <= _MOST_DIGITS
    if not written.any():
        return
    last = np.floor(np.log10(x)).astype(int) - digits + 1  # exponent of the last digit
    typical = int(np.percentile(last[written], 25, method="nearest"))
    if np.floor(np.log10(x.max())) - typical + 1 < _FEWEST_DIGITS:
        return
    for name, A in fields.items():
        for row, column in np.argwhere(A != 0.0):
            size = np.abs(A[row, column : column + 1])
            n = int(significant_digits(size)[0])
            if n <= _MOST_DIGITS:
                own = int(np.floor(np.log10(size[0]))) - n + 1
                half = 0.5 * 10.0 ** min(own, typical)
                yield Rounding(name, int(row), int(column), half, is_unit=False)


def _of_units(model: mujoco.MjModel) -> Iterator[Rounding]:
    for name in ("jnt_axis", "body_quat", "site_quat"):
        unit = np.abs(getattr(model, name))
        halves = 0.5 * 10.0 ** -decimals_of_units(unit)
        for row, column in np.argwhere((unit > 1e-15) & (unit < 1.0)):
            tiny = unit[row, column] < SMALLEST_ANGLE_RAD
            half = float(unit[row, column] if tiny else halves[row])
            if half > 0.0:
                yield Rounding(name, int(row), int(column), half, is_unit=True)


def moved(model: mujoco.MjModel, rounding: Rounding, by: float) -> Array:
    """Move a number by a part of its half unit, in place; returns the row that was there."""
    row = getattr(model, rounding.field)[rounding.row]
    before = row.copy()
    row[rounding.column] += by * rounding.half_unit
    if rounding.is_unit:
        row /= np.linalg.norm(row)
    return before
