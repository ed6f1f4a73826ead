"""What follows from a diagnosis: another goal, and what the failed actuator is about to lose."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal, get_args

import numpy as np

import argument_checks as check
from argument_checks import Array
from ftc.fdi.diagnosis import Diagnosis
from ftc.fdi.fault_model import Fault, NominalModel, resting_displacements, static_share
from ftc.goal import Goal

WEAKEST = 0.5
"""An actuator whose commands move it less than this part of what they did is not used. Commanded
seven times as much because of a wrong diagnosis, a sound strut would make the loop unstable:
docs/recover.md."""

_LEAST_ASSUMED = 0.8
"""Part of the displacement that a weak actuator is assumed to keep, at least, by a diagnosis: it is
commanded at most 2 dB more, a third of the gain margin of 6 dB that loops have. If it works again
before anybody can know, the rest of the margin is left, and the step is a quarter larger."""


def used_share(nominal: NominalModel, fault: Fault) -> float:
    """Part of its commanded displacement that the mapping assumes for an actuator; 0: not used."""
    if fault.kind != "weak":
        return 0.0
    share = static_share(nominal, fault)
    return share if share >= WEAKEST else 0.0


def lost_displacement(
    nominal: NominalModel, diagnosis: Diagnosis, faults: Sequence[Fault], commanded: Array
) -> Array:
    """Displacement that the diagnosed actuator is about to lose, shape (n,).

    That is, from where it is by the diagnosis to where its command (n,), its springs and its loads
    hold it with all `faults`, as far as that is a part of what the fault changes at rest: a servo
    that lags behind a moving command loses nothing by that. A locked actuator loses nothing, nor
    does one that was diagnosed before; one that nothing holds falls: no other actuator can make up
    for that by a step.
    """
    fault, lost_displacements = diagnosis.fault, np.zeros(len(commanded))
    if fault.kind != "locked" and not (fault.is_sound or diagnosis.confirmed):
        k, others = fault.actuator, [each for each in faults if each.actuator != fault.actuator]
        before = resting_displacements(nominal, others, commanded)
        after = resting_displacements(nominal, faults, commanded)
        if before is not None and after is not None:
            lost, left = before[k] - after[k], diagnosis.displacement - after[k]
            lost_displacements[k] = np.clip(left, min(lost, 0.0), max(lost, 0.0))
    return lost_displacements


Unused = Literal["locked", "free"]
"""What an actuator counts as that gives no force: locked at its centre, where its own spring holds
it, or free to follow the others. On the hexapod its spring holds it to 6e-4, and in a loop of 8 Hz
locked is the better model even without the spring (docs/theory.md)."""


def goal_after(
    goal: Goal, diagnoses: Sequence[Diagnosis], nominal: NominalModel, unused: Unused = "free"
) -> Goal:
    """The goal with failures that are known.

    Args:
        goal: Before them.
        diagnoses: What has failed.
        nominal: Linear model of the sound machine.
        unused: What an actuator counts as that is free, loose, or too weak to be used.

    Raises:
        ValueError, TypeError: Of another kind than that, or of another mechanism.
    """
    n = check.instance("nominal", nominal, NominalModel).actuators
    check.instance("goal", goal, Goal).of(n)
    check.choice("unused", unused, get_args(Unused))
    if not isinstance(diagnoses, list | tuple):
        raise TypeError(f"diagnoses must be a list of diagnoses, got {check.shown(diagnoses)}")
    for found in diagnoses:
        fault = check.instance("diagnoses", found, Diagnosis).fault
        check.index("actuator of diagnoses", fault.actuator, n)
    locked_at, effectiveness, free = dict(goal.locked_at), dict(goal.effectiveness), set(goal.free)
    for found in diagnoses:
        actuator = found.fault.actuator
        if found.fault.kind == "locked":
            locked_at[actuator] = found.displacement
        elif (share := used_share(nominal, found.fault)) > 0:
            effectiveness[actuator] = share
        elif unused == "locked":
            locked_at[actuator] = 0.0
        else:
            free.add(actuator)
    return replace(
        goal,
        locked_at=locked_at,
        effectiveness=effectiveness,
        free=tuple(sorted(free - {*locked_at})),
    )


def with_margin(goal: Goal, told: Goal) -> Goal:
    """The goal whose weak actuators, but for those that were told, leave the loops their margin."""
    least = {k: min(_LEAST_ASSUMED, told.effectiveness.get(k, 1.0)) for k in goal.effectiveness}
    driven = {k: max(left, least[k]) for k, left in goal.effectiveness.items()}
    return replace(goal, effectiveness=driven)
