"""Which dither: every null direction of J_m, several frequencies and amplitudes, without noise."""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from experiments.hexapod.compensator import Loop
from experiments.hexapod.testbed import Bench
from experiments.recover.cases import DITHER, GOAL
from ftc.fdi.dither import Dither
from ftc.fdi.fault_model import Fault, Kind
from ftc.fdi.hypotheses import bank
from ftc.fdi.isolability import separations
from ftc.fdi.sensing import sensing
from ftc.linear_loop import linear_loop
from sim import NOMINAL, hexapod

DIRECTIONS = {"gamma": 2, "t_x": 3, "t_y": 4, "t_z": 5}
"""Payload motions that pointing does not see, by the column of strut displacements per twist."""

FREQUENCIES_HZ = (5.0, 10.0, 20.0, 30.0)
AMPLITUDES_M = (0.125e-6, 0.25e-6, 0.5e-6, 1e-6)

EVIDENCE_S = 0.1
"""Short: what a dither is for is speed."""

_BEGIN_S, _ONSET_S = 6.0, 1.5
_KINDS: tuple[Kind, ...] = ("locked", "free")


@dataclass(frozen=True)
class DesignPoint:
    """One dither.

    Attributes:
        direction: Of :data:`DIRECTIONS`.
        frequency_hz: Its frequency.
        amplitude_m: Of the strut that moves most.
        separation: Of a locked or free strut from any other strut, the least.
    """

    direction: str
    frequency_hz: float
    amplitude_m: float
    separation: float


def dither_design(
    model: mujoco.MjModel,
    bench: Bench,
    loops: tuple[Loop, Loop],
    struts: Sequence[int],
    frequencies_hz: Sequence[float],
) -> list[DesignPoint]:
    """Each direction at each frequency; then the amplitudes of the one that is chosen."""
    per_twist = hexapod(model).inverse_jacobian(NOMINAL)
    onset = round(_ONSET_S / bench.control_period_s)
    until = onset + round(EVIDENCE_S / bench.control_period_s)

    def point(direction: str, frequency_hz: float, amplitude_m: float) -> DesignPoint:
        column = per_twist[:, DIRECTIONS[direction]]
        way = tuple((column / np.abs(column).max()).tolist())
        loop = linear_loop(
            model,
            bench,
            loops,
            GOAL,
            Dither(amplitude_m, frequency_hz, way),
            begin_s=_BEGIN_S,
            duration_s=_ONSET_S + EVIDENCE_S,
        )
        seen = sensing(loop.sound, bench, strut_sensors=False)
        hypotheses = bank(loop.sound, (), seen.C)
        apart = [
            np.delete(
                separations(loop, hypotheses, Fault(strut, kind), onset, until)[0], strut, axis=0
            ).min()
            for strut in struts
            for kind in _KINDS
        ]
        return DesignPoint(direction, frequency_hz, amplitude_m, float(min(apart)))

    points = [point(way, hz, DITHER.amplitude_m) for way in DIRECTIONS for hz in frequencies_hz]
    return points + [point("t_z", DITHER.frequency_hz, size) for size in AMPLITUDES_M]
