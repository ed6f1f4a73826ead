"""Somebody else's controller in the loop: what it or a sensor does wrong is said in a sentence."""

import traceback
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NoReturn, TypeVar

import numpy as np

import argument_checks as check
from argument_checks import Array, shown
from ftc._records import changed
from ftc.control_task import ControlTask
from ftc.controller import Measurement
from ftc.loop import Controller
from ftc.sensor_check import SensorCheck
from ftc.sensors import SensorChecks, Sensors
from ftc.time_limit import LEAST_S, TimeExceeded, time_limit

STEP_LIMIT_S, START_LIMIT_S = 1.0, 60.0
"""By the clock on the wall: one step, and what is designed and compiled before the first."""

_T = TypeVar("_T")


class _Failed(Exception):
    """What the controller did wrong, the rest of a sentence that begins with its name."""


@dataclass(frozen=True)
class GuardedState:
    """State of a guarded controller.

    Attributes:
        controller: As its factory made it; None if that failed.
        own: Its state; after a failure the last one before it.
        inputs: What it last sent to the drives, shape (n,); zeros before the first step.
        sensors: What they read so far, and whether it was usable.
        ticks: So far.
        failure: What it did wrong, a sentence; None as long as it does nothing wrong.
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
        step_limit_s: How long a step may take, a millisecond or more; making and starting it may
            take `START_LIMIT_S`.

    Raises:
        ValueError, TypeError: Of another kind than that, or a limit longer than a day.
    """

    name: str
    factory: Callable[[ControlTask], Controller[Any]]
    task: ControlTask
    step_limit_s: float = STEP_LIMIT_S

    def __post_init__(self) -> None:
        check.instance("name", self.name, str)
        check.function("factory", self.factory)
        check.instance("task", self.task, ControlTask)
        check.duration("step_limit_s", self.step_limit_s, least=LEAST_S)

    def start(self) -> GuardedState:
        """The other controller made and started; inputs are zero."""
        n = self.task.nominal.actuators
        still, sensors = np.zeros(n), self._checks.start(len(self.task.major), n)
        try:
            controller = _call(START_LIMIT_S, lambda: self.factory(self.task))
            own = _call(START_LIMIT_S, lambda: controller.start())
        except _Failed as failed:
            sentence = f"{self.name} {failed}, at its start"
            return GuardedState(None, None, still, sensors, failure=sentence)
        return GuardedState(controller, own, still, sensors)

    @cached_property
    def _checks(self) -> SensorChecks:
        check = SensorCheck(self.task.period_s)
        return SensorChecks(check, replace(check, noisy=False))

    def step(self, state: GuardedState, reference: Array, measurement: Measurement) -> GuardedState:
        """One control tick; after a failure, or without a usable reading, the inputs stay.

        Raises:
            ValueError, TypeError: No state, or not a finite reference for each major row.
        """
        reference = check.exactly("reference", reference, len(self.task.major))
        controller = check.instance("state", state, GuardedState).controller
        if state.failure is not None or controller is None:
            return changed(state, ticks=state.ticks + 1)
        sensors = self._checks.step(state.sensors, measurement, state.inputs)
        state = changed(state, sensors=sensors, ticks=state.ticks + 1)
        if not sensors.task.usable:
            return state
        read = sensors.task.last, sensors.encoders.last
        given = Measurement(*(np.array(each, dtype=float) for each in read))

        def stepped() -> tuple[Any, Array]:
            own = controller.step(state.own, reference.copy(), given)
            return own, _inputs(own, len(state.inputs))

        try:
            own, inputs = _call(self.step_limit_s, stepped)
        except _Failed as failed:
            time_s = (state.ticks - 1) * self.task.period_s
            return changed(state, failure=f"{self.name} {failed}, at {time_s:.3f} s")
        return changed(state, own=own, inputs=inputs)


def _call(limit_s: float, function: Callable[[], _T]) -> _T:
    """What the function returns, or `_Failed`."""
    try:
        with time_limit(limit_s):
            try:
                return function()
            except _Failed:
                raise
            except (Exception, SystemExit) as error:
                _raised(error)
    except TimeExceeded:
        raise _Failed(f"took longer than {limit_s:g} s") from None


def _raised(error: BaseException) -> NoReturn:
    """The innermost line of the file that was called: below it are libraries."""
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
        raise _Failed(f"returned {shown(state.inputs)}, expected {drives} numbers")
    if inputs.shape != (drives,):
        raise _Failed(f"returned shape {inputs.shape}, expected {(drives,)}")
    for drive, value in enumerate(inputs.tolist(), 1):
        if not np.isfinite(value):
            raise _Failed(f"returned {value} for drive {drive}")
    return inputs.astype(float)
