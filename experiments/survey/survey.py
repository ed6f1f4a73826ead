"""What is surveyed, and what was found: the data that JSON, page, figure and recordings show."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from experiments.rig.examined import Examined, Limits
from prioritized import ConstrainedSystem
from sim import Array

if TYPE_CHECKING:
    from experiments.rig.robot import Robot
    from experiments.survey.alike import Columns
    from experiments.survey.sensors import Sensors


@dataclass(frozen=True, eq=False)
class Limited:
    """Limits of the actuators, and where they come from.

    Attributes:
        values: Lower and upper ones, shape (n,) each.
        source: A sentence.
        assumed: Whether they are one unit for each actuator, because none are stated: then numbers
            compare conditions with each other, and say nothing absolute.
    """

    values: Limits
    source: str
    assumed: bool


@dataclass(frozen=True, eq=False)
class Subject:
    """A robot at its start, or an effectiveness matrix.

    Attributes:
        title: Name of the file.
        sha256: Of the file.
        actuators: Their names; columns of the matrix.
        units: Of each actuator's displacement, "rad" or "m"; "1" in a matrix.
        rows: Names of all task rows: of the twist, or of the matrix.
        row_units: Of the displacement of each: "rad" or "m"; "1" in a matrix.
        major: The major ones by number.
        system: At the start; of a matrix B it is v = B u without loops.
        rates: Of the actuators' velocities; of a matrix those of its inputs.
        torques: Of the actuators' forces and torques; None of a matrix.
        robot: At its start, with the model; None of a matrix.
        hold: Effects that the inputs of a matrix exert at rest, shape (m1,); None is none.
        warnings: What numbers leave out, a sentence each.
        instead: Which posture stands for a start at which the task is not possible, in a sentence.
    """

    title: str
    sha256: str
    actuators: tuple[str, ...]
    units: tuple[str, ...]
    rows: tuple[str, ...]
    row_units: tuple[str, ...]
    major: tuple[int, ...]
    system: ConstrainedSystem
    rates: Limited
    torques: Limited | None = None
    robot: "Robot | None" = None
    hold: Array | None = None
    warnings: tuple[str, ...] = ()
    instead: str | None = None

    @property
    def secondary(self) -> tuple[int, ...]:
        """The other rows, ascending."""
        return tuple(row for row in range(len(self.rows)) if row not in self.major)


@dataclass(frozen=True, eq=False)
class Workspace:
    """The first conditions of the start at P other postures.

    Attributes:
        qpos: Joint positions of the model that the task involves, shape (P, nq).
        survived: Shape (P, C).
        speed: Worst major speed, shape (P, C); None where it is not computed.
        speed_left: The same over that of the sound robot, NaN where that has none, shape (P, C).
        relative: Relative manipulability; NaN where the sound robot cannot do the task, (P, C).
        largest_gain: Infinite where the task is lost, shape (P, C).
        tried: Number of postures drawn.
        unusable: How many of these could not be closed within the joint ranges.
    """

    qpos: Array
    survived: NDArray[np.bool_]
    speed: Array | None
    speed_left: Array
    relative: Array
    largest_gain: Array
    tried: int
    unusable: int


@dataclass(frozen=True)
class Count:
    """Of all conditions with so many failures at the start: how many survive."""

    failures: int
    conditions: int
    survived: int


@dataclass(frozen=True)
class Recheck:
    """Some conditions at the start, examined one by one.

    Attributes:
        verdicts: Number of verdicts that differ.
        off: Largest relative difference of what is left in the worst direction.
        theorem: Difference of the mean square of relative manipulability over all single locks from
            C(n - 1, m) / C(n, m); None where loops constrain the actuators.
    """

    verdicts: int
    off: float
    theorem: float | None


@dataclass(frozen=True, eq=False)
class Survey:
    """Everything that `fjh survey` publishes.

    Attributes:
        command: That gives the same numbers, its folder apart.
        seed: Of the postures.
        subject: See there.
        start: At most two failures, at the start: first the sound robot.
        counts: Of all conditions, however many failures; empty where they are too many.
        workspace: None of a matrix, or if no other posture was asked for.
        recheck: Of conditions one by one.
        isolation: Which failures can be told apart, by sensors of a robot or by the columns of a
            matrix; a sentence: why nothing is said.
        left_out: What was not examined and why, a sentence each.
    """

    command: str
    seed: int
    subject: Subject
    start: Examined
    counts: tuple[Count, ...]
    workspace: Workspace | None
    recheck: Recheck
    isolation: "Sensors | Columns | str"
    left_out: tuple[str, ...]
