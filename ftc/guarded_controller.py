"""Guarded execution of a user's controller: its failures and those of sensors are reported."""

import signal
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import FrameType
from typing import Any, TypeVar

import numpy as np

import argument_checks as check
from argument_checks import Array, short_repr
from argument_checks.records import changed
from ftc.control.mapping import Goal
from ftc.controller import Converter, Measurement, checked_drives
from ftc.fdi.fault_model import NominalModel, actuator_name
from ftc.loop import Controller
from ftc.sensors import SensorCheck, Sensors

_START_LIMIT_S = 60.0
"""Time limit for making and starting a controller, compilation included [s]."""
_LEAST_S = 1e-3
"""Smallest time limit [s]: the signal of a shorter one could arrive before the last is handled."""

_T = TypeVar("_T")


@dataclass(frozen=True)
class ControlTask:
    """Machine and task for which a controller is made; arrays are copied and read-only.

    Attributes:
        nominal: Model of the machine without failures, from the n commanded displacements to the
            m1 major coordinates, with the noise of their sensors and the control period.
        J: Task velocity per actuator rate at the nominal pose, shape (m, n).
        major: Rows of the major task, m1 of the m; the others are secondary.
        goal: Secondary weights, and the failures known from the start.
        drives: Conversion between actuator displacements and drive inputs.
        limits: Lower and upper displacements that the drives can hold, shape (n,) each; infinite
            without a limit.
        reference_limit: Largest absolute reference of each major coordinate, shape (m1,).
    """

    nominal: NominalModel
    J: Array
    major: tuple[int, ...]
    goal: Goal
    drives: Converter
    limits: tuple[Array, Array]
    reference_limit: Array

    def __post_init__(self) -> None:
        n = check.instance("nominal", self.nominal, NominalModel).actuators
        J = check.frozen(check.array("J", self.J, None, n))
        major = check.indices("major", self.major, len(J))
        check.instance("goal", self.goal, Goal).of(n)
        checked_drives(self.drives, n)
        if len(major) != (outputs := self.nominal.plant.noutputs):
            raise ValueError(
                f"major must have a row for each of the {outputs} outputs of nominal, got "
                f"{len(major)}"
            )
        most = check.frozen(check.array("reference_limit", self.reference_limit, len(major)))
        limits = check.limits("limits", self.limits, n)
        vars(self).update(J=J, major=tuple(major.tolist()), limits=limits, reference_limit=most)

    @property
    def major_jacobian(self) -> Array:
        """Rows of J of the major task, shape (m1, n)."""
        return self.J[list(self.major)]

    @property
    def period_s(self) -> float:
        """Control period [s]."""
        return self.nominal.period_s


class _TimeExceeded(BaseException):
    """Signal that the code took too long; a BaseException passes the handlers of the code."""


@dataclass(frozen=True)
class GuardedState:
    """State of a guarded controller.

    Attributes:
        controller: Guarded controller; None if its factory failed.
        controller_state: State of the guarded controller; after a failure the last one before it.
        inputs: Inputs (n,) last sent to the drives; zero before the first step.
        sensors: State of the sensors.
        ticks: Number of ticks so far.
        failure: Description of the controller's failure in one sentence; None without a failure.
    """

    controller: Controller[Any] | None
    controller_state: Any
    inputs: Array
    sensors: Sensors
    ticks: int = 0
    failure: str | None = None


@dataclass(frozen=True)
class GuardedController:
    """Controller that calls another controller, such as a user's, and tolerates its failure.

    If the other controller raises, does not return a finite input for each drive, or takes too
    long, it is not called again: the inputs last sent are held, as digital-to-analog converters
    do, and the state describes the failure. Arrays are passed as copies.

    In ticks without a usable reading of the task (see :class:`.SensorCheck`) it is not called, and
    inputs and state are held. Unusable encoder readings are replaced by the last usable ones.

    Attributes:
        name: Name of the other controller in messages.
        factory: Function that makes the controller for a task.
        task: Task passed to the factory.
        step_limit_s: Largest wall-clock time of a step [s], at least a millisecond; making and
            starting the controller may take a minute.
    """

    name: str
    factory: Callable[[ControlTask], Controller[Any]]
    task: ControlTask
    step_limit_s: float = 1.0

    def __post_init__(self) -> None:
        check.instance("name", self.name, str)
        check.function("factory", self.factory)
        check.instance("task", self.task, ControlTask)
        check.number("step_limit_s", self.step_limit_s, _LEAST_S, check.DAY_S)

    def start(self) -> GuardedState:
        """Make and start the other controller; return the state with zero inputs."""
        (of_task, of_encoders), n = self._checks, self.task.nominal.actuators
        sensors = Sensors(of_task.start(len(self.task.major)), of_encoders.start(n))
        try:
            controller = _call(_START_LIMIT_S, lambda: self.factory(self.task))
            controller_state = _call(_START_LIMIT_S, lambda: controller.start())
        except _Failed as failed:
            sentence = f"{self.name} {failed}, at its start"
            return GuardedState(None, None, np.zeros(n), sensors, failure=sentence)
        return GuardedState(controller, controller_state, np.zeros(n), sensors)

    @cached_property
    def _checks(self) -> tuple[SensorCheck, SensorCheck]:
        """Checks of the task's sensor and of the encoders."""
        period_s = self.task.period_s
        return SensorCheck(period_s), SensorCheck(period_s, noisy=False)

    def step(self, state: GuardedState, reference: Array, measurement: Measurement) -> GuardedState:
        """Advance by one tick; hold the inputs after a failure or without a usable reading."""
        reference = check.array("reference", reference, len(self.task.major))
        controller = check.instance("state", state, GuardedState).controller
        state = changed(state, ticks=state.ticks + 1)
        if state.failure is not None or controller is None:
            return state
        sensors = state.sensors.after(measurement, state.inputs, *self._checks)
        state = changed(state, sensors=sensors)
        if not sensors.task.usable:
            return state
        readings = sensors.task.last, sensors.encoders.last
        copied = Measurement(*(np.array(reading, dtype=float) for reading in readings))

        def stepped() -> tuple[Any, Array]:
            controller_state = controller.step(state.controller_state, reference.copy(), copied)
            return controller_state, _inputs(controller_state, self.task.nominal)

        try:
            controller_state, inputs = _call(self.step_limit_s, stepped)
        except _Failed as failed:
            time_s = (state.ticks - 1) * self.task.period_s
            return changed(state, failure=f"{self.name} {failed}, at {time_s:.3f} s")
        return changed(state, controller_state=controller_state, inputs=inputs)


class _Failed(Exception):
    """Failure of the controller; the message continues a sentence that begins with its name."""


def _call(limit_s: float, function: Callable[[], _T]) -> _T:
    """Call a function with a time limit [s]; raise `_Failed` on an error or a timeout.

    The code is stopped when Python runs again, not within compiled code, and only in the main
    thread, which handles the signals.
    """

    def stop(number: int, frame: FrameType | None) -> None:
        raise _TimeExceeded

    try:
        former = signal.signal(signal.SIGALRM, stop)
        # Repeatedly: code that catches everything may have caught the first signal.
        signal.setitimer(signal.ITIMER_REAL, limit_s, limit_s)
        try:
            return function()
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            signal.signal(signal.SIGALRM, former)
    except _Failed:
        raise
    except _TimeExceeded:
        raise _Failed(f"took longer than {limit_s:g} s") from None
    except (Exception, SystemExit) as error:
        # The innermost line of the called file; deeper frames are libraries.
        frames = traceback.extract_tb(error.__traceback__)
        called = [frame for frame in frames if frame.filename != __file__] or frames
        place = [frame for frame in called if frame.filename == called[0].filename][-1]
        message = " ".join(f"raised {type(error).__name__}: {error}".split())
        where = f"{Path(place.filename).name}, line {place.lineno}"
        raise _Failed(f"{message:.200} ({where})") from error


def _inputs(state: Any, nominal: NominalModel) -> Array:
    """Return a copy (n,) of the inputs in a controller's state; raise `_Failed` if invalid."""
    inputs, drives = np.array(state.inputs), nominal.actuators
    if inputs.dtype.kind not in "fiu":
        raise _Failed(f"returned {short_repr(state.inputs)}, expected {drives} numbers")
    if inputs.shape != (drives,):
        raise _Failed(f"returned shape {inputs.shape}, expected {(drives,)}")
    for k, value in enumerate(inputs.tolist()):
        if not np.isfinite(value):
            raise _Failed(f"returned {value} for {actuator_name(nominal.names, k)}")
    return inputs.astype(float)
