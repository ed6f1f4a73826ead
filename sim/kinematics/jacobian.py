"""Task and constraint Jacobians of a MuJoCo model, as they are at one pose."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import argument_checks as check
from sim.array import Array
from sim.kinematics.entry_accuracy import EntryAccuracy
from sim.kinematics.machine import Machine, Names
from sim.kinematics.task import Task


class JacobianViews(NamedTuple):
    """What one tick needs of :class:`Jacobians`: the next reading overwrites the matrices.

    They are one row after another and cannot be written to, as `Hierarchy.tick` wants them without
    a copy.

    Attributes:
        J_T: As of :class:`Jacobians`, shape (m, N).
        J_C: Likewise, shape (c, N).
        active: Likewise, shape (n,); this array is the same one as long as the same equalities and
            actuators count.
        closure_residual: Largest gap of the closures, [m] or [rad].
        error_bound: Of the errors of all entries in natural units, as of :class:`EntryAccuracy`.
    """

    J_T: Array
    J_C: Array
    active: NDArray[np.intp]
    closure_residual: float
    error_bound: float


@dataclass(frozen=True, eq=False)
class Jacobians:
    """Velocities of a MuJoCo model as v = J_T u, 0 = J_C u, with u = [qvel; other actuators'].

    N velocities: the nv of MuJoCo, then one of each transmission that is no slide or hinge joint.

    Attributes:
        J_T: Velocities of the tasks, shape (m, N): a frame has the twist [angular; linear] of its
            origin, [rad]/[s] and [m]/[s].
        J_C: Rows of the active equality constraints, shape (c, N), then of the transmissions, pins
            and limits; redundant rows are normal.
        active: Velocity index of each active velocity, in actuator order, shape (n,).
        gear: Gear ratio of its first actuator, never zero, shape (n,).
        rows: Which rows of J_T belong to which task.
        closure_residual: Largest gap of the closures, [m] or [rad].
        machine: The model behind it, from which names, limits and springs are read when asked for.
        accuracy: How far each entry may be off, and natural units; computed when asked for.

    Raises:
        ValueError: Shapes that do not fit, an index out of range, or numbers that are not finite.
        TypeError: An argument is of another kind.
    """

    J_T: Array
    J_C: Array
    active: NDArray[np.intp]
    gear: Array
    rows: Mapping[Task, slice] = field(default_factory=dict)
    closure_residual: float = 0.0
    machine: Machine | None = None
    accuracy: EntryAccuracy | None = None

    def __post_init__(self) -> None:
        """Check the arguments, and keep read-only copies."""
        nv = (J_T := check.batch("J_T", self.J_T)).shape[-1]
        J_C = check.batch("J_C", self.J_C, columns=nv)
        active = check.indices("active", self.active, nv)
        gear = check.exactly("gear", self.gear, len(active))
        if not gear.all():
            raise ValueError(f"gear must not be zero, got {check.shown(self.gear)}")
        for name, value in {"J_T": J_T, "J_C": J_C, "active": active, "gear": gear}.items():
            object.__setattr__(self, name, check.frozen(value))
        check.instance("rows", self.rows, Mapping)
        check.number("closure_residual", self.closure_residual)
        if self.machine is not None:
            check.instance("machine", self.machine, Machine)
        if self.accuracy is not None:
            check.instance("accuracy", self.accuracy, EntryAccuracy)

    @property
    def names(self) -> Names | None:
        """Names of the velocities and of the actuators of each active one."""
        return self.machine and self.machine.names

    @property
    def stiffness(self) -> Array | None:
        """K of the springs of joints and tendons, (N, N); None where one is not linear."""
        return self.machine and self.machine.stiffness

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the model has besides, and the Jacobians leave out; a sentence each."""
        return self.machine.warnings if self.machine else ()

    @cached_property
    def geometry_accuracy(self) -> float:
        """Accuracy of the geometry in one number, in rad or relative length, as the model shows it.

        The rounding of its numbers; or a tenth of what the gaps of the closures amount to in J_C,
        where `ConstrainedSystem(geometry_accuracy=...)` takes ten times the accuracy for zero.
        `accuracy` says it for each entry.
        """
        size = float(np.linalg.norm(self.J_C))
        of_gaps = 0.1 * self.closure_residual / size if size else 0.0
        return max(of_gaps, self.machine.written_accuracy if self.machine else 0.0)
