"""Closed loops of a controller with a machine, and with a linear plant, tick by tick."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from inspect import signature
from typing import Any, Generic, NamedTuple, Protocol, TypeVar

import numpy as np

import argument_checks as check
from argument_checks import Array
from ftc.control.anti_windup import Compensators
from ftc.control.compensator import Channel
from ftc.controller import Measurement
from ftc.fdi.fault_model import FaultModel


class Machine(Protocol):
    """Protocol of a simulated or real machine, used once in each control period."""

    def measure(self) -> Any:
        """Return the present readings, with the attributes of a :class:`Measurement`."""

    def apply(self, inputs: Array, /) -> None:
        """Send inputs (n,) to the drives and hold them for a period."""


State = TypeVar("State", bound=Any)


class Controller(Protocol[State]):
    """Protocol of a controller from measurements to drive inputs; `step` is a pure function.

    Its states have the `inputs` to send to the drives, shape (n,).
    """

    def start(self) -> State:
        """Return the state at rest at the nominal pose."""
        ...

    def step(self, state: State, reference: Array, measurement: Measurement) -> State:
        """Return the state after a control tick."""
        ...


@dataclass(frozen=True)
class LoopRun(Generic[State]):
    """Signals between a controller and a machine in one run.

    Attributes:
        measured: Measured major task, shape (N, m1); NaN in ticks without a reading of this shape.
        inputs: Drive inputs, shape (N, n).
        state: State of the controller after the last tick.
        logged: Result of the `log` function for the state of each tick.
    """

    measured: Array
    inputs: Array
    state: State
    logged: Sequence[Any] = ()


def run_loop(
    machine: Machine,
    controller: Controller[State],
    reference: Array,
    feedforward: Array | None = None,
    *,
    log: Callable[[State], Any] | None = None,
) -> LoopRun[State]:
    """Run a controller with a machine, one tick for each reference.

    Each tick measures, steps the controller and sends its inputs. Failures and other events are
    part of the machine. Its measurements may be of any type that the controller accepts.

    Args:
        machine: Simulated or real machine.
        controller: Controller to run.
        reference: Reference of the major task, tick by tick, shape (N, m1).
        feedforward: Demands that are known in advance, shape (N, m1), for a controller whose `step`
            accepts `feedforward`, such as those of `ftc`; None is zero.
        log: Function that returns what to log of each state, such as its estimate of the pose (a
            whole state has some kilobytes); None logs nothing.
    """
    check.attributes("machine", machine, "measure", "apply")
    check.attributes("controller", controller, "start", "step")
    if log is not None:
        check.function("log", log)
    reference = check.array("reference", reference)
    if reference.ndim != 2:
        raise ValueError(f"reference must have shape (N, m1), got {reference.shape}")
    arguments: list[dict[str, Array]] = [{}] * len(reference)
    if feedforward is not None:
        demands = check.array("feedforward", feedforward, *reference.shape)
        if "feedforward" in signature(controller.step).parameters:
            arguments = [{"feedforward": row} for row in demands]
    step: Any = controller.step
    state: State = controller.start()
    measured = np.empty(reference.shape)
    inputs = np.empty((len(reference), len(state.inputs)))
    logged: list[Any] = []
    for tick in range(len(reference)):
        state, measured[tick] = one_tick(machine, step, state, reference[tick], **arguments[tick])
        inputs[tick] = state.inputs
        if log is not None:
            logged.append(log(state))
    return LoopRun(measured, inputs, state, logged)


def one_tick(
    machine: Machine, step: Callable[..., State], state: State, reference: Array, **arguments: Array
) -> tuple[State, Array | float]:
    """Run one tick of :func:`run_loop`, for references that are not known in advance.

    `arguments` are further keyword arguments of the controller's `step`, such as `feedforward`.

    Returns:
        State after the tick, and the measured major task (m1,); NaN without a usable reading.
    """
    measurement = machine.measure()
    state = step(state, reference, measurement, **arguments)
    machine.apply(state.inputs)
    output: Any = getattr(measurement, "output", None)
    is_valid = isinstance(output, np.ndarray) and output.shape == reference.shape
    return state, output if is_valid else np.nan


@dataclass(frozen=True)
class Stage:
    """Plant and mapping of a linear loop from one tick on.

    Attributes:
        model: Plant with the faults present from `tick` on.
        tick: First tick of the stage.
        gain: Commands per demand, shape (n, m); None keeps the previous gain (at first: commands
            are the demands).
        bumpless: 1 for actuators whose commands continue without a step, else 0, shape (n,); None:
            the commands of the new gain apply at once.
    """

    model: FaultModel
    tick: int = 0
    gain: Array | None = None
    bumpless: Array | None = None


class Step(NamedTuple):
    """States (..., s), outputs (..., m) and commands (..., n) of a loop at one tick."""

    x: Array
    output: Array
    commanded: Array


def steps(
    stages: Sequence[Stage],
    C: Array,
    compensators: Sequence[Channel],
    reference: Array,
    *,
    secondary: Array | None = None,
    disturbance: Array | None = None,
    limit: Array | float = np.inf,
    anti_windup: Array | bool = False,
    feedforward: Array | None = None,
    start: Array | None = None,
) -> Iterator[Step]:
    """Simulate a linear loop tick by tick, for one setting or for S settings at once.

    Args:
        stages: Stages of the plant in order of time.
        C: Outputs per state, shape (m, s).
        compensators: One compensator for each output.
        reference: Reference of the outputs minus the sensor noise, shape (N, m) or (S, N, m).
        secondary: Displacements added to the commands, shape (N, n).
        disturbance: Vector added to the next state, shape (N, s).
        limit: Largest demand of each compensator, a number or shape (S,).
        anti_windup: Whether a compensator at its limit is held, a truth value or shape (S,).
        feedforward: Demands added to those of the compensators, of the shape of `reference`.
        start: First state of the plant, shape (..., s); None is rest.
    """
    lead, to_come, stage = reference.shape[:-2], list(stages), stages[0]
    most, holds = np.asarray(limit)[..., None], np.asarray(anti_windup)[..., None]
    stacked = Compensators(compensators)
    x = np.zeros((*lead, len(stage.model.A))) if start is None else start
    states, demanded = np.zeros((*lead, stacked.order)), np.zeros((*lead, len(compensators)))
    commanded, offset, gain = demanded, np.zeros(1), None
    for tick in range(reference.shape[-2]):
        while to_come and to_come[0].tick <= tick:
            stage = to_come.pop(0)
            x = x @ stage.model.onset.T
            gain = gain if stage.gain is None else stage.gain
            if stage.bumpless is not None and gain is not None:
                offset = stage.bumpless * (commanded - demanded @ gain.T)
        output = x @ C.T
        states, demanded = stacked.limited(states, reference[..., tick, :] - output, most, holds)
        if feedforward is not None:
            demanded = feedforward[..., tick, :] + demanded
        commanded = demanded if gain is None else demanded @ gain.T + offset
        if secondary is not None:
            commanded = commanded + secondary[tick]
        yield Step(x, output, commanded)
        x = stage.model.step(x.T, commanded.T).T
        if disturbance is not None:
            x = x + disturbance[tick]
