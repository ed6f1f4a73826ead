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
        ...

    def apply(self, inputs: Array, /) -> None:
        """Send inputs (n,) to the drives and hold them for a period."""
        ...


class ControllerOutput(Protocol):
    """The part of a controller's state that a loop needs."""

    @property
    def inputs(self) -> Array:
        """Inputs to send to the drives, shape (n,)."""
        ...


State = TypeVar("State", bound=ControllerOutput)


class Controller(Protocol[State]):
    """Controller from measurements to inputs of the drives; `step` is a pure function."""

    def start(self) -> State:
        """At rest at the nominal pose."""
        ...

    def step(self, state: State, reference: Array, measurement: Measurement) -> State:
        """One control tick."""
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
        machine: The machine.
        controller: The controller.
        reference: Of the major task, tick by tick, shape (N, m1).
        feedforward: Demands that are known beforehand, shape (N, m1), for a controller whose `step`
            takes `feedforward`, as those of `ftc`; None is none.
        keeps: What to keep of each state, such as its estimate of the pose: states themselves are
            some kilobytes each. None is nothing.

    Raises:
        ValueError, TypeError: No machine, no controller; the reference is no matrix, the
            feedforward of another shape, or not finite.
    """
    check.methods("machine", machine, "measure", "apply")
    check.methods("controller", controller, "start", "step")
    if keeps is not None:
        check.function("keeps", keeps)
    reference = check.finite("reference", reference)
    if reference.ndim != 2:
        raise ValueError(f"reference must have shape (N, m1), got {reference.shape}")
    known: list[dict[str, Array]] = [{}] * len(reference)
    if feedforward is not None:
        demands = check.exactly("feedforward", feedforward, *reference.shape)
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

    Args:
        machine: The machine.
        step: Of the controller.
        state: Of it.
        reference: Of the major task, shape (m1,).
        known: What else `step` takes, such as `feedforward`.

    Returns:
        The state after it, and what was measured of the major task, as of :class:`LoopRun`.
    """
    measurement = machine.measure()
    state = step(state, reference, measurement, **known)
    machine.apply(state.inputs)
    return state, _recorded(measurement, len(reference))


def _recorded(measurement: Any, rows: int) -> Array | float:
    """The major task of a measurement; NaN where it has none of this shape."""
    output = getattr(measurement, "output", None)
    return output if isinstance(output, np.ndarray) and output.shape == (rows,) else np.nan
