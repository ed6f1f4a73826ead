"""Supervised control: a controller that isolates failed actuators and is reconfigured."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, get_args

import numpy as np

import argument_checks as check
from argument_checks import Array
from ftc._records import changed
from ftc.controller import ControllerState, Measurement, PrioritizedController
from ftc.decision import Case, Outlook
from ftc.fdi.detection.watch import Calibration
from ftc.fdi.diagnosis import DEFAULT_CONFIG, Diagnosis, FdiConfig
from ftc.fdi.dither import Dither
from ftc.fdi.fault_model import Fault, NominalModel, static_share
from ftc.fdi.monitor import Monitor, MonitorState, monitor
from ftc.goal import Goal
from ftc.oracle import NestedState
from ftc.reconfiguration import WEAKEST, Unused, goal_after, lost_displacement, with_margin
from ftc.sensor_check import SensorCheck
from ftc.sensors import SensorChecks, Sensors, in_numbers
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
        acted: Diagnoses from which the controller in use changed.
        references: Of the major task of late, one for each sample of the diagnosis, newest first.
        feedforward: Demands beside the compensators, likewise; empty: none were given.
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
    acted: tuple[Diagnosis, ...] = ()
    references: tuple[Array, ...] = ()
    feedforward: tuple[Array, ...] = ()
    refused: Diagnosis | None = None

    @property
    def status(self) -> str:
        """What is believed, not understood and done, in one sentence."""
        return status(self, self.monitor.nominal.names)

    def __repr__(self) -> str:
        """One line, for interactive use."""
        return f"<SupervisorState after {self.ticks} ticks. {self.status}>"

    @property
    def is_learning(self) -> bool:
        """Whether what the sensors read is still taken for the machine without a failure."""
        learned_s = self.watch.watch.spectrum.samples * self.monitor.watch.period_s
        return learned_s <= self.monitor.config.learning_s

    @property
    def standing(self) -> list[Diagnosis]:
        """The last diagnosis confirmed of each actuator, and the one being confirmed.

        Without those that work again, once that is confirmed: one that comes and goes stays out.
        """
        latest, found = self.confirmed, self.watch.diagnosis
        if found is not None and found.is_acted_on:
            latest = (*latest, found)
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
        test_motion: What actuators out of use are commanded at each time, shape (n,): one that
            works again is seen by it; None is `secondary`.

    Raises:
        ValueError, TypeError: Of another kind than that, or of machines with other actuators,
            outputs or control periods.
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
    test_motion: Callable[[float], Array] | None = None

    def __repr__(self) -> str:
        """One line, for interactive use."""
        nominal = self.monitor.nominal
        names = ", ".join(nominal.names or (f"{nominal.actuators} actuators",))
        return f"<Supervisor of {names}>"

    def __post_init__(self) -> None:
        mapping = check.instance("first", self.first, PrioritizedController).mapping
        check.instance("monitor", self.monitor, Monitor)
        for name in ("secondary", "reconfigured", "is_possible"):
            check.function(name, getattr(self, name))
        for name in ("watched", "estimate", "test_motion"):
            if (function := getattr(self, name)) is not None:
                check.function(name, function)
        if self.sensor_checks is not None:
            check.instance("sensor_checks", self.sensor_checks, SensorChecks)
        models = {"monitor": self._nominal}
        if self.task is not None:
            models["task"] = check.instance("task", self.task, NominalModel)
        for name, model in models.items():
            if model.actuators != mapping.actuators or model.period_s != self.first.period_s:
                raise ValueError(
                    f"{name} must be of the {mapping.actuators} actuators and the period of first, "
                    f"{self.first.period_s} s, got {model.actuators} and {model.period_s} s"
                )

    @property
    def _test_motion(self) -> Callable[[float], Array]:
        return self.secondary if self.test_motion is None else self.test_motion

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

    def calibrated(self, state: SupervisorState) -> "Supervisor":
        """The supervisor that begins with what another run has learned of the same machine.

        It need not take its first samples for those of a sound machine.

        Raises:
            ValueError, TypeError: That run had a failure, or ended before anything was learned; or
                it was not a supervisor's.
        """
        watch = check.instance("state", state, SupervisorState).watch.watch
        if state.diagnoses or state.watch.relearns or state.is_learning:
            raise ValueError(
                "state must be of a run without a failure, longer than "
                f"{self.monitor.config.learning_s:g} s, got: {state.status}"
            )
        known = Calibration(watch.parameters, watch.spectrum)
        return replace(self, monitor=replace(self.monitor, calibration=known))

    def transfer(self, state: "SupervisorState | ControllerState[Any]") -> SupervisorState:
        """The state of another pilot of the machine, so that this one continues without a step.

        What a supervisor believes stays, though its goal was another one. A controller alone
        believes nothing: the diagnosis then begins to learn what the machine is like.

        Raises:
            TypeError: No state of either.
        """
        if isinstance(state, SupervisorState):
            current, controller = self._transferred(state, state.standing)
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
        are, unless the encoders give an estimate; the diagnosis goes on without what is missing.
        A measurement may be of any kind: what is no numbers is missing, and so is what is masked.

        Raises:
            ValueError, TypeError: No state, or a reference or feedforward that is not finite, or of
                another shape.
        """
        rows = len(self._unknown)
        check.instance("state", state, SupervisorState)
        reference = check.exactly("reference", reference, rows)
        if feedforward is not None:
            feedforward = check.exactly("feedforward", feedforward, rows)
        measurement = in_numbers(measurement, rows, self.first.mapping.actuators)
        ticks = state.ticks + 1
        commanded = self.first.drives.displacements(state.inputs)
        known = state.watch.diagnosis
        estimable = self.estimate is not None
        sensors = self._checks.step(state.sensors, measurement, state.inputs, estimable=estimable)
        measured = self._seen(state, measurement, sensors)
        watch = state.monitor.step(state.watch, measured, commanded)
        if state.ticks % state.monitor.ticks == 0:
            state = changed(state, references=(reference, *state.references[: self._ahead]))
            if feedforward is not None:
                demands = (feedforward, *state.feedforward[: self._ahead])
                state = changed(state, feedforward=demands)
        if watch.diagnosis is not known:
            state = replace(state, watch=watch)
            if known is not None and _is_taken_back(known, watch.diagnosis):
                state = replace(state, withdrawn=(*state.withdrawn, (known, state.ticks)))
            state = self._reconfigured(state, known, commanded, measurement)
            watch = state.watch
        elif state.ticks % state.monitor.ticks == 0 and state.current.mapping.goal.effectiveness:
            state = self._followed(state, watch)
        if not (sensors.task.usable or sensors.estimates):
            return changed(state, watch=watch, sensors=sensors, ticks=ticks)
        if self.estimate is not None and sensors.estimates:
            estimated = self.estimate(measurement, state.pose)
            measurement = Measurement(estimated, measurement.displacement)
        controller = state.current.step(
            state.controller,
            reference,
            measurement,
            self.secondary(state.ticks * self.first.period_s),
            feedforward=feedforward,
            unused_reference=self._test_motion(state.ticks * self.first.period_s),
        )
        return changed(state, watch=watch, sensors=sensors, controller=controller, ticks=ticks)

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
        if known is not None and known.is_acted_on and _is_taken_back(known, found):
            sure = [each for each in state.standing if each.confirmed]
            stays = self._transferred(state, sure)
            state = replace(state, task_lost=state.task_lost and not self._can(sure))
        goes, refused = stays, None
        if found is not None:
            state = replace(state, diagnoses=(*state.diagnoses, found))
        if found is not None and found.is_acted_on:
            believed = state.standing
            faults, can = [each.fault for each in believed], self._can(believed)
            # The present controller goes on then: to stand still is worse, and names may be wrong.
            state = replace(state, task_lost=found.confirmed and not can)
            if can:
                lost = lost_displacement(self._nominal, found, faults, commanded)
                goes = self._transferred(state, believed, lost)
                if self._pays(state, found, stays, goes, measurement):
                    state = replace(state, acted=(*state.acted, found))
                else:
                    goes, refused = stays, found
        current, controller = goes
        state = replace(state, current=current, controller=controller, refused=refused)
        if found is None or not found.confirmed:
            return state
        state = replace(state, confirmed=(*state.confirmed, found))
        monitor, watch = state.monitor.believing(state.watch)
        return replace(state, monitor=monitor, watch=watch)

    def _followed(self, state: SupervisorState, watch: MonitorState) -> SupervisorState:
        """State in which weak actuators are driven by the inverse of the most that they may have.

        So that none ever does more than a sound one: what evidence is older than, or an alarm calls
        in question, is given up before anything else is known.
        """
        strongest, confirmed = dict(state.monitor.watch.strongest(watch.watch)), []
        driven = state.current.mapping.goal.effectiveness
        known = {each.actuator: each.effectiveness for each in state.monitor.watch.weak}
        for each in state.confirmed:
            fault, k = each.fault, each.fault.actuator
            if k in driven and k in known and fault.kind == "weak" and not fault.is_sound:
                most = min(max(strongest[k], known[k]), _NEARLY_ALL)
                if abs(most - fault.effectiveness) > self.monitor.config.effectiveness_step:
                    each = replace(each, fault=replace(fault, effectiveness=most))
            confirmed.append(each)
        if tuple(confirmed) == state.confirmed:
            return state
        state = replace(state, confirmed=tuple(confirmed))
        current, controller = self._transferred(state, state.standing)
        if watch.evidence is not None or watch.alarm_ticks != state.watch.alarm_ticks:
            # What moved may be what was commanded more: that is taken back at once.
            controller = state.controller
        return replace(state, current=current, controller=controller)

    def _can(self, believed: Sequence[Diagnosis]) -> bool:
        return self.is_possible([each.fault for each in believed])

    def _transferred(
        self,
        state: SupervisorState,
        believed: Sequence[Diagnosis],
        lost_displacements: Array | None = None,
    ) -> tuple[PrioritizedController[Any], ControllerState[Any]]:
        """The controller for these diagnoses, and its state if it took over now."""
        step = self.monitor.config.effectiveness_step
        believed = [_in_use(each, step) for each in believed]
        current, n = self.reconfigured(believed), self._nominal.actuators
        acting, keeps = np.zeros(n), np.zeros(n)
        if lost_displacements is not None:
            # One that the others carry loses nothing when its force is gone.
            lost_displacements[list(current.mapping.goal.free)] = 0.0
        for each in believed:
            acting[each.fault.actuator] = static_share(self._nominal, each.fault)
            keeps[each.fault.actuator] = each.fault.kind == "locked"
        owed = lost_displacements, acting, keeps
        test = self._test_motion(state.ticks * self.first.period_s)
        return current, current.transfer(state.controller, *owed, unused_reference=test)

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

        def ahead(motion: Callable[[float], Array]) -> Callable[[int], Array]:
            return lambda tick: motion((state.ticks + tick) * self.first.period_s)

        outlook = Outlook(
            monitor.nominal if self.task is None else self.task,
            measurement.output,
            np.repeat(state.references, monitor.ticks, axis=0),
            ahead(self.secondary),
            ahead(self._test_motion),
            np.repeat(state.feedforward, monitor.ticks, axis=0) if state.feedforward else None,
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


_NEARLY_ALL = 0.999
"""Of its force: what a weak actuator that may be sound by now counts as."""

_AHEAD_S = 1.0
"""So far ahead errors are predicted for a decision; what was asked of late is taken backwards."""


def _in_use(found: Diagnosis, step: float) -> Diagnosis:
    """The diagnosis; of one too weak to be used by less than its estimate may be off, as if used.

    Nothing is taken out of use, nor given back, because an estimate is revised a little.
    """
    fault = found.fault
    if fault.kind != "weak" or not WEAKEST - step < fault.effectiveness < WEAKEST:
        return found
    return replace(found, fault=replace(fault, effectiveness=WEAKEST))


def _is_taken_back(known: Diagnosis, now: Diagnosis | None) -> bool:
    """Whether another actuator, or none, is named now; another kind is a revision."""
    return now is None or now.fault.actuator != known.fault.actuator


TEST_PART = 0.25
"""An actuator out of use is given this part of the dither: if it works, the task feels it, because
the others do not know, and a diagnosis sees it; the sound ones' cancels out."""


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

    Raises:
        ValueError, TypeError: Of another kind than that, or a dither of other actuators.
    """
    check.function("controller", controller)
    check.function("is_possible", is_possible)
    check.choice("unused", unused, get_args(Unused))
    check.instance("watched", watched, NominalModel)
    check.instance("config", config, FdiConfig)
    motion = test_motion = partial(_at_rest, watched.actuators)
    if dither is not None:
        if len(check.instance("dither", dither, Dither).direction) != watched.actuators:
            raise ValueError(
                f"dither must have a direction of {watched.actuators} actuators, got "
                f"{len(dither.direction)}"
            )
        config = replace(config, dither_hz=dither.frequency_hz)
        motion = dither.at
        test_motion = replace(dither, amplitude=TEST_PART * dither.amplitude, offset=0.0).at
    return Supervisor(
        first=controller(goal),
        monitor=monitor(watched, config=config),
        secondary=motion,
        test_motion=test_motion,
        reconfigured=partial(_reconfigured, controller, goal, watched, unused),
        is_possible=is_possible,
        task=task,
        watched=seen,
        **sensors,
    )


def _at_rest(actuators: int, _: float) -> Array:
    """No secondary motion."""
    return np.zeros(actuators)


def _reconfigured(
    controller: Callable[[Goal], PrioritizedController[Any]],
    goal: Goal,
    watched: NominalModel,
    unused: Unused,
    found: Sequence[Diagnosis],
) -> PrioritizedController[Any]:
    """The controller that knows of these failures; a closure could not be pickled."""
    return controller(with_margin(goal_after(goal, found, watched, unused), goal))
