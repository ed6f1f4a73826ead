"""Supervised control: isolation of actuator failures and reconfiguration of the controller."""

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
from ftc.fdi.fault_model import Fault, NominalModel, actuator_name, static_share
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
"""Fraction of the dither that an actuator out of use is commanded: if it works, its motion is not
compensated by the others, and the diagnosis detects it; the dither of healthy ones cancels out."""

_NEARLY_ALL = 0.999
"""Effectiveness assumed for a weak actuator that may be healthy again."""

_AHEAD_S = 1.0
"""Horizon of error predictions [s]; recent references are replayed in reverse as a forecast."""

_StatefulController = tuple[PrioritizedController[Any], ControllerState[Any]]
"""Controller and its state."""


@dataclass(frozen=True)
class SupervisorState(NestedState):
    """State of the supervisor.

    Attributes:
        current: Controller in use; `controller` is its state.
        monitor_state: State of the monitor.
        monitor: Monitor of the plant with the confirmed failures.
        sensors: States of the sensors.
        confirmed: Confirmed diagnoses, in order.
        diagnoses: All diagnoses, revised and withdrawn ones included, in order.
        task_lost: Whether the remaining actuators cannot do the major task, by confirmed diagnoses;
            the controller then continues unchanged.
        withdrawn: Withdrawn diagnoses and the ticks of their withdrawal.
        acted: Diagnoses that caused a change of the controller.
        references: Recent references of the major task, one for each sample of the diagnosis,
            newest first.
        feedforward: Recent feedforward demands in the same order; empty: none were given.
        rejected: Last diagnosis without a switch, because its expected error was larger.
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
        """Diagnosis and reaction in one sentence.

        Actuators have the names of the monitor's model, or else their numbers.
        """
        monitor_state, names = self.monitor_state, self.monitor.nominal.names
        failed = ", ".join(map(self._described, self.active_diagnoses))
        parts = [failed or "all actuators are assumed healthy"]
        current = monitor_state.diagnosis
        if current is not None and current.fault.is_healthy:
            parts.append(f"{actuator_name(names, current.fault.actuator)} seems to work again")
        if monitor_state.relearns > 0:
            parts.append("residuals that no failure explains are learned as part of the machine")
        elif monitor_state.evidence is not None and current is None:
            parts.append("an alarm is being investigated")
        elif monitor_state.causes and not self.active_diagnoses:
            cause = explanation(monitor_state.causes[-1], names)
            parts.append(f"the last alarm is explained by {cause}, which is no failure")
        known = self.current.mapping.goal.failed
        if self.task_lost:
            parts.append("the major task is lost, and the controller continues unchanged")
        elif self.rejected is not None and self.rejected.fault.actuator not in known:
            parts.append("the controller is unchanged, which is expected to give a smaller error")
        elif self.active_diagnoses:
            parts.append("the other actuators perform the task")
        text = "; ".join(parts)
        if names is None or not self.active_diagnoses:  # the case of a name is kept
            text = text[0].upper() + text[1:]
        return f"{text}."

    def _described(self, diagnosis: Diagnosis) -> str:
        name = actuator_name(self.monitor.nominal.names, diagnosis.fault.actuator)
        suffix = "" if diagnosis.confirmed else ", not yet confirmed"
        return f"{name} is {' or '.join(diagnosis.kinds)}{suffix}"

    def __repr__(self) -> str:
        """Return one line for interactive use."""
        return f"<SupervisorState after {self.ticks} ticks. {self.status}>"

    @property
    def is_learning(self) -> bool:
        """Return whether the readings are still assumed to be those of a healthy machine."""
        learned_s = self.monitor_state.observer.spectrum.samples * self.monitor.observer.period_s
        return learned_s <= LEARNING_S

    @property
    def active_diagnoses(self) -> list[Diagnosis]:
        """Latest diagnosis of each failed actuator, confirmed or being confirmed.

        An actuator that works again is listed until this is confirmed, so that an intermittent one
        stays out of use.
        """
        latest, current = self.confirmed, self.monitor_state.diagnosis
        if current is not None and current.is_acted_on:
            latest = (*latest, current)
        last = {diagnosis.fault.actuator: diagnosis for diagnosis in latest}
        return [diagnosis for diagnosis in last.values() if not diagnosis.fault.is_healthy]


def explanation(cause: Cause | None, names: Sequence[str] | None = None) -> str:
    """Describe a cause of an alarm that is not a failure; None is a slow disturbance."""
    if cause is None:
        return "a slow disturbance"
    if cause.kind == "offset":
        return f"an offset of the command of {actuator_name(names, cause.actuator)}"
    shared = {"supply": "the gain of all commands", "scale": "the scale of all sensors"}
    return f"a change of {shared[cause.kind]}"


@dataclass(frozen=True)
class Supervisor:
    """Controller of any mechanism that diagnoses actuator failures and is reconfigured.

    Attributes:
        goal: Goal while all actuators work.
        controller: Function that returns the controller for a goal with its known failures.
        monitor: Monitor of the healthy machine, with the frequency of the dither in its `config`.
        is_possible: Function that returns whether the major task can be done with these faults.
        task: Linear model of the healthy machine to the major task; None: the monitor's model,
            whose first outputs are the major task.
        unused: Argument `unused` of :func:`goal_after`.
        dither: Secondary motion that makes failures distinguishable; None: no dither.
        diagnosis_outputs: Function from a measurement, the estimated pose and the diagnosed faults
            to the outputs of the monitor's model; None: the major task, then the displacements, as
            many as the model has outputs.
        estimate: Function from a measurement and the estimated pose to the major task (m1,) by the
            encoders, used while the task's sensor is lost; None: the commands are then held.
        sensor_check: Check of the readings of the task; None is the default :class:`.SensorCheck`,
            which is also that of the encoders.
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
        """Return one line for interactive use."""
        nominal = self.monitor.nominal
        names = ", ".join(nominal.names or (f"{nominal.actuators} actuators",))
        return f"<Supervisor of {names}>"

    def __post_init__(self) -> None:
        for name in ("controller", "is_possible", "diagnosis_outputs", "estimate"):
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
        """Controller of the healthy machine."""
        return check.instance("controller(goal)", self.controller(self.goal), PrioritizedController)

    def reconfigured(self, diagnoses: Sequence[Diagnosis]) -> PrioritizedController[Any]:
        """Return the controller for these failures."""
        known = goal_after(self.goal, diagnoses, self.monitor.nominal, self.unused)
        return self.controller(with_margin(known, self.goal))

    def secondary(self, time_s: float) -> Array:
        """Return the reference (n,) of the secondary goal at a time of the run [s]."""
        if self.dither is None:
            return np.zeros(self.monitor.nominal.actuators)
        return self.dither.at(time_s)

    @cached_property
    def _test_motion(self) -> Callable[[float], Array]:
        """Function of time [s] that returns the test commands (n,) of actuators out of use."""
        if self.dither is None:
            return self.secondary
        return replace(self.dither, amplitude=TEST_PART * self.dither.amplitude, offset=0.0).at

    @property
    def _task(self) -> NominalModel:
        return self.monitor.nominal if self.task is None else self.task

    @cached_property
    def _checks(self) -> tuple[SensorCheck, SensorCheck]:
        """Checks of the task's sensor and of the encoders."""
        usual = SensorCheck(self.first.period_s)
        return usual if self.sensor_check is None else self.sensor_check, usual

    @cached_property
    def _rows(self) -> int:
        """Number of rows m1 of the major task."""
        return len(self.first.mapping.initial_command().demand)

    def start(self) -> SupervisorState:
        """Return the state at rest at the nominal pose, without known failures."""
        of_task, of_encoders = self._checks
        more = len(self.monitor.nominal.noise) > self._rows
        used = self.diagnosis_outputs or self.estimate or more
        encoders = of_encoders.start(self.first.mapping.actuators if used else 0)
        sensors = Sensors(of_task.start(self._rows), encoders)
        start = self.first.start(), 0, self.first, self.monitor.start(), self.monitor, sensors
        return SupervisorState(*start)

    def calibrated(self, state: SupervisorState) -> "Supervisor":
        """Return the supervisor calibrated by the final state of another run of the same machine.

        It starts testing at once, instead of learning the spectrum from its first samples.

        Raises:
            ValueError: That run had a failure, or ended before the spectrum was learned.
        """
        observer = check.instance("state", state, SupervisorState).monitor_state.observer
        if state.diagnoses or state.monitor_state.relearns or state.is_learning:
            raise ValueError(
                "state must be of a run without a failure, longer than "
                f"{LEARNING_S:g} s, got: {state.status}"
            )
        return replace(self, monitor=replace(self.monitor, calibration=observer))

    def transfer(self, state: SupervisorState | ControllerState[Any]) -> SupervisorState:
        """Return the state with which this supervisor takes over from a controller without a step.

        Diagnoses of a previous supervisor remain, even if its goal differs. After a controller
        without diagnosis, the monitor starts learning.
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
        """Advance by one control tick: check sensors, diagnose, then control.

        Without a usable reading of the task, commands and controller state are held, unless the
        encoders give an estimate. The diagnosis continues without missing (non-numeric or masked)
        readings.
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
        measured = self._readings(state, measurement, sensors)
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
            state = self._rescaled(state, monitor_state)
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

    def _readings(
        self, state: SupervisorState, measurement: Measurement, sensors: Sensors
    ) -> Array | None:
        """Return the outputs for the diagnosis, or None if any reading is missing."""
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
        """Return the state after a change of the diagnosis to that of `monitor_state`."""
        previous, diagnosis = state.monitor_state.diagnosis, monitor_state.diagnosis
        present = state.current, state.controller
        state = replace(state, monitor_state=monitor_state)
        # The diagnosis is withdrawn unless only its kind is revised.
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
            # Otherwise the present controller continues: the diagnosis may be wrong.
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

    def _rescaled(self, state: SupervisorState, monitor_state: MonitorState) -> SupervisorState:
        """Return the state with weak actuators scaled by the largest effectiveness they may have.

        No actuator then does more than a healthy one: an estimate that is outdated, or called in
        question by an alarm, is increased before its successor is known.
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
            # The larger command may have caused the alarm: it is withdrawn without a transfer.
            controller = state.controller
        return replace(state, current=current, controller=controller)

    def _transferred(
        self,
        state: SupervisorState,
        diagnoses: Sequence[Diagnosis],
        lost_displacements: Array | None = None,
    ) -> _StatefulController:
        """Return the controller for these diagnoses, and its state after a transfer now."""
        diagnoses = [_in_use(diagnosis) for diagnosis in diagnoses]
        current = self.reconfigured(diagnoses)
        acting, keeps = np.zeros((2, self.first.mapping.actuators))
        if lost_displacements is not None:
            # A free actuator that follows the others keeps its displacement.
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
        """Return whether the expected error after a switch is acceptable."""
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
    """Return the diagnosis, with an effectiveness slightly below `WEAKEST` raised to it.

    Small revisions of an estimate then neither take an actuator out of use nor put it back.
    """
    fault = diagnosis.fault
    if fault.kind != "weak" or not WEAKEST - EFFECTIVENESS_STEP < fault.effectiveness < WEAKEST:
        return diagnosis
    return replace(diagnosis, fault=replace(fault, effectiveness=WEAKEST))
