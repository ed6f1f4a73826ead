"""Somebody else's controller in the loop: what it or a sensor does wrong is said in a sentence."""

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
from ftc.fdi.fault_model import NominalModel
from ftc.loop import Controller
from ftc.sensors import SensorCheck, Sensors

_START_LIMIT_S = 60.0
"""Of what is designed and compiled before the first step."""
_LEAST_S = 1e-3
"""Of a limit; less would come before the last one is dealt with."""

_T = TypeVar("_T")


@dataclass(frozen=True)
class ControlTask:
    """A machine and a task as a controller meets them; arrays are copied, and read-only.

    Attributes:
        nominal: The machine without failures: from the n commanded displacements to the m1 major
            coordinates, the noise of their sensors, the control period.
        J: Task velocity per actuator rate at the nominal pose, shape (m, n).
        major: Rows of the major task, m1 of the m; the others are secondary.
        goal: Secondary weights, and the failures that are known from the start.
        drives: From displacements of the actuators to the inputs that are sent, and back.
        limits: Lower and upper displacements that the drives can hold, shape (n,) each; infinite
            where there is no limit.
        reference_limit: Largest reference of each major coordinate, either way, shape (m1,).
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
        """Rows of the major task, shape (m1, n)."""
        return self.J[list(self.major)]

    @property
    def period_s(self) -> float:
        """Between control ticks."""
        return self.nominal.period_s


class _TimeExceeded(BaseException):
    """The code took too long; not an `Exception`, so that the code's own handlers let it pass."""


@dataclass(frozen=True)
class GuardedState:
    """State of a guarded controller.

    The other controller, None if its factory failed, and its `own` state, after a failure the last
    one before it; inputs (n,) last sent to the drives, zeros before the first step; what sensors
    read so far; and in a sentence what the other did wrong, None: nothing.
    """

    controller: Controller[Any] | None
    own: Any
    inputs: Array
    sensors: Sensors
    ticks: int = 0
    failure: str | None = None


@dataclass(frozen=True)
class GuardedController:
    """Controller that calls another one, and survives its failure.

    Where the other raises, returns something else than a finite input for each drive, or takes too
    long, it is not called again: the inputs stay as they were last sent, as digital-to-analog
    converters keep them, and the state says what happened. Arrays are handed over as copies.

    Nor is it called where no reading of the task is usable, by the rule of
    :class:`.SensorCheck`: its inputs and its state stay, and ticks go by that it does not see.
    Of encoders without numbers it gets the latest; whether it uses them is not known.

    Attributes:
        name: Of the other, in sentences.
        factory: Makes it for a task.
        task: That task.
        step_limit_s: How long a step may take, a millisecond or more, by the clock on the wall;
            making and starting the other may take a minute.
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
        """The other controller made and started; inputs are zero."""
        (of_task, of_encoders), n = self._checks, self.task.nominal.actuators
        sensors = Sensors(of_task.start(len(self.task.major)), of_encoders.start(n))
        try:
            controller = _call(_START_LIMIT_S, lambda: self.factory(self.task))
            own = _call(_START_LIMIT_S, lambda: controller.start())
        except _Failed as failed:
            sentence = f"{self.name} {failed}, at its start"
            return GuardedState(None, None, np.zeros(n), sensors, failure=sentence)
        return GuardedState(controller, own, np.zeros(n), sensors)

    @cached_property
    def _checks(self) -> tuple[SensorCheck, SensorCheck]:
        """Of the task, and of the encoders."""
        period_s = self.task.period_s
        return SensorCheck(period_s), SensorCheck(period_s, noisy=False)

    def step(self, state: GuardedState, reference: Array, measurement: Measurement) -> GuardedState:
        """One control tick; after a failure, or without a usable reading, the inputs stay."""
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
        given = Measurement(*(np.array(each, dtype=float) for each in readings))

        def stepped() -> tuple[Any, Array]:
            own = controller.step(state.own, reference.copy(), given)
            return own, _inputs(own, len(state.inputs))

        try:
            own, inputs = _call(self.step_limit_s, stepped)
        except _Failed as failed:
            time_s = (state.ticks - 1) * self.task.period_s
            return changed(state, failure=f"{self.name} {failed}, at {time_s:.3f} s")
        return changed(state, own=own, inputs=inputs)


class _Failed(Exception):
    """What the controller did wrong, the rest of a sentence that begins with its name."""


def _call(limit_s: float, function: Callable[[], _T]) -> _T:
    """What the function returns within a time, or `_Failed`.

    Code that takes longer is stopped as soon as Python runs again, not within compiled code; and in
    the main thread alone, the only one in which Python handles signals.
    """

    def stop(number: int, frame: FrameType | None) -> None:
        raise _TimeExceeded

    try:
        former = signal.signal(signal.SIGALRM, stop)
        # Again and again: code that catches everything may have caught the first.
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
        # The innermost line of the file that was called: below it are libraries.
        frames = traceback.extract_tb(error.__traceback__)
        called = [frame for frame in frames if frame.filename != __file__] or frames
        place = [frame for frame in called if frame.filename == called[0].filename][-1]
        said = " ".join(f"raised {type(error).__name__}: {error}".split())
        where = f"{Path(place.filename).name}, line {place.lineno}"
        raise _Failed(f"{said:.200} ({where})") from error


def _inputs(state: Any, drives: int) -> Array:
    """The inputs in a state that a controller returned, a copy of shape (n,)."""
    inputs = np.array(state.inputs)
    if inputs.dtype.kind not in "fiu":
        raise _Failed(f"returned {short_repr(state.inputs)}, expected {drives} numbers")
    if inputs.shape != (drives,):
        raise _Failed(f"returned shape {inputs.shape}, expected {(drives,)}")
    for drive, value in enumerate(inputs.tolist(), 1):
        if not np.isfinite(value):
            raise _Failed(f"returned {value} for drive {drive}")
    return inputs.astype(float)
