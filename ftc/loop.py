"""The loop: a controller and a machine, tick by tick."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from inspect import signature
from typing import Any, Generic, Protocol, TypeVar

import numpy as np

import argument_checks as check
from argument_checks import Array
from ftc.controller import Measurement


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
    kept: Sequence[Any] = ()


def run_loop(
    machine: Machine,
    controller: Controller[State],
    reference: Array,
    feedforward: Array | None = None,
    *,
    keeps: Callable[[State], Any] | None = None,
) -> LoopRun[State]:
    """Close the loop for as many ticks as there are references.

    At each tick: measure, one step of the controller, send its inputs. The machine decides what
    else happens, failures above all, and keeps what only it knows. What it measures may be of
    any kind, if the controller can do with it.

    Args:
        machine: Simulated or real.
        controller: That of :class:`Controller`.
        reference: Of the major task, tick by tick, shape (N, m1).
        feedforward: Demands that are known beforehand, shape (N, m1), for a controller whose `step`
            takes `feedforward`, as those of `ftc`; None is none.
        keeps: What to keep of each state, such as its estimate of the pose: states themselves are
            some kilobytes each. None is nothing.
    """
    check.attributes("machine", machine, "measure", "apply")
    check.attributes("controller", controller, "start", "step")
    if keeps is not None:
        check.function("keeps", keeps)
    reference = check.array("reference", reference)
    if reference.ndim != 2:
        raise ValueError(f"reference must have shape (N, m1), got {reference.shape}")
    known: list[dict[str, Array]] = [{}] * len(reference)
    if feedforward is not None:
        demands = check.array("feedforward", feedforward, *reference.shape)
        if "feedforward" in signature(controller.step).parameters:
            known = [{"feedforward": each} for each in demands]
    step: Any = controller.step
    state: State = controller.start()
    measured = np.empty(reference.shape)
    inputs = np.empty((len(reference), len(state.inputs)))
    kept: list[Any] = []
    for tick in range(len(reference)):
        state, measured[tick] = one_tick(machine, step, state, reference[tick], **known[tick])
        inputs[tick] = state.inputs
        if keeps is not None:
            kept.append(keeps(state))
    return LoopRun(measured, inputs, state, kept)


def one_tick(
    machine: Machine, step: Callable[..., State], state: State, reference: Array, **known: Array
) -> tuple[State, Array | float]:
    """One tick of :func:`run_loop`, for who cannot know the references beforehand.

    `known` is what else the `step` of the controller takes beside a reference (m1,), such as
    `feedforward`.

    Returns:
        The state after it, and what was measured of the major task, as of :class:`LoopRun`.
    """
    measurement = machine.measure()
    state = step(state, reference, measurement, **known)
    machine.apply(state.inputs)
    output: Any = getattr(measurement, "output", None)
    is_right = isinstance(output, np.ndarray) and output.shape == reference.shape
    return state, output if is_right else np.nan
