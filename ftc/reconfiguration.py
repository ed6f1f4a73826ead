"""Reconfiguration after a diagnosis: the new goal, and the decision to switch controllers."""

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
"""Smallest static share of its displacement with which an actuator stays in use: after a wrong
diagnosis, a healthy strut driven with seven times its command would destabilize the loop
(docs/recover.md)."""

_LEAST_ASSUMED = 0.8
"""Smallest effectiveness that the controller assumes for an actuator diagnosed as weak: its command
grows by at most 2 dB, a third of the gain margin of 6 dB. If it works again undetected, two thirds
of the margin remain, and its step is a quarter larger."""

_ABOVE = 1 + 1e-9
"""Factor by which a number must exceed another one to be larger beyond round-off."""


def used_share(nominal: NominalModel, fault: Fault) -> float:
    """Return the share of its commanded displacement assumed for an actuator; 0: out of use."""
    if fault.kind != "weak":
        return 0.0
    share = static_share(nominal, fault)
    return share if share >= WEAKEST else 0.0


def lost_displacement(
    nominal: NominalModel, diagnosis: Diagnosis, faults: Sequence[Fault], commanded: Array
) -> Array:
    """Return the displacement that the diagnosed actuator is about to lose, shape (n,).

    It leads from its diagnosed displacement to the one at which its command (n,), springs and loads
    hold it with all `faults`, limited to the change of the resting displacement by the fault: the
    lag of a servo behind a moving command does not count. It is zero for a locked actuator, for one
    that is healthy again or was diagnosed before, and for one that does not come to rest.
    """
    fault, lost_displacements = diagnosis.fault, np.zeros(len(commanded))
    if fault.kind != "locked" and not (fault.is_healthy or diagnosis.confirmed):
        k, others = fault.actuator, [other for other in faults if other.actuator != fault.actuator]
        before = resting_displacements(nominal, others, commanded)
        after = resting_displacements(nominal, faults, commanded)
        if before is not None and after is not None:
            lost, left = before[k] - after[k], diagnosis.displacement - after[k]
            lost_displacements[k] = np.clip(left, min(lost, 0.0), max(lost, 0.0))
    return lost_displacements


Unused = Literal["locked", "free"]
"""Model of an actuator without force: locked at its centre by its own spring, or free to follow the
others. On the hexapod the spring holds it to 6e-4, and in a loop of 8 Hz locked is the better model
even without the spring (docs/theory.md)."""


def goal_after(
    goal: Goal, diagnoses: Sequence[Diagnosis], nominal: NominalModel, unused: Unused = "free"
) -> Goal:
    """Return the goal with the failures of these diagnoses, by the linear model `nominal`.

    `unused` is the model of an actuator that is free, loose, or too weak to be used.
    """
    n = check.instance("nominal", nominal, NominalModel).actuators
    check.instance("goal", goal, Goal).of(n)
    check.choice("unused", unused, get_args(Unused))
    if not isinstance(diagnoses, list | tuple):
        raise TypeError(f"diagnoses must be a list of diagnoses, got {check.short_repr(diagnoses)}")
    locked_at, effectiveness, free = dict(goal.locked_at), dict(goal.effectiveness), set(goal.free)
    for diagnosis in diagnoses:
        fault = check.instance("diagnoses", diagnosis, Diagnosis).fault
        actuator = check.integer("actuator of diagnoses", fault.actuator, n)
        if diagnosis.fault.kind == "locked":
            locked_at[actuator] = diagnosis.displacement
        elif (share := used_share(nominal, diagnosis.fault)) > 0:
            effectiveness[actuator] = share
        elif unused == "locked":
            locked_at[actuator] = 0.0
        else:
            free.add(actuator)
    not_locked = tuple(sorted(free - {*locked_at}))
    return replace(goal, locked_at=locked_at, effectiveness=effectiveness, free=not_locked)


def with_margin(goal: Goal, known: Goal) -> Goal:
    """Return the goal with at least `_LEAST_ASSUMED` of weak actuators that are not `known`."""
    least = {k: min(_LEAST_ASSUMED, known.effectiveness.get(k, 1.0)) for k in goal.effectiveness}
    driven = {k: max(part, least[k]) for k, part in goal.effectiveness.items()}
    return replace(goal, effectiveness=driven)


class Scenario(NamedTuple):
    """Possible faults of the machine with their probability, and its state x (s,) with them."""

    probability: float
    faults: Sequence[Fault]
    x: Array


@dataclass(frozen=True)
class ErrorPrediction:
    """Prediction of the tracking error, by which one of two controllers is chosen.

    A diagnosis has a probability, so the switch is a decision under risk with the least expected
    cost (Berger, Statistical Decision Theory and Bayesian Analysis, 1985, section 1.3). The cost is
    the RMS error of the major task that the linear model predicts from the present states of
    machine and controllers.

    Attributes:
        nominal: Linear model of the healthy machine; its first outputs are the major task.
        output: Last measured major task, shape (m1,); its model error is assumed constant.
        references: Predicted references of the major task, tick by tick, shape (N, m1).
        secondary: References of the secondary goal, shape (N, n).
        unused: Commands of actuators out of use, shape (N, n).
        feedforward: Feedforward demands, shape (N, m1); None is the default of the controllers.
    """

    nominal: NominalModel
    output: Array
    references: Array
    secondary: Array
    unused: Array
    feedforward: Array | None = None

    def rms(
        self,
        controller: PrioritizedController[Any],
        state: ControllerState[Any],
        case: Scenario,
        enough: float = np.inf,
    ) -> float:
        """Return the predicted RMS error of the major task for a controller in this state.

        It is in standard deviations of the sensors' noise, so that rows of different units are
        comparable, and infinite on divergence. Once it certainly exceeds `enough`, the prediction
        ends and the partial error is returned.
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
            state = controller.step(
                state,
                reference,
                measured,
                self.secondary[tick],
                feedforward=None if self.feedforward is None else self.feedforward[tick],
                unused_reference=self.unused[tick],
            )
            x = model.step(x, controller.drives.displacements(state.inputs))
        return float(np.sqrt(square / len(self.references)))

    def should_switch(
        self,
        present: tuple[PrioritizedController[Any], ControllerState[Any]],
        candidate: tuple[PrioritizedController[Any], ControllerState[Any]],
        scenarios: Sequence[Scenario],
    ) -> bool:
        """Return whether the expected error of a new controller is at most the present one's.

        Errors below the sensors' noise count as equal. `present` and `candidate` are the two
        controllers with their states, `scenarios` the possible faults.
        """
        scenarios = [case for case in scenarios if case.probability > 0]  # the others round to zero
        switch_cost = sum(case.probability * self.rms(*candidate, case) for case in scenarios)
        bearable, stay_cost = float(np.sqrt(len(self.output))), 0.0
        for case in scenarios:
            if switch_cost <= max(stay_cost, bearable):  # `stay_cost` only grows
                return True
            enough = (_ABOVE * switch_cost - stay_cost) / case.probability
            stay_cost += case.probability * self.rms(*present, case, enough)
        return switch_cost <= max(stay_cost, bearable)
