"""The hexapod's task, and the columns of Table I: what is minimized, what fails, what is known."""

from dataclasses import dataclass

from ftc.goal import Goal
from sim import Failure, FailureKind

MAJOR = [0, 1]
"""Rows of the payload's twist that matter: (alpha, beta), the pointing task."""
SECONDARY = [3, 4, 5, 2]
"""[t_x, t_y, t_z, gamma], the order of the paper's W_d and W_e."""


@dataclass(frozen=True)
class Column:
    """One column of Table I.

    Attributes:
        name: As in `table1.json`.
        goal: Weights, and the failure that the mapping is told of.
        failures: What happens to the plant.
    """

    name: str
    goal: Goal
    failures: tuple[Failure, ...] = ()

    def struts(self, kind: FailureKind) -> list[int]:
        """Struts 0..5 that fail this way."""
        return [failure.number for failure in self.failures if failure.kind == kind]


_EQUAL = (1.0, 1.0, 1.0, 1.0, 1.0, 1.0)
_STRUT_1 = {0: 0.0}
_LOCK_1 = (Failure(actuator=0, kind="locked"),)

COLUMNS = (
    Column("W_a", Goal(joint_weight=_EQUAL)),
    Column("W_b", Goal(joint_weight=(2.0, 1.0, 2.0, 1.0, 2.0, 1.0))),
    Column("W_c", Goal(joint_weight=(1.0, 2.0, 1.0, 2.0, 1.0, 2.0))),
    # Secondary weights are on [t_x, t_y, t_z, gamma].
    Column("W_d", Goal(secondary_weight=(1.0, 1.0, 1.0, 1.0), locked_at=_STRUT_1), _LOCK_1),
    Column("W_e", Goal(secondary_weight=(10.0, 10.0, 1.0, 1.0), locked_at=_STRUT_1), _LOCK_1),
    Column("W_a_uncorrected", Goal(joint_weight=_EQUAL), _LOCK_1),
)
