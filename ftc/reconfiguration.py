"""What follows from a diagnosis: another goal, and whether to go over to a controller for it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import isfinite
from typing import Any, Literal, NamedTuple, get_args

import numpy as np

import argument_checks as check
from argument_checks import Array
from ftc.control.mapping import Goal
from ftc.controller import ControllerState, Measurement, PrioritizedController
from ftc.fdi.diagnosis import Diagnosis
from ftc.fdi.fault_model import (
    Fault,
    NominalModel,
    fault_model,
    resting_displacements,
    static_share,
)

WEAKEST = 0.5
"""An actuator whose commands move it less than this part of what they did is not used. Commanded
seven times as much because of a wrong diagnosis, a sound strut would make the loop unstable:
docs/recover.md."""

_LEAST_ASSUMED = 0.8
"""Part of the displacement that a weak actuator is assumed to keep, at least, by a diagnosis: it is
commanded at most 2 dB more, a third of the gain margin of 6 dB that loops have. If it works again
before anybody can know, the rest of the margin is left, and the step is a quarter larger."""

_ABOVE = 1 + 1e-9
"""What exceeds so many times a number does so whatever round-off there is."""


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

    From where it is by the diagnosis to where its command (n,), its springs and its loads hold it
    with all `faults`, as far as that is a part of what the fault changes at rest: a servo that lags
    behind a moving command loses nothing by that. A locked actuator loses nothing, nor does one
    that was diagnosed before; for one that nothing holds no other can make up by a step.
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
    """The goal with the failures of these diagnoses, by the linear model of the sound machine.

    `unused` is what an actuator counts as that is free, loose, or too weak to be used.
    """
    n = check.instance("nominal", nominal, NominalModel).actuators
    check.instance("goal", goal, Goal).of(n)
    check.choice("unused", unused, get_args(Unused))
    if not isinstance(diagnoses, list | tuple):
        raise TypeError(f"diagnoses must be a list of diagnoses, got {check.short_repr(diagnoses)}")
    locked_at, effectiveness, free = dict(goal.locked_at), dict(goal.effectiveness), set(goal.free)
    for found in diagnoses:
        fault = check.instance("diagnoses", found, Diagnosis).fault
        actuator = check.integer("actuator of diagnoses", fault.actuator, n)
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


class Case(NamedTuple):
    """What is true with some probability: faults of the machine, and its state x (s,) with them."""

    probability: float
    faults: Sequence[Fault]
    x: Array


@dataclass(frozen=True)
class Outlook:
    """The time to come, as far as it can be foreseen, by which one of two controllers is chosen.

    A diagnosis is a probability, and acting on it is a decision under risk: that with the least
    expected cost (Berger, Statistical Decision Theory and Bayesian Analysis, 1985, section 1.3).
    The cost is the RMS error of the major task that the linear model predicts from where machine
    and controllers stand now.

    Attributes:
        nominal: Linear model of the sound machine; its first outputs are the major task.
        output: The major task as last measured, shape (m1,): what the model is off now stays.
        references: Of the major task, tick by tick, shape (N, m1).
        secondary: Of the secondary goal, shape (N, n).
        unused: What actuators out of use are commanded, shape (N, n).
        feedforward: What is demanded beside the compensators, shape (N, m1); None: as the
            controllers do without.
    """

    nominal: NominalModel
    output: Array
    references: Array
    secondary: Array
    unused: Array
    feedforward: Array | None = None

    def rms(
        self,
        pilot: PrioritizedController[Any],
        state: ControllerState[Any],
        case: Case,
        enough: float = np.inf,
    ) -> float:
        """RMS error of the major task under a controller that begins in this state; or infinite.

        In standard deviations of the sensors' noise: rows of different units count alike. Once it
        is sure to exceed `enough`, this much of it is returned.
        """
        model, x, square = fault_model(self.nominal, case.faults), case.x, 0.0
        C, noise = (part[: len(self.output)] for part in (self.nominal.plant.C, self.nominal.noise))
        off, most = self.output - C @ x, enough * enough * len(self.references)
        for tick, reference in enumerate(self.references):
            output = C.dot(x) + off
            error = (reference - output) / noise
            square += float(error.dot(error))
            if not isfinite(square):
                return np.inf
            if square > most:
                break
            measured = Measurement(output, self.nominal.displacement.dot(x))
            state = pilot.step(
                state,
                reference,
                measured,
                self.secondary[tick],
                feedforward=None if self.feedforward is None else self.feedforward[tick],
                unused_reference=self.unused[tick],
            )
            x = model.step(x, pilot.drives.displacements(state.inputs))
        return float(np.sqrt(square / len(self.references)))

    def goes_over(
        self,
        stays: tuple[PrioritizedController[Any], ControllerState[Any]],
        goes: tuple[PrioritizedController[Any], ControllerState[Any]],
        cases: Sequence[Case],
    ) -> bool:
        """Whether the expected error of a new controller is at most that of the present one.

        Errors that are smaller than the sensors' noise matter to nobody. `cases` are what may be
        true; `stays` is the present controller with its state, `goes` the new one.
        """
        cases = [case for case in cases if case.probability > 0]  # certain ones round to one
        going = sum(case.probability * self.rms(*goes, case) for case in cases)
        bearable, staying = float(np.sqrt(len(self.output))), 0.0
        for case in cases:
            if going <= max(staying, bearable):  # staying only grows with further cases
                return True
            enough = (_ABOVE * going - staying) / case.probability
            staying += case.probability * self.rms(*stays, case, enough)
        return going <= max(staying, bearable)
