"""Diagnosis beside control: a controller that isolates failed actuators and reconfigures itself."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from argument_checks import Array
from ftc.controller import Controller, Converter, Sensed
from ftc.fdi.diagnosis import Diagnosis, MonitorState
from ftc.fdi.fault_model import Fault
from ftc.fdi.monitor import Monitor
from ftc.goal import Goal
from ftc.oracle import PointingState


@dataclass(frozen=True)
class SupervisorState(PointingState):
    """What the supervisor remembers.

    Attributes:
        flies: The controller in use; `controller` is its state.
        watch: State of the monitor.
        monitor: That monitor.
        confirmed: The confirmed diagnoses.
        diagnoses: All that were made, revised and withdrawn ones included, in order.
        task_lost: Whether the remaining actuators cannot do the major task; the commands then
            stand still.
        ticks: So far.
    """

    flies: Controller[Any]
    watch: MonitorState
    monitor: Monitor
    confirmed: tuple[Diagnosis, ...] = ()
    diagnoses: tuple[Diagnosis, ...] = ()
    task_lost: bool = False
    ticks: int = 0

    @property
    def standing(self) -> list[Diagnosis]:
        """The last diagnosis confirmed of each actuator, and the one being confirmed."""
        latest = self.confirmed
        if self.watch.diagnosis is not None:
            latest = (*latest, self.watch.diagnosis)
        return list({each.fault.actuator: each for each in latest}.values())


@dataclass(frozen=True)
class Supervisor:
    """Diagnosis beside control.

    Attributes:
        first: Controller of the sound machine.
        monitor: Of the sound machine.
        secondary: Reference of the secondary goal (n,) at each time of the run.
        reconfigured: Controller that knows of these failures.
        can_point: Whether the major task can still be done in spite of them.
    """

    first: Controller[Any]
    monitor: Monitor
    secondary: Callable[[float], Array]
    reconfigured: Callable[[Sequence[Diagnosis]], Controller[Any]]
    can_point: Callable[[Sequence[Fault]], bool]

    @property
    def amplifier(self) -> Converter:
        """The same for all controllers."""
        return self.first.amplifier

    def start(self) -> SupervisorState:
        """At rest at the nominal pose, no failure known."""
        return SupervisorState(self.first.start(), self.first, self.monitor.start(), self.monitor)

    def step(self, state: SupervisorState, desired_rad: Array, sensed: Sensed) -> SupervisorState:
        """One control tick: first the diagnosis, then the control."""
        if state.task_lost and state.watch.diagnosis is None:
            return replace(state, ticks=state.ticks + 1)
        sent_m = self.amplifier.displacement_m(state.input_percent)
        known = state.watch.diagnosis
        measured = np.concatenate([sensed.pointing_rad, sensed.strut_m])
        outputs = len(state.monitor.nominal.noise)  # without the actuators' sensors unless used
        watch = state.monitor.step(state.watch, measured[:outputs], sent_m)
        state = replace(state, watch=watch)
        if watch.diagnosis is not known:
            state = self._reconfigured(state, sent_m)
        if not state.task_lost:
            rest_m = self.secondary(state.ticks * self.first.period_s)
            controller = state.flies.step(state.controller, desired_rad, sensed, rest_m)
            state = replace(state, controller=controller)
        return replace(state, ticks=state.ticks + 1)

    def _reconfigured(self, state: SupervisorState, sent_m: Array) -> SupervisorState:
        """The mapping goes over to the present diagnoses; the compensators stay."""
        found, believed = state.watch.diagnosis, state.standing
        falling_m = np.zeros(len(sent_m))
        if found is not None:
            state = replace(state, diagnoses=(*state.diagnoses, found))
            falling_m = falling(found, sent_m)
        lost = not self.can_point([each.fault for each in believed])
        state = replace(state, task_lost=lost)
        if not lost:
            flies = self.reconfigured(believed)
            controller = flies.take_over(state.controller, falling_m)
            state = replace(state, flies=flies, controller=controller)
        if found is None or not found.confirmed:
            return state
        state = replace(state, confirmed=(*state.confirmed, found))
        if lost:  # nothing is left to be done about another failure
            return replace(state, watch=replace(state.watch, diagnosis=None, evidence=None))
        monitor, watch = state.monitor.believing(state.watch)
        return replace(state, monitor=monitor, watch=watch)


WEAKEST = 0.5
"""An actuator that has less of its force left is not used. Commanded seven times as much because of
a wrong diagnosis, a sound strut would make the loop unstable: docs/recover.md."""


def reckoned_strength(diagnosis: Diagnosis) -> float:
    """Part of its force that the mapping takes an actuator to have; 0: it is not used."""
    fault = diagnosis.fault
    return fault.effectiveness if fault.kind == "weak" and fault.effectiveness >= WEAKEST else 0.0


def falling(diagnosis: Diagnosis, sent_m: Array) -> Array:
    """What the diagnosed actuator is about to lose of its displacement, shape (n,).

    `sent_m`, shape (n,), is what the actuators are commanded to. A locked actuator loses nothing,
    nor does one that was diagnosed before.
    """
    fault, falling_m = diagnosis.fault, np.zeros(len(sent_m))
    if fault.kind != "locked" and not diagnosis.confirmed:
        held_m = reckoned_strength(diagnosis) * sent_m[fault.actuator]
        falling_m[fault.actuator] = diagnosis.displacement - held_m
    return falling_m


def reconfigured_goal(goal: Goal, diagnoses: Sequence[Diagnosis]) -> Goal:
    """The goal with what is known of the actuators.

    An actuator without force counts as locked at its centre, where its spring holds it: on the
    hexapod to 6e-4, and in a loop of 8 Hz that is the better model even without the spring
    (docs/theory.md).
    """
    locked_m = dict(goal.locked_m)
    strength = dict(goal.strength)
    for diagnosis in diagnoses:
        fault, left = diagnosis.fault, reckoned_strength(diagnosis)
        if left > 0:
            strength[fault.actuator] = left
        else:
            locked_m[fault.actuator] = diagnosis.displacement if fault.kind == "locked" else 0.0
    return replace(goal, locked_m=locked_m, strength=strength)
