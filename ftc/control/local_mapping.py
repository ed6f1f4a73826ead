"""What a mapping in the loop consists of: its answer at one pose, and its last command."""

from dataclasses import dataclass
from typing import NamedTuple, Protocol

from numpy.typing import ArrayLike

from argument_checks import Array
from ftc.control.limits import LimitedMapping
from prioritized import Status


class PreviousCommand(NamedTuple):
    """Last demand and displacements of a mapping, from which the incremental form continues.

    `demand` (m1,) is the demanded major task; `displacements` (n,) those of the actuators, before
    the converters; `secondary_reference` (n,) the reference of the secondary goal.
    """

    demand: Array
    displacements: Array
    secondary_reference: Array


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
