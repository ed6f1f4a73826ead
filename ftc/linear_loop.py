"""Sampled closed loops with a linear plant, for predictions, stepped tick by tick.

The loop may saturate, and its plant may change in the run: :func:`steps`.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

import argument_checks as check
from argument_checks import Array
from ftc.control.compensator import Channel
from ftc.control.frequency_response import channels
from ftc.fdi.fault_model import Fault, NominalModel, fault_model
from ftc.fdi.friction import Rubbing


@dataclass(frozen=True)
class Stage:
    """The plant from one tick on: x' = A x + B u + drift, u the displacements commanded.

    Attributes:
        A: Shape (s, s).
        B: Shape (s, n).
        tick: The first.
        onset: The state just after the change per state just before, shape (s, s); None: the same.
        gain: Commands per demand from then on, shape (n, m); None: as before.
        carried: Which actuators go on from what was commanded, 0 or 1 each, shape (n,), as after a
            bumpless transfer; None: the new gain's commands come at once.
        drift: Shape (s,), as of :class:`ftc.fdi.fault_model.FaultModel`; None is none.
        rubbing: Likewise.
    """

    A: Array
    B: Array
    tick: int = 0
    onset: Array | None = None
    gain: Array | None = None
    carried: Array | None = None
    drift: Array | None = None
    rubbing: Rubbing | None = None


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
    gain: Array | None = None,
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
        gain: Commands per demand, shape (n, m), until a stage has another; None: the demands are
            the commands.
        secondary: Added to the commands, shape (N, n).
        disturbance: Added to the next state, shape (N, s).
        limit: Largest demand of each compensator, a number or shape (S,).
        anti_windup: Whether a compensator at its limit keeps its state while the error would drive
            it further, as in :class:`ftc.PrioritizedController`; a truth value or shape
            (S,).
        feedforward: Demands to which the compensators add, shape (N, m) or (S, N, m); None is none.
        start: First state of the plant, shape (..., s); None is rest.
    """
    lead, to_come, stage = reference.shape[:-2], list(stages), stages[0]
    most, held = np.asarray(limit)[..., None], np.asarray(anti_windup)[..., None]
    x = np.zeros((*lead, len(stage.A))) if start is None else start
    states = [np.zeros((*lead, len(each.A))) for each in compensators]
    demanded = np.zeros((*lead, len(compensators)))
    commanded, standing = demanded, np.zeros(1)
    for tick in range(reference.shape[-2]):
        while to_come and to_come[0].tick <= tick:
            stage = to_come.pop(0)
            x = x if stage.onset is None else x @ stage.onset.T
            gain = gain if stage.gain is None else stage.gain
            if stage.carried is not None and gain is not None:
                standing = stage.carried * (commanded - demanded @ gain.T)
        output = x @ C.T
        error = reference[..., tick, :] - output
        ticked = [
            _tick(each, z, error[..., k])
            for k, (each, z) in enumerate(zip(compensators, states, strict=True))
        ]
        asked = np.stack([each for each, _ in ticked], axis=-1)
        demanded = asked.clip(-most, most)
        kept = held & (asked != demanded) & (error * asked > 0)
        states = [
            np.where(kept[..., k, None], z, moved)
            for k, (z, (_, moved)) in enumerate(zip(states, ticked, strict=True))
        ]
        if feedforward is not None:
            demanded = feedforward[..., tick, :] + demanded
        commanded = demanded if gain is None else demanded @ gain.T + standing
        if secondary is not None:
            commanded = commanded + secondary[tick]
        yield Step(x, output, commanded)
        x = _advanced(stage, x, commanded)
        if disturbance is not None:
            x = x + disturbance[tick]


def _advanced(stage: Stage, x: Array, commanded: Array) -> Array:
    """States (..., s) a tick later."""
    if stage.rubbing is not None:
        return stage.rubbing.moved(x, commanded)
    x = x @ stage.A.T + commanded @ stage.B.T
    return x if stage.drift is None else x + stage.drift


def _tick(channel: Channel, z: Array, error: Array) -> tuple[Array, Array]:
    """A compensator's demand (...) and next state (..., order)."""
    if z.ndim == 1:
        demand, moved = channel.C @ z, channel.A @ z
        return (demand + channel.D[:, 0] * error)[0], moved + channel.B[:, 0] * error
    demand, moved = (z * channel.C[0]).sum(axis=-1), np.einsum("ij,sj->si", channel.A, z)
    return demand + channel.D[0, 0] * error, moved + channel.B[:, 0] * error[..., None]


@dataclass(frozen=True)
class LinearLoop:
    """Plant, mapping at the nominal pose and compensators.

    Attributes:
        nominal: The plant; its first outputs are the major task.
        gain: Displacements per demanded major task, shape (n, m1).
        secondary: Displacements that the secondary goal asks for, as far as the mapping lets it,
            shape (N, n).
        reference: Of the major task, shape (N, m1).
        compensators: One for each major row.

    All arrays are copied, and read-only.

    Raises:
        ValueError, TypeError: Of another shape or kind than that.
    """

    nominal: NominalModel
    gain: Array
    secondary: Array
    reference: Array
    compensators: Sequence[Channel]

    def __post_init__(self) -> None:
        n = check.instance("nominal", self.nominal, NominalModel).actuators
        reference = check.batch("reference", self.reference)
        ticks, m1 = check.exactly("reference", reference, *reference.shape[-2:]).shape
        if not 0 < m1 <= len(self.nominal.noise):
            raise ValueError(f"reference must be of outputs of nominal, got {m1} columns")
        given = {"gain": (n, m1), "secondary": (ticks, n), "reference": (ticks, m1)}
        for name, shape in given.items():
            vars(self)[name] = check.frozen(check.exactly(name, getattr(self, name), *shape))
        channels("compensators", self.compensators, m1)


@np.errstate(over="ignore", invalid="ignore")  # the end says what overflows
def simulate(loop: LinearLoop, faults: Sequence[Fault], onset: int) -> tuple[Array, Array]:
    """States of the plant, shape (N, s), and displacements commanded, (N, n), without noise.

    Args:
        loop: The loop.
        faults: That strike, all at once, unknown to the mapping.
        onset: At which tick.

    Raises:
        ValueError, TypeError: Of another kind than that, or a loop that grows beyond all numbers.
    """
    check.instance("loop", loop, LinearLoop)
    check.index("onset", onset)
    sound, failed = fault_model(loop.nominal), fault_model(loop.nominal, faults)
    stages = [
        Stage(sound.A, sound.B),
        Stage(failed.A, failed.B, onset, failed.onset, drift=failed.drift),
    ]
    ticks = list(
        steps(
            stages,
            loop.nominal.plant.C[: loop.reference.shape[1]],
            loop.compensators,
            loop.reference,
            gain=loop.gain,
            secondary=loop.secondary,
        )
    )
    states, commanded = (
        np.array([getattr(tick, of) for tick in ticks]) for of in ("x", "commanded")
    )
    if not (check.is_moderate(states) and check.is_moderate(commanded)):
        raise ValueError("loop must stay at moderate numbers, got a gain by which it grows further")
    return states, commanded
