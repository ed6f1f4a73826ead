"""Limits of displacements in the loop: what a mapping with limits takes and gives."""

from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike

import argument_checks as check
from argument_checks import Array

WhenLimited = Literal["least_squares", "scaled"]
"""What becomes of a major task beyond the limits: least error, or its direction kept."""


class LimitedRates(Protocol):
    """What a mapping with limits gives; see :meth:`prioritized.VelocityMapping.solve`."""

    @property
    def rates(self) -> Array:
        """Optimal rates within the limits, shape (n',)."""
        ...

    @property
    def residual(self) -> Array:
        """Major velocity asked for less the one achieved, shape (m1,)."""
        ...


class LimitedMapping(Protocol):
    """Protocol of a velocity mapping with limits."""

    def solve(
        self,
        v_major: ArrayLike,
        joint_velocity: ArrayLike | None = None,
        secondary_velocity: ArrayLike | None = None,
    ) -> LimitedRates:
        """Optimal rates within the limits; arguments that are None count as zero."""
        ...


@dataclass(frozen=True)
class LimitedDisplacements:
    """Displacements within their limits, and what they cost the major task.

    Attributes:
        displacements_m: Displacements of the actuators, shape (n,).
        achieved: Major task that they achieve, shape (m1,).
        residual: Demanded less achieved major task, shape (m1,).
        solution: What the mapping with limits gave, for the surviving actuators; that of a
            :class:`prioritized.VelocityMapping` has a status and names the active limits.
    """

    displacements_m: Array
    achieved: Array
    residual: Array
    solution: LimitedRates


def limits_of_actuators(limits_m: tuple[ArrayLike, ArrayLike], n: int) -> tuple[Array, Array]:
    """Lower and upper limits of n displacements, read-only, infinite where there is none.

    Raises:
        ValueError: No pair, another number, NaN, or a lower limit above the upper one.
    """
    try:
        lower, upper = (check.frozen(np.asarray(each, dtype=float)) for each in limits_m)
    except (TypeError, ValueError):
        raise ValueError(
            f"limits_m must be a pair of {n} numbers, got {check.shown(limits_m)}"
        ) from None
    if lower.shape != (n,) or upper.shape != (n,) or not (lower <= upper).all():
        raise ValueError(
            f"limits_m must be lower and upper limits of {n} actuators, got {lower} and {upper}"
        )
    return lower, upper
