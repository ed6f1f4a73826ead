"""Which numbers of a model were rounded in their last printed digit, and by how much."""

from collections.abc import Iterator
from typing import NamedTuple

import mujoco
import numpy as np

from sim.array import Array
from sim.mjcf.accuracy import (
    FEWEST_DIGITS,
    MOST_DIGITS,
    half_units,
    halves_of_units,
    last_places,
    significant_digits,
)

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
    """Those of five digits, and the shorter ones too of a file whose last decimal is a fine one."""
    eq_data = np.where(np.isin(model.eq_type, _POINTS)[:, None], model.eq_data, 0.0)[:, :3]
    fields = {name: getattr(model, name) for name in ("body_pos", "jnt_pos", "site_pos")}
    fields["eq_data"] = eq_data
    x = np.abs(np.concatenate([A.ravel() for A in fields.values()]))
    x = x[x > 0.0]
    digits = significant_digits(x)
    written = digits <= MOST_DIGITS
    if not written.any():
        return
    most = int(digits[written].max())
    last = float(np.percentile(last_places(x[written]), 25, method="nearest"))
    fewest = 1 if np.floor(np.log10(x.max())) - last + 1 >= FEWEST_DIGITS else FEWEST_DIGITS
    for name, A in fields.items():
        size = np.where(A == 0.0, 1.0, np.abs(A))
        digits, halves = significant_digits(size), half_units(size, most, last)
        for row, column in np.argwhere((A != 0.0) & (fewest <= digits) & (digits <= MOST_DIGITS)):
            half = float(halves[row, column])
            yield Rounding(name, int(row), int(column), half, is_unit=False)


def _of_units(model: mujoco.MjModel) -> Iterator[Rounding]:
    for name in ("jnt_axis", "body_quat", "site_quat"):
        halves = halves_of_units(getattr(model, name))
        for row, column in np.argwhere(halves > 0.0):
            half = float(halves[row, column])
            yield Rounding(name, int(row), int(column), half, is_unit=True)


def moved(model: mujoco.MjModel, rounding: Rounding, by: float) -> Array:
    """Move a number by a part of its half unit, in place; returns the row that was there."""
    row = getattr(model, rounding.field)[rounding.row]
    before = row.copy()
    row[rounding.column] += by * rounding.half_unit
    if rounding.is_unit:
        row /= np.linalg.norm(row)
    return before
