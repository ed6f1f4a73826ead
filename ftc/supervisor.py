"""Supervised control: a controller that isolates failed actuators and is reconfigured."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, get_args

import numpy as np

import argument_checks as check
from argument_checks import Array
from argument_checks.records import changed
from ftc.control.mapping import Goal
from ftc.controller import ControllerState, Measurement, NestedState, PrioritizedController
from ftc.fdi.bank import Cause
from ftc.fdi.decision import EFFECTIVENESS_STEP
from ftc.fdi.diagnosis import Diagnosis
from ftc.fdi.dither import Dither
from ftc.fdi.fault_model import Fault, NominalModel, static_share
from ftc.fdi.monitor import Monitor, MonitorState
from ftc.fdi.observer import LEARNING_S
from ftc.reconfiguration import (
    WEAKEST,
    ErrorPrediction,
    Scenario,
    Unused,
    goal_after,
    lost_displacement,
    with_margin,
)
from ftc.sensors import SensorCheck, Sensors, numeric_measurement

TEST_PART = 0.25
"""An actuator out of use is given this part of the dither: if it works, the task feels it, because
the others do not know, and a diagnosis sees it; the sound ones' cancels out."""

_NEARLY_ALL = 0.999
"""Of its force: what a weak actuator that may be sound by now counts as."""

_AHEAD_S = 1.0
"""So far ahead errors are predicted for a decision; what was asked of late is taken backwards."""

_StatefulController = tuple[PrioritizedController[Any], ControllerState[Any]]
"""A controller and its state."""


@dataclass(frozen=True)
class SupervisorState(NestedState):
    """State of the supervisor.

    Attributes:
        current: The controller in use; `controller` is its state.
        monitor: The monitor, and `watch` its state.
        sensors: What they read so far, and whether it was usable.
        diagnoses: All that were made, revised and withdrawn ones included, in order.
        task_lost: Whether the actuators that are left by confirmed diagnoses cannot do the major
            task; the controller then goes on as it was, with what it still reaches.
        withdrawn: Diagnoses that were taken back, and when.
        acted: Diagnoses from which the controller in use changed.
        references: Of the major task of late, one for each sample of the diagnosis, newest first.
        feedforward: Demands beside the compensators, likewise; empty: none were given.
        refused: The last diagnosis that was not acted on: doing nothing was expected to cost less.
    """

    current: PrioritizedController[Any]
    monitor_state: MonitorState
    monitor: Monitor
    sensors: Sensors
    confirmed: tuple[Diagnosis, ...] = ()
    diagnoses: tuple[Diagnosis, ...] = ()
    task_lost: bool = False
    withdrawn: tuple[tuple[Diagnosis, int], ...] = ()
    acted: tuple[Diagnosis, ...] = ()
    references: tuple[Array, ...] = ()
    feedforward: tuple[Array, ...] = ()
    rejected: Diagnosis | None = None

    @property
    def status(self) -> str:
        """What is believed, not understood and done, in one sentence.

        Actuators are called by the names that the monitor's model has, or by their numbers.
        """
        monitor_state, names = self.monitor_state, self.monitor.nominal.names
        failed = ", ".join(map(self._described, self.active_diagnoses))
        parts = [failed or "all actuators are believed sound"]
        current = monitor_state.diagnosis
        if current is not None and current.fault.is_healthy:
            parts.append(f"{_name(current.fault.actuator, names)} seems to work again")
        if monitor_state.relearns > 0:
            parts.append("what no failure explains is learned as part of the machine")
        elif monitor_state.evidence is not None and current is None:
            parts.append("an alarm is looked into")
        elif monitor_state.causes and not self.active_diagnoses:
            cause = explanation(monitor_state.causes[-1], names)
            parts.append(f"the last alarm is explained by {cause}, which is no failure")
        known = self.current.mapping.goal.failed
        if self.task_lost:
            parts.append(
                "the major task is lost, and the controller goes on with what it still reaches"
            )
        elif self.rejected is not None and self.rejected.fault.actuator not in known:
            parts.append("the controller goes on as it was, which is expected to cost less")
        elif self.active_diagnoses:
            parts.append("the other actuators do the task")
        text = "; ".join(parts)
        if names is None or not self.active_diagnoses:  # a name stays as it is
            text = text[0].upper() + text[1:]
        return f"{text}."

    def _described(self, diagnosis: Diagnosis) -> str:
        name = _name(diagnosis.fault.actuator, self.monitor.nominal.names)
        suffix = "" if diagnosis.confirmed else ", not yet confirmed"
        return f"{name} is {' or '.join(diagnosis.kinds)}{suffix}"

    def __repr__(self) -> str:
        """One line, for interactive use."""
        return f"<SupervisorState after {self.ticks} ticks. {self.status}>"

    @property
    def is_learning(self) -> bool:
        """Whether what the sensors read is still taken for the machine without a failure."""
        learned_s = self.monitor_state.observer.spectrum.samples * self.monitor.observer.period_s
        return learned_s <= LEARNING_S

    @property
    def active_diagnoses(self) -> list[Diagnosis]:
        """The last diagnosis confirmed of each actuator, and the one being confirmed.

        Without those that work again, once that is confirmed: one that comes and goes stays out.
        """
        latest, current = self.confirmed, self.monitor_state.diagnosis
        if current is not None and current.is_acted_on:
            latest = (*latest, current)
        last = {diagnosis.fault.actuator: diagnosis for diagnosis in latest}
        return [diagnosis for diagnosis in last.values() if not diagnosis.fault.is_healthy]


def explanation(cause: Cause | None, names: Sequence[str] | None = None) -> str:
    """What an alarm is explained by that is no failure."""
    if cause is None:
        return "something slow"
    if cause.kind == "offset":
        return f"an offset of {_name(cause.actuator, names)}"
    shared = {"supply": "what all commands do", "scale": "the sensors' scale"}
    return f"a change of {shared[cause.kind]}"


def _name(actuator: int, names: Sequence[str] | None) -> str:
    return f"actuator {actuator}" if names is None else names[actuator]


@dataclass(frozen=True)
class Supervisor:
    """Controller of any mechanism that diagnoses actuator failures and is reconfigured.

    Attributes:
        goal: While all actuators work.
        controller: For a goal, failures that it knows included.
        monitor: Of the sound machine, with the frequency of the dither in its `config`.
        is_possible: Whether the major task can still be done in spite of these faults.
        task: Linear model of the sound machine to the major task; None: the monitor's model, whose
            first outputs it is.
        unused: As of :func:`goal_after`.
        dither: Secondary motion by which failures are told apart; None is none.
        watched: What the diagnosis looks at, where the controller estimates the pose and has found
            these faults; None: the major task, then the displacements, as many as the monitor's
            model has outputs.
        estimate: The major task (m1,) by the encoders alone, near an estimated pose, for a time
            when its own sensor is lost; None: the commands are held.
        sensor_check: When readings of the task are usable; None is :class:`.SensorCheck` as it is,
            which is that of the encoders, where they are used.
    """

    goal: Goal
    controller: Callable[[Goal], PrioritizedController[Any]]
    monitor: Monitor
    is_possible: Callable[[Sequence[Fault]], bool]
    task: NominalModel | None = None
    unused: Unused = "free"
    dither: Dither | None = None
    diagnosis_outputs: Callable[[Measurement, Any, tuple[Fault, ...]], Array] | None = None
    estimate: Callable[[Measurement, Any], Array] | None = None
    sensor_check: SensorCheck | None = None

    def __repr__(self) -> str:
        """One line, for interactive use."""
        nominal = self.monitor.nominal
        names = ", ".join(nominal.names or (f"{nominal.actuators} actuators",))
        return f"<Supervisor of {names}>"

    def __post_init__(self) -> None:
        for name in ("controller", "is_possible", "watched", "estimate"):
            function = getattr(self, name)
            if function is not None or name in ("controller", "is_possible"):
                check.function(name, function)
        n = check.instance("monitor", self.monitor, Monitor).nominal.actuators
        check.instance("goal", self.goal, Goal).of(n)
        check.choice("unused", self.unused, get_args(Unused))
        check.instance("sensor_check", self._checks[0], SensorCheck)
        check.instance("task", self._task, NominalModel)
        if self.dither is not None:
            moved = len(check.instance("dither", self.dither, Dither).direction)
            if moved != n:
                raise ValueError(f"dither must have a direction of {n} actuators, got {moved}")
        for name, model in {"monitor": self.monitor.nominal, "task": self._task}.items():
            first = self.first.mapping.actuators, self.first.period_s
            if (model.actuators, model.period_s) != first:
                raise ValueError(
                    f"{name} must be of the {first[0]} actuators and the period of the controller, "
                    f"{first[1]} s, got {model.actuators} and {model.period_s} s"
                )

    @cached_property
    def first(self) -> PrioritizedController[Any]:
        """The controller of the sound machine."""
        return check.instance("controller(goal)", self.controller(self.goal), PrioritizedController)

    def reconfigured(self, diagnoses: Sequence[Diagnosis]) -> PrioritizedController[Any]:
        """The controller that knows of these failures."""
        known = goal_after(self.goal, diagnoses, self.monitor.nominal, self.unused)
        return self.controller(with_margin(known, self.goal))

    def secondary(self, time_s: float) -> Array:
        """Reference (n,) of the secondary goal at a time of the run."""
        if self.dither is None:
            return np.zeros(self.monitor.nominal.actuators)
        return self.dither.at(time_s)

    @cached_property
    def _test_motion(self) -> Callable[[float], Array]:
        """Command (n,) of actuators out of use at each time: one that works is seen by it."""
        if self.dither is None:
            return self.secondary
        return replace(self.dither, amplitude=TEST_PART * self.dither.amplitude, offset=0.0).at

    @property
    def _task(self) -> NominalModel:
        return self.monitor.nominal if self.task is None else self.task

    @cached_property
    def _checks(self) -> tuple[SensorCheck, SensorCheck]:
        """Of the task, and of the encoders."""
        usual = SensorCheck(self.first.period_s)
        return usual if self.sensor_check is None else self.sensor_check, usual

    @cached_property
    def _rows(self) -> int:
        """Number of rows of the major task."""
        return len(self.first.mapping.initial_command().demand)

    def start(self) -> SupervisorState:
        """State at rest at the nominal pose, without known failures."""
        of_task, of_encoders = self._checks
        used = (
            self.diagnosis_outputs or self.estimate or len(self.monitor.nominal.noise) > self._rows
        )
        encoders = of_encoders.start(self.first.mapping.actuators if used else 0)
        sensors, monitor_state = Sensors(of_task.start(self._rows), encoders), self.monitor.start()
        return SupervisorState(
            self.first.start(), 0, self.first, monitor_state, self.monitor, sensors
        )

    def calibrated(self, state: SupervisorState) -> "Supervisor":
        """The supervisor that begins with what another run has learned of the same machine.

        It need not take its first samples for those of a sound machine.

        Raises:
            ValueError: That run had a failure, or ended before anything was learned.
        """
        observer = check.instance("state", state, SupervisorState).monitor_state.observer
        if state.diagnoses or state.monitor_state.relearns or state.is_learning:
            raise ValueError(
                "state must be of a run without a failure, longer than "
                f"{LEARNING_S:g} s, got: {state.status}"
            )
        return replace(self, monitor=replace(self.monitor, calibration=observer))

    def transfer(self, state: SupervisorState | ControllerState[Any]) -> SupervisorState:
        """The state of another pilot of the machine, so that this one continues without a step.

        What a supervisor believes stays, though its goal was another one. A controller alone
        believes nothing: the diagnosis then begins to learn what the machine is like.
        """
        if isinstance(state, SupervisorState):
            current, controller = self._transferred(state, state.active_diagnoses)
            return replace(state, current=current, controller=controller)
        return replace(self.start(), controller=self.first.transfer(state))

    def step(
        self,
        state: SupervisorState,
        reference: Array,
        measurement: Measurement,
        *,
        feedforward: Array | None = None,
    ) -> SupervisorState:
        """One control tick: first the sensors, then the diagnosis, then the control.

        Without a usable reading of the task the commands and the controller's state stay as they
        are, unless the encoders give an estimate; the diagnosis goes on without what is missing:
        what is no numbers, or masked.
        """
        check.instance("state", state, SupervisorState)
        reference = check.array("reference", reference, self._rows)
        if feedforward is not None:
            feedforward = check.array("feedforward", feedforward, self._rows)
        measurement = numeric_measurement(measurement, self._rows, self.first.mapping.actuators)
        ticks, is_sample = state.ticks + 1, state.ticks % state.monitor.ticks == 0
        commanded = self.first.drives.displacements(state.inputs)
        estimable = self.estimate is not None
        read = measurement, state.inputs, *self._checks
        sensors = state.sensors.after(*read, estimable=estimable)
        measured = self._outputs_for_diagnosis(state, measurement, sensors)
        monitor_state = state.monitor.step(state.monitor_state, measured, commanded)
        if is_sample:
            ahead = round(_AHEAD_S / (state.monitor.ticks * self.first.period_s))
            state = changed(state, references=(reference, *state.references[:ahead]))
            if feedforward is not None:
                state = changed(state, feedforward=(feedforward, *state.feedforward[:ahead]))
        if monitor_state.diagnosis is not state.monitor_state.diagnosis:
            state = self._reconfigured(state, monitor_state, commanded, measurement)
            monitor_state = state.monitor_state
        elif is_sample and state.current.mapping.goal.effectiveness:
            state = self._with_tracked_effectiveness(state, monitor_state)
        if not (sensors.task.usable or sensors.estimates):
            return changed(state, monitor_state=monitor_state, sensors=sensors, ticks=ticks)
        if self.estimate is not None and sensors.estimates:
            estimated = self.estimate(measurement, state.pose)
            measurement = Measurement(estimated, measurement.displacement)
        time_s = state.ticks * self.first.period_s
        controller = state.current.step(
            state.controller,
            reference,
            measurement,
            self.secondary(time_s),
            feedforward=feedforward,
            unused_reference=self._test_motion(time_s),
        )
        return changed(
            state, monitor_state=monitor_state, sensors=sensors, controller=controller, ticks=ticks
        )

    def _outputs_for_diagnosis(
        self, state: SupervisorState, measurement: Measurement, sensors: Sensors
    ) -> Array | None:
        """What the diagnosis looks at; None where any of it is missing."""
        new = sensors.task.new
        if not sensors.encoders.new or not (new or self.diagnosis_outputs):
            return None
        if self.diagnosis_outputs is None:
            readings = np.concatenate([measurement.output, measurement.displacement])
            return readings[: len(self.monitor.nominal.noise)]
        faults = tuple(diagnosis.fault for diagnosis in state.active_diagnoses)
        if new:
            return self.diagnosis_outputs(measurement, state.pose, faults)
        encoders_only = Measurement(np.full(self._rows, np.nan), measurement.displacement)
        measured = self.diagnosis_outputs(encoders_only, state.pose, faults)
        return measured if np.isfinite(measured).all() else None

    def _reconfigured(
        self,
        state: SupervisorState,
        monitor_state: MonitorState,
        commanded: Array,
        measurement: Measurement,
    ) -> SupervisorState:
        """State after a change of the diagnosis to that of `watch`; compensators unchanged."""
        previous, diagnosis = state.monitor_state.diagnosis, monitor_state.diagnosis
        present = state.current, state.controller
        state = replace(state, monitor_state=monitor_state)
        # Another actuator, or none, is named now; another kind is a revision.
        isolated = None if diagnosis is None else diagnosis.fault.actuator
        if previous is not None and previous.fault.actuator != isolated:
            state = replace(state, withdrawn=(*state.withdrawn, (previous, state.ticks)))
            if previous.is_acted_on:
                certain = [entry for entry in state.active_diagnoses if entry.confirmed]
                present = self._transferred(state, certain)
                lost = state.task_lost and not self.is_possible([entry.fault for entry in certain])
                state = replace(state, task_lost=lost)
        candidate, rejected = present, None
        if diagnosis is not None:
            state = replace(state, diagnoses=(*state.diagnoses, diagnosis))
        if diagnosis is not None and diagnosis.is_acted_on:
            active = state.active_diagnoses
            faults = [entry.fault for entry in active]
            possible = self.is_possible(faults)
            # The present controller goes on then: to stand still is worse, and names may be wrong.
            state = replace(state, task_lost=diagnosis.confirmed and not possible)
            if possible:
                lost = lost_displacement(self.monitor.nominal, diagnosis, faults, commanded)
                candidate = self._transferred(state, active, lost)
                if self._should_switch(state, diagnosis, present, candidate, measurement):
                    state = replace(state, acted=(*state.acted, diagnosis))
                else:
                    candidate, rejected = present, diagnosis
        current, controller = candidate
        state = replace(state, current=current, controller=controller, rejected=rejected)
        if diagnosis is None or not diagnosis.confirmed:
            return state
        state = replace(state, confirmed=(*state.confirmed, diagnosis))
        monitor, monitor_state = state.monitor.with_diagnosis(state.monitor_state)
        return replace(state, monitor=monitor, monitor_state=monitor_state)

    def _with_tracked_effectiveness(
        self, state: SupervisorState, monitor_state: MonitorState
    ) -> SupervisorState:
        """State in which weak actuators are driven by the inverse of the most that they may have.

        So that none ever does more than a sound one: what evidence is older than, or an alarm calls
        in question, is given up before anything else is known.
        """
        strongest, confirmed = dict(state.monitor.observer.strongest(monitor_state.observer)), []
        driven = state.current.mapping.goal.effectiveness
        estimates = {entry.actuator: entry.effectiveness for entry in state.monitor.observer.weak}
        for entry in state.confirmed:
            fault, k = entry.fault, entry.fault.actuator
            if k in driven and k in estimates and fault.kind == "weak" and not fault.is_healthy:
                most = min(max(strongest[k], estimates[k]), _NEARLY_ALL)
                if abs(most - fault.effectiveness) > EFFECTIVENESS_STEP:
                    entry = replace(entry, fault=replace(fault, effectiveness=most))
            confirmed.append(entry)
        if tuple(confirmed) == state.confirmed:
            return state
        state = replace(state, confirmed=tuple(confirmed))
        current, controller = self._transferred(state, state.active_diagnoses)
        is_new = monitor_state.alarm_ticks != state.monitor_state.alarm_ticks
        if monitor_state.evidence is not None or is_new:
            # What moved may be what was commanded more: that is taken back at once.
            controller = state.controller
        return replace(state, current=current, controller=controller)

    def _transferred(
        self,
        state: SupervisorState,
        diagnoses: Sequence[Diagnosis],
        lost_displacements: Array | None = None,
    ) -> _StatefulController:
        """The controller for these diagnoses, and its state if it took over now."""
        diagnoses = [_in_use(diagnosis) for diagnosis in diagnoses]
        current = self.reconfigured(diagnoses)
        acting, keeps = np.zeros((2, self.first.mapping.actuators))
        if lost_displacements is not None:
            # One that the others carry loses nothing when its force is gone.
            lost_displacements[list(current.mapping.goal.free)] = 0.0
        for diagnosis in diagnoses:
            acting[diagnosis.fault.actuator] = static_share(self.monitor.nominal, diagnosis.fault)
            keeps[diagnosis.fault.actuator] = diagnosis.fault.kind == "locked"
        arguments = lost_displacements, acting, keeps
        test_command = self._test_motion(state.ticks * self.first.period_s)
        controller = current.transfer(state.controller, *arguments, unused_reference=test_command)
        return current, controller

    def _should_switch(
        self,
        state: SupervisorState,
        diagnosis: Diagnosis,
        present: _StatefulController,
        candidate: _StatefulController,
        measurement: Measurement,
    ) -> bool:
        """Whether to go over is not expected to cost much more than to stay."""
        decision, monitor = state.monitor_state.decision, state.monitor
        if decision is None or not np.isfinite(measurement.output).all():
            return True
        ticks = state.ticks + np.arange(len(state.references) * monitor.ticks)
        times_s = (ticks * self.first.period_s).tolist()
        prediction = ErrorPrediction(
            self._task,
            measurement.output,
            np.repeat(state.references, monitor.ticks, axis=0),
            np.array(list(map(self.secondary, times_s))),
            np.array(list(map(self._test_motion, times_s))),
            np.repeat(state.feedforward, monitor.ticks, axis=0) if state.feedforward else None,
        )
        faults = [entry.fault for entry in state.active_diagnoses]
        probability = diagnosis.actuator_confidence
        isolated = Scenario(probability, faults, decision.x)
        alternative = Scenario(1 - probability, monitor.faults, state.monitor_state.observer.X[0])
        return prediction.should_switch(present, candidate, [isolated, alternative])


def _in_use(diagnosis: Diagnosis) -> Diagnosis:
    """The diagnosis; of one too weak to be used by less than its estimate may be off, as if used.

    Nothing is taken out of use, nor given back, because an estimate is revised a little.
    """
    fault = diagnosis.fault
    if fault.kind != "weak" or not WEAKEST - EFFECTIVENESS_STEP < fault.effectiveness < WEAKEST:
        return diagnosis
    return replace(diagnosis, fault=replace(fault, effectiveness=WEAKEST))
