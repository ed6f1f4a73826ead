"""What a mapping in the loop consists of: its answer at one pose, its last command, its limits."""

from dataclasses import dataclass
from typing import Any, NamedTuple

from argument_checks import Array


class PreviousCommand(NamedTuple):
    """Last demand and displacements of a mapping, from which the incremental form continues.

    `demand` (m1,) is the demanded major task; `displacements` (n,) those of the actuators, before
    the converters; `secondary_reference` (n,) the reference of the secondary goal.
    """

    demand: Array
    displacements: Array
    secondary_reference: Array


@dataclass(frozen=True)
class LocalMapping:
    """The mapping at one pose, section 2.3.

    Attributes:
        mapping: Rates of the n' surviving actuators, eqs. (28) and (30): a
            :class:`prioritized.VelocityMapping`, or what is called like one and has its `major` and
            `status`.
        expand: Puts them on all actuators, shape (n, n').
        J: Task velocity per surviving rate, eq. (14), shape (m, n').
        constraint: Rows that admissible surviving rates obey, eq. (17), shape (r, n').
        limited: The same with limits, whose `solve` gives `rates`; None without.
    """

    mapping: Any
    expand: Array
    J: Array
    constraint: Array
    limited: Any = None


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
    solution: Any
