"""The loop of a controller and a machine, tick by tick; and that with a linear plant."""

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
    """A machine as its controller meets it, once in a control period: simulated or real."""

    def measure(self) -> Any:
        """What the sensors read now, with the attributes of a :class:`Measurement`."""

    def apply(self, inputs: Array, /) -> None:
        """Send inputs (n,) to the drives and hold them for a period."""


State = TypeVar("State", bound=Any)


class Controller(Protocol[State]):
    """Controller from measurements to inputs of the drives; `step` is a pure function.

    Its states have `inputs`, those to send to the drives, shape (n,).
    """

    def start(self) -> State:
        """State at rest at the nominal pose."""
        ...

    def step(self, state: State, reference: Array, measurement: Measurement) -> State:
        """State after a control tick."""
        ...


@dataclass(frozen=True)
class LoopRun(Generic[State]):
    """What passed between a controller and a machine.

    Attributes:
        measured: Of the major task, shape (N, m1); NaN where nothing of that shape was.
        inputs: Inputs of the drives, shape (N, n).
        state: Of the controller after the last tick.
        kept: What was to be kept of its states, one of each tick.
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
    """Close the loop for as many ticks as there are references.

    At each tick: measure, one step of the controller, send its inputs. The machine decides what
    else happens, failures above all, and keeps what only it knows. What it measures may be of
    any kind, if the controller can do with it.

    Args:
        machine: Simulated or real.
        controller: Controller to run.
        reference: Of the major task, tick by tick, shape (N, m1).
        feedforward: Demands that are known beforehand, shape (N, m1), for a controller whose `step`
            takes `feedforward`, as those of `ftc`; None is none.
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
    """One tick of :func:`run_loop`, for who cannot know the references beforehand.

    `known` is what else the `step` of the controller takes beside a reference (m1,), such as
    `feedforward`.

    Returns:
        The state after it, and what was measured of the major task, as of :class:`LoopRun`.
    """
    measurement = machine.measure()
    state = step(state, reference, measurement, **arguments)
    machine.apply(state.inputs)
    output: Any = getattr(measurement, "output", None)
    is_valid = isinstance(output, np.ndarray) and output.shape == reference.shape
    return state, output if is_valid else np.nan


@dataclass(frozen=True)
class Stage:
    """The plant from one tick on, and what the mapping makes of demands from then on.

    Attributes:
        model: The plant, with the faults that it has by then.
        tick: The first.
        gain: Commands per demand, shape (n, m); None: as before, and without any the demands are
            the commands.
        carried: Which actuators go on from what was commanded, 0 or 1 each, shape (n,), as after a
            bumpless transfer; None: the new gain's commands come at once.
    """

    model: FaultModel
    tick: int = 0
    gain: Array | None = None
    bumpless: Array | None = None


class Step(NamedTuple):
    """One tick of a loop: states (..., s), outputs (..., m) and commands (..., n)."""

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
    """The loop, tick by tick, for one setting or for S settings at once.

    Args:
        stages: The plant, and what it becomes, in the order of time.
        C: Outputs per state, shape (m, s).
        compensators: One for each output.
        reference: For the outputs, shape (N, m) or (S, N, m); what a sensor adds to them is to be
            taken off it.
        secondary: Added to the commands, shape (N, n).
        disturbance: Added to the next state, shape (N, s).
        limit: Largest demand of each compensator, a number or shape (S,).
        anti_windup: Whether a compensator at its limit is held, a truth value or shape (S,).
        feedforward: Demands to which the compensators add, of the shape of `reference`.
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
