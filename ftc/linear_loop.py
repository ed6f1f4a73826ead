"""The closed loop in the linear model: what a failure will look like, without noise."""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from experiments.hexapod.compensator import Loop
from experiments.hexapod.diagnosis import nominal_model
from experiments.hexapod.goal import Goal
from experiments.hexapod.mapping import StrutMapping
from experiments.hexapod.testbed import Bench
from ftc.fdi.dither import Dither
from ftc.fdi.fault_model import Fault, FaultModel, NominalModel, fault_model
from sim import NOMINAL, Array, hexapod


@dataclass(frozen=True)
class LinearLoop:
    """Machine, mapping at J_0 and compensators, tick by tick.

    Attributes:
        sound: What flies.
        gain: Strut displacements per (alpha, beta) asked of the mapping, shape (6, 2).
        secondary_m: Strut displacements that the secondary goal asks for, as far as the mapping
            lets it, shape (N, 6).
        desired_rad: (N, 2).
        loops: Compensators of alpha and beta.
    """

    sound: NominalModel
    gain: Array
    secondary_m: Array
    desired_rad: Array
    loops: tuple[Loop, Loop]


def linear_loop(
    model: mujoco.MjModel,
    bench: Bench,
    loops: tuple[Loop, Loop],
    goal: Goal,
    dither: Dither,
    *,
    begin_s: float,
    duration_s: float,
) -> LinearLoop:
    """The loop on the spiral, as :func:`fly`, with the sound machine's mapping."""
    mapping = StrutMapping(hexapod(model), goal, "constant")
    time_s = bench.time_s(duration_s)
    passed = [mapping.displacements(np.zeros(2), NOMINAL, rest_m=unit) for unit in np.eye(6)]
    return LinearLoop(
        sound=nominal_model(model, bench),
        gain=mapping.pointing_gain(),
        secondary_m=np.array([dither.at(each) for each in time_s]) @ np.array(passed),
        desired_rad=bench.desired_rad(begin_s + time_s),
        loops=loops,
    )


def flown(loop: LinearLoop, faults: Sequence[Fault], onset: int) -> tuple[Array, Array]:
    """States of the machine, shape (N, s), and displacements commanded, (N, 6), without noise.

    Args:
        loop: What flies.
        faults: What strikes, all at once, unknown to the mapping.
        onset: At which tick.
    """
    sound = fault_model(loop.sound)
    failed = fault_model(loop.sound, faults)
    x, compensators = np.zeros(len(sound.A)), [np.zeros(len(each.A)) for each in loop.loops]
    states, sent = [], []
    machine: FaultModel = sound
    for tick, desired in enumerate(loop.desired_rad):
        if tick == onset:
            x, machine = failed.onset @ x, failed
        error = desired - loop.sound.plant.C @ x
        pointing = [
            (each.C @ c + each.D[:, 0] * e)[0]
            for each, c, e in zip(loop.loops, compensators, error, strict=True)
        ]
        compensators = [
            each.A @ c + each.B[:, 0] * e
            for each, c, e in zip(loop.loops, compensators, error, strict=True)
        ]
        u = loop.gain @ np.array(pointing) + loop.secondary_m[tick]
        states.append(x)
        sent.append(u)
        x = machine.step(x, u)
    return np.array(states), np.array(sent)
