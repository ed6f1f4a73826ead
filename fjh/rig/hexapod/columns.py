"""Task of the hexapod, columns of Table I, and arrays of data files."""

from dataclasses import dataclass

import numpy as np

from fjh.rig.hexapod.detector import secondary_motion
from fjh.rig.run import Run
from ftc import Goal
from sim import Array, Failure
from sim.plant import FailureKind

MAJOR = [0, 1]
"""Major rows of the payload's twist: (alpha, beta), the pointing task."""
SECONDARY = [3, 4, 5, 2]
"""Secondary rows [t_x, t_y, t_z, gamma], in the order of the paper's W_d and W_e."""


@dataclass(frozen=True)
class Column:
    """Column of Table I.

    Attributes:
        name: Name in `table1.json`.
        goal: Weights, and the failure that is known to the mapping.
        failures: Failures of the plant.
    """

    name: str
    goal: Goal
    failures: tuple[Failure, ...] = ()

    def struts(self, kind: FailureKind) -> list[int]:
        """Return the struts 0..5 with this kind of failure."""
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


def secondary(run: Run) -> Array:
    """Return true [gamma_rad, t_x_m, t_y_m, t_z_m] of a run relative to its first tick, (N, 4)."""
    rotation, translation_m = run.pose.rotation, run.pose.translation_m
    return secondary_motion(rotation @ rotation[0].T, translation_m - translation_m[0])


def secondary_estimated(run: Run) -> Array:
    """Return the estimated [gamma_rad, t_x_m, t_y_m, t_z_m] of a run, (N, 4), or zeros."""
    return np.zeros((len(run.time_s), 4)) if run.estimated is None else run.estimated[:, 2:]


def hexapod_arrays(run: Run) -> dict[str, Array]:
    """Return the arrays of a run's `.npz` file, at every control tick."""
    return {
        "time_s": run.time_s,
        "desired_rad": run.desired,
        "true_rad": run.true,
        "measured_rad": run.measured,
        "strut_input_percent": run.inputs,
        "strut_displacement_m": run.displacement,
        "secondary": secondary(run),
        "secondary_estimated": secondary_estimated(run),
        "closure_residual_m": run.closure_m,
    }
