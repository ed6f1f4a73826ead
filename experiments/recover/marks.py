"""What a flight's recording and figure mark: failures, and when they were found."""

import numpy as np

from experiments.hexapod.simulation import Trajectory
from experiments.output.recording.marks import Mark
from experiments.recover.second import Succession
from ftc.fdi.fault_model import fault_of


def marks(run: Trajectory, flight: Succession) -> list[Mark]:
    """One for each failure; found when its strut was first named, and as what in the end."""
    found = []
    for failure in flight.failures:
        own = [
            each
            for each in flight.diagnoses
            if each.fault.strut == failure.strut and run.time_s[each.tick] >= failure.time_s
        ]
        found.append(
            Mark(
                strut=failure.strut,
                failed_s=failure.time_s,
                failure=str(fault_of(failure)),
                diagnosed_s=float(run.time_s[own[0].tick]) if own else np.inf,
                diagnosis=f"found: {own[-1].fault}" if own else "",
            )
        )
    return found
