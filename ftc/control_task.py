"""What a controller is told of its machine and its task, as numbers."""

from dataclasses import dataclass

import argument_checks as check
from argument_checks import Array
from ftc.controller import Converter, checked_drives
from ftc.fdi.fault_model import NominalModel
from ftc.goal import Goal


@dataclass(frozen=True)
class ControlTask:
    """A machine and a task as a controller meets them; failures are in it where they are known.

    Attributes:
        nominal: The machine without failures: from the n commanded displacements to the m1 major
            coordinates, the noise of their sensors, the control period.
        J: Task velocity per actuator rate at the nominal pose, shape (m, n).
        major: Rows of the major task, m1 of the m; the others are secondary.
        goal: Secondary weights, and the failures that are known from the start.
        drives: From displacements of the actuators to the inputs that are sent, and back.
        limits: Lower and upper displacements that the drives can hold, shape (n,) each; infinite
            where there is no limit.
        reference_limit: Largest reference of each major coordinate, either way, shape (m1,).

    All arrays are copied, and read-only.

    Raises:
        ValueError, TypeError: Of another shape or kind than that.
    """

    nominal: NominalModel
    J: Array
    major: tuple[int, ...]
    goal: Goal
    drives: Converter
    limits: tuple[Array, Array]
    reference_limit: Array

    def __post_init__(self) -> None:
        n = check.instance("nominal", self.nominal, NominalModel).actuators
        kept = {"J": check.frozen(check.matrix("J", self.J, columns=n))}
        major = check.indices("major", self.major, len(self.J))
        check.instance("goal", self.goal, Goal).of(n)
        checked_drives(self.drives, n)
        if len(major) != (outputs := self.nominal.plant.noutputs):
            raise ValueError(
                f"major must have a row for each of the {outputs} outputs of nominal, got "
                f"{len(major)}"
            )
        most = check.exactly("reference_limit", self.reference_limit, len(major))
        limits = check.limit_vectors("limits", self.limits, n)
        kept |= {"reference_limit": check.frozen(most), "limits": limits}
        vars(self).update(kept, major=tuple(major.tolist()))

    @property
    def major_jacobian(self) -> Array:
        """Rows of the major task, shape (m1, n)."""
        return self.J[list(self.major)]

    @property
    def period_s(self) -> float:
        """Between control ticks."""
        return self.nominal.period_s
