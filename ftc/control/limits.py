"""Limits of displacements in the loop: what a mapping with limits takes and gives."""

from dataclasses import dataclass
from typing import Protocol

from numpy.typing import ArrayLike

from argument_checks import Array


class LimitedRates(Protocol):
    """What a mapping with limits gives; see :meth:`prioritized.VelocityMapping.solve`."""

    @property
    def rates(self) -> Array:
        """Optimal rates within the limits, shape (n',)."""
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


class MovableLimits(LimitedMapping, Protocol):
    """One whose limits can be moved, which the Gauss-Newton form does at every tick."""

    def within(self, rate_limits: tuple[ArrayLike, ArrayLike]) -> LimitedMapping:
        """The same mapping with other limits of the rates."""
        ...


@dataclass(frozen=True)
class LimitedDisplacements:
    """Displacements within their limits, and what they cost the major task.

    Attributes:
        displacements: Displacements of the actuators, shape (n,).
        achieved: Major task that they achieve, shape (m1,).
        residual: Demanded less achieved major task, shape (m1,).
        solution: What the mapping with limits gave, for the surviving actuators; that of a
            :class:`prioritized.VelocityMapping` has a status and names the active limits.
    """

    displacements: Array
    achieved: Array
    residual: Array
    solution: LimitedRates
