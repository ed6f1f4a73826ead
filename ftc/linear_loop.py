"""Sampled closed loops with a linear plant that may change in the run, for predictions."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from argument_checks import Array
from ftc.control.anti_windup import Compensators
from ftc.control.compensator import Channel
from ftc.fdi.fault_model import FaultModel


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
    carried: Array | None = None


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
    own = Compensators(compensators)
    x = np.zeros((*lead, len(stage.model.A))) if start is None else start
    states, demanded = np.zeros((*lead, own.order)), np.zeros((*lead, len(compensators)))
    commanded, standing, gain = demanded, np.zeros(1), None
    for tick in range(reference.shape[-2]):
        while to_come and to_come[0].tick <= tick:
            stage = to_come.pop(0)
            x = x @ stage.model.onset.T
            gain = gain if stage.gain is None else stage.gain
            if stage.carried is not None and gain is not None:
                standing = stage.carried * (commanded - demanded @ gain.T)
        output = x @ C.T
        states, demanded = own.limited(states, reference[..., tick, :] - output, most, holds)
        if feedforward is not None:
            demanded = feedforward[..., tick, :] + demanded
        commanded = demanded if gain is None else demanded @ gain.T + standing
        if secondary is not None:
            commanded = commanded + secondary[tick]
        yield Step(x, output, commanded)
        x = stage.model.step(x.T, commanded.T).T
        if disturbance is not None:
            x = x + disturbance[tick]
