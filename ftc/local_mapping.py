"""What a mapping in the loop consists of: its answer at one pose, with and without limits."""

from dataclasses import dataclass
from typing import Literal, Protocol

from numpy.typing import ArrayLike

from argument_checks import Array
from prioritized import Status


@dataclass(frozen=True)
class PreviousCommand:
    """Last demand and displacements of a mapping, from which the incremental form continues.

    Attributes:
        demand: Demanded major task, shape (m1,).
        displacements_m: Displacements of the actuators, before the converters, shape (n,).
        secondary_reference_m: Reference of the secondary goal, displacements of the actuators,
            shape (n,).
    """

    demand: Array
    displacements_m: Array
    secondary_reference_m: Array


class Mapping(Protocol):
    """Protocol of a velocity mapping; see :class:`prioritized.VelocityMapping`."""

    @property
    def major(self) -> Array:
        """Gain of the major velocity."""
        ...

    @property
    def status(self) -> Status:
        """Status: whether the major task is met exactly."""
        ...

    def __call__(
        self,
        v_major: ArrayLike,
        joint_velocity: ArrayLike | None = None,
        secondary_velocity: ArrayLike | None = None,
    ) -> Array:
        """Optimal rates; arguments that are None count as zero."""
        ...


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
class LocalMapping:
    """The mapping at one pose, section 2.3.

    Attributes:
        mapping: Rates of the n' surviving actuators, eqs. (28) and (30).
        expand: Puts them on all actuators, shape (n, n').
        J: Task velocity per surviving rate, eq. (14), shape (m, n').
        constraint: Rows that admissible surviving rates obey, eq. (17), shape (r, n').
        limited: The mapping with limits; None without.
    """

    mapping: Mapping
    expand: Array
    J: Array
    constraint: Array
    limited: LimitedMapping | None = None


@dataclass(frozen=True)
class LimitedDisplacements:
    """Displacements within their limits, and what they cost the major task.

    Attributes:
        displacements_m: Displacements of the actuators, shape (n,).
        residual: Demanded less achieved major task, shape (m1,); zero where the limits allow the
            demand.
    """

    displacements_m: Array
    residual: Array
