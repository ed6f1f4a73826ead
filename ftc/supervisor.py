"""Supervised control: a controller that isolates failed actuators and is reconfigured."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np

from argument_checks import Array
from ftc.controller import ControllerState, Measurement, PrioritizedController
from ftc.decision import Case, Outlook
from ftc.fdi.diagnosis import DEFAULT_CONFIG, Diagnosis, FdiConfig
from ftc.fdi.dither import Dither
from ftc.fdi.fault_model import Fault, NominalModel, resting_displacements, static_share
from ftc.fdi.monitor import Monitor, MonitorState, monitor
from ftc.goal import Goal
from ftc.oracle import NestedState
from ftc.sensor_check import SensorCheck
from ftc.sensors import SensorChecks, Sensors
from ftc.status import status


@dataclass(frozen=True)
class SupervisorState(NestedState):
    """State of the supervisor.

    Attributes:
        current: The controller in use; `controller` is its state.
        watch: State of the monitor.
        monitor: That monitor.
        sensors: What they read so far, and whether it was usable.
        confirmed: The confirmed diagnoses.
        diagnoses: All that were made, revised and withdrawn ones included, in order.
        task_lost: Whether the actuators that are left by confirmed diagnoses cannot do the major
            task; the controller then goes on as it was, with what it still reaches.
        ticks: So far.
        withdrawn: Diagnoses that were taken back, and when.
        references: Of the major task of late, one for each sample of the diagnosis, newest first.
        refused: The last diagnosis that was not acted on: doing nothing was expected to cost less.
    """

    current: PrioritizedController[Any]
    watch: MonitorState
    monitor: Monitor
    sensors: Sensors
    confirmed: tuple[Diagnosis, ...] = ()
    diagnoses: tuple[Diagnosis, ...] = ()
    task_lost: bool = False
    ticks: int = 0
    withdrawn: tuple[tuple[Diagnosis, int], ...] = ()
    references: tuple[Array, ...] = ()
    refused: Diagnosis | None = None

    @property
    def status(self) -> str:
        """What is believed, not understood and done, in one sentence."""
        return status(self)

    @property
    def standing(self) -> list[Diagnosis]:
        """The last diagnosis confirmed of each actuator, and the one being confirmed.

        Without those that work again.
        """
        latest = self.confirmed
        if self.watch.diagnosis is not None:
            latest = (*latest, self.watch.diagnosis)
        last = {each.fault.actuator: each for each in latest}
        return [each for each in last.values() if not each.fault.is_sound]


@dataclass(frozen=True)
class Supervisor:
    """Controller with diagnosis of actuator failures.

    Attributes:
        first: Controller of the sound machine.
        monitor: Of the sound machine.
        secondary: Reference of the secondary goal (n,) at each time of the run.
        reconfigured: Controller that knows of these failures.
        is_possible: Whether the major task can still be done in spite of them.
        task: Linear model of the sound machine to the major task; None: the monitor's model, whose
            first outputs it is.
        watched: What the diagnosis looks at, where the controller estimates the pose and has found
            these faults; None: the major task, then the displacements, as many as the monitor's
            model has outputs.
        estimate: The major task (m1,) by the encoders alone, near an estimated pose, for a time
            when its own sensor is lost; None: the commands are held.
        sensor_checks: When readings are usable; None is :class:`.SensorCheck` as it is, of the task
            and of the encoders where they are used.
    """

    first: PrioritizedController[Any]
    monitor: Monitor
    secondary: Callable[[float], Array]
    reconfigured: Callable[[Sequence[Diagnosis]], PrioritizedController[Any]]
    is_possible: Callable[[Sequence[Fault]], bool]
    task: NominalModel | None = None
    watched: Callable[[Measurement, Any, tuple[Fault, ...]], Array] | None = None
    estimate: Callable[[Measurement, Any], Array] | None = None
    sensor_checks: SensorChecks | None = None

    @cached_property
    def _checks(self) -> SensorChecks:
        if self.sensor_checks is not None:
            return self.sensor_checks
        check = SensorCheck(self.first.period_s)
        used = self.watched or self.estimate or self._outputs > len(self._unknown)
        return SensorChecks(check, check if used else None)

    @cached_property
    def _unknown(self) -> Array:
        return np.full_like(self.first.mapping.nothing().demand, np.nan)

    @property
    def _nominal(self) -> NominalModel:
        return self.monitor.nominal

    @cached_property
    def _outputs(self) -> int:
        return len(self.monitor.nominal.noise)

    def start(self) -> SupervisorState:
        """State at rest at the nominal pose, without known failures."""
        sensors = self._checks.start(len(self._unknown), self.first.mapping.actuators)
        watch = self.monitor.start()
        return SupervisorState(self.first.start(), self.first, watch, self.monitor, sensors)

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
        are, unless the encoders give an estimate; the diagnosis goes on without what is missing.
        """
        ticks = state.ticks + 1
        commanded = self.first.drives.displacements(state.inputs)
        known = state.watch.diagnosis
        estimable = self.estimate is not None
        sensors = self._checks.step(state.sensors, measurement, state.inputs, estimable=estimable)
        measured = self._seen(state, measurement, sensors)
        watch = state.monitor.step(state.watch, measured, commanded)
        if state.ticks % state.monitor.ticks == 0:
            state = replace(state, references=(reference, *state.references[: self._ahead]))
        if watch.diagnosis is not known:
            state = replace(state, watch=watch)
            if known is not None and _is_taken_back(known, watch.diagnosis):
                state = replace(state, withdrawn=(*state.withdrawn, (known, state.ticks)))
            state = self._reconfigured(state, known, commanded, measurement)
            watch = state.watch
        if not (sensors.task.usable or sensors.estimates):
            return replace(state, watch=watch, sensors=sensors, ticks=ticks)
        if self.estimate is not None and sensors.estimates:
            estimated = self.estimate(measurement, state.pose)
            measurement = Measurement(estimated, measurement.displacement)
        secondary_reference = self.secondary(state.ticks * self.first.period_s)
        controller = state.current.step(
            state.controller, reference, measurement, secondary_reference, feedforward=feedforward
        )
        return replace(state, watch=watch, sensors=sensors, controller=controller, ticks=ticks)

    def _seen(
        self, state: SupervisorState, measurement: Measurement, sensors: Sensors
    ) -> Array | None:
        """What the diagnosis looks at; None where any of it is missing."""
        new = sensors.task.new
        if not sensors.encoders.new or not (new or self.watched):
            return None
        if self.watched is None:
            if self._outputs <= len(measurement.output):
                return measurement.output[: self._outputs]
            measured = np.concatenate([measurement.output, measurement.displacement])
            return measured[: self._outputs]
        faults = tuple(each.fault for each in state.standing)
        if new:
            return self.watched(measurement, state.pose, faults)
        alone = Measurement(self._unknown, measurement.displacement)
        measured = self.watched(alone, state.pose, faults)
        return measured if np.isfinite(measured).all() else None

    def _reconfigured(
        self,
        state: SupervisorState,
        known: Diagnosis | None,
        commanded: Array,
        measurement: Measurement,
    ) -> SupervisorState:
        """State after a change of the diagnosis from `known`; compensators unchanged."""
        found, stays = state.watch.diagnosis, (state.current, state.controller)
        if known is not None and _is_taken_back(known, found):  # to do nothing is to forget it
            sure = [each for each in state.standing if each.confirmed]
            stays = self._transferred(state, sure, keeps=False)
            state = replace(state, task_lost=state.task_lost and not self._can(sure))
        goes, refused = stays, None
        if found is not None:
            state = replace(state, diagnoses=(*state.diagnoses, found))
            believed = state.standing
            faults, can = [each.fault for each in believed], self._can(believed)
            # The present controller goes on then: to stand still is worse, and names may be wrong.
            state = replace(state, task_lost=found.confirmed and not can)
            if can:
                lost = lost_displacement(self._nominal, found, faults, commanded)
                goes = self._transferred(state, believed, lost, keeps=not found.confirmed)
                if not self._pays(state, found, stays, goes, measurement):
                    goes, refused = stays, found
        current, controller = goes
        state = replace(state, current=current, controller=controller, refused=refused)
        if found is None or not found.confirmed:
            return state
        state = replace(state, confirmed=(*state.confirmed, found))
        monitor, watch = state.monitor.believing(state.watch)
        return replace(state, monitor=monitor, watch=watch)

    def _can(self, believed: Sequence[Diagnosis]) -> bool:
        return self.is_possible([each.fault for each in believed])

    def _transferred(
        self,
        state: SupervisorState,
        believed: Sequence[Diagnosis],
        lost_displacements: Array | None = None,
        *,
        keeps: bool,
    ) -> tuple[PrioritizedController[Any], ControllerState[Any]]:
        """The controller for these diagnoses, and its state if it took over now."""
        current, acting = self.reconfigured(believed), np.zeros(self._nominal.actuators)
        if lost_displacements is not None:
            # One that the others carry loses nothing when its force is gone.
            lost_displacements[list(current.mapping.goal.free)] = 0.0
        for each in believed:
            acting[each.fault.actuator] = static_share(self._nominal, each.fault)
        asked = self.secondary(state.ticks * self.first.period_s)
        how = {"keeps": keeps, "secondary_reference": asked}
        return current, current.transfer(state.controller, lost_displacements, acting, **how)

    def _pays(
        self,
        state: SupervisorState,
        found: Diagnosis,
        stays: tuple[PrioritizedController[Any], ControllerState[Any]],
        goes: tuple[PrioritizedController[Any], ControllerState[Any]],
        measurement: Measurement,
    ) -> bool:
        """Whether to go over is not expected to cost much more than to stay."""
        verdict, monitor = state.watch.verdict, state.monitor
        if verdict is None or not np.isfinite(measurement.output).all():
            return True
        outlook = Outlook(
            monitor.nominal if self.task is None else self.task,
            measurement.output,
            np.repeat(state.references, monitor.ticks, axis=0),
            lambda tick: self.secondary((state.ticks + tick) * self.first.period_s),
        )
        named = [each.fault for each in state.standing]
        certain = found.actuator_confidence
        cases = [
            Case(certain, named, verdict.x),
            Case(1 - certain, monitor.faults, state.watch.watch.X[0]),
        ]
        return outlook.goes_over(stays, goes, cases)

    @property
    def _ahead(self) -> int:
        """Samples of the diagnosis by which the costs of a decision are compared."""
        return round(_AHEAD_S / (self.monitor.ticks * self.first.period_s))


_AHEAD_S = 0.5
"""So far ahead errors are predicted for a decision; what was asked of late is taken backwards."""


def _is_taken_back(known: Diagnosis, now: Diagnosis | None) -> bool:
    """Whether another actuator, or none, is named now; another kind is a revision."""
    return now is None or now.fault.actuator != known.fault.actuator


WEAKEST = 0.5
"""An actuator whose commands move it less than this part of what they did is not used. Commanded
seven times as much because of a wrong diagnosis, a sound strut would make the loop unstable:
docs/recover.md."""


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
    """
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


def supervisor_for(
    goal: Goal,
    controller: Callable[[Goal], PrioritizedController[Any]],
    watched: NominalModel,
    is_possible: Callable[[Sequence[Fault]], bool],
    task: NominalModel,
    *,
    unused: Unused,
    dither: Dither | None = None,
    config: FdiConfig = DEFAULT_CONFIG,
    seen: Callable[[Measurement, Any, tuple[Fault, ...]], Array] | None = None,
    **sensors: Any,
) -> Supervisor:
    """A controller that diagnoses failures and is reconfigured, of any mechanism.

    Args:
        goal: While all actuators work.
        controller: For a goal, failures that it knows included.
        watched: Linear model of the sound machine to what the diagnosis looks at.
        is_possible: Whether the major task can still be done in spite of these faults.
        task: Linear model of the sound machine to the major task.
        unused: As of :func:`goal_after`.
        dither: Secondary motion by which failures are told apart; None is none.
        config: Rates and confidences of the diagnosis.
        seen: `watched` of :class:`Supervisor`.
        sensors: Its `estimate` and `sensor_checks`.
    """
    still = np.zeros(watched.actuators)
    if dither is not None:
        config = replace(config, dither_hz=dither.frequency_hz)
    return Supervisor(
        first=controller(goal),
        monitor=monitor(watched, config=config),
        secondary=(lambda _: still) if dither is None else dither.at,
        reconfigured=lambda found: controller(goal_after(goal, found, watched, unused)),
        is_possible=is_possible,
        task=task,
        watched=seen,
        **sensors,
    )
