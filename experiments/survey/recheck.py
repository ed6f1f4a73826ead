"""Some conditions examined one by one, by the classification and the attainable set of each."""

import numpy as np

from experiments.rig.conditions import FREE, LOCKED
from experiments.rig.examined import Examined
from experiments.survey.hold import limits_about_rest
from experiments.survey.survey import Recheck, Subject
from ftc.tracking import is_possible

_MOST = 24
"""Conditions: a fraction of a second."""


def recheck(subject: Subject, start: Examined) -> Recheck:
    """How far what was computed for all conditions at once is from what each has alone."""
    lower, upper = (
        np.broadcast_to(side, start.codes.shape) for side in limits_about_rest(subject, start.codes)
    )
    step = max(1, len(start.codes) // _MOST)
    verdicts, off = 0, 0.0
    for row in range(0, len(start.codes), step):
        code = start.codes[row]
        locked, free = np.flatnonzero(code == LOCKED), np.flatnonzero(code == FREE)
        if not start.are_joints:
            locked, free = np.flatnonzero(code), free[:0]
        kin = subject.system.with_failures(locked.tolist(), free.tolist()).kinematics()
        possible = is_possible(kin.manipulability(subject.major))
        verdicts += possible != start.left.possible[row]
        if (speeds := start.left.worst_speed) is not None:
            alone = kin.attainable(subject.major, (lower[row], upper[row])).radius
            if (largest := max(alone, speeds[row])) and alone != speeds[row]:
                off = max(off, abs(alone - speeds[row]) / largest)
    return Recheck(int(verdicts), float(off), _theorem(start))


def _theorem(start: Examined) -> float | None:
    """Ukidve, McInroy and Jafari's mean square over single locks; None where it does not hold."""
    rows = start.singles[:, 0]
    best, relative = start.best_possible[rows], start.relative_manipulability[rows]
    if not (np.isfinite(best).all() and np.isfinite(relative).all()):
        return None
    return float(abs((relative**2).mean() - best[0] ** 2))
