"""The compensators G_alpha(s) and G_beta(s) of Fig. 3, designed on the sound plant."""

from dataclasses import dataclass

import control

from experiments.hexapod.columns import MAJOR
from experiments.hexapod.testbed import Bench
from ftc.compensator import (
    Compensator,
    LoopShape,
    Margins,
    NoResponse,
    UnstableLoop,
    compensator,
    margins,
)
from sim import Array, LinearPlant, ModelError

ANGLES = ("alpha", "beta")


@dataclass(frozen=True)
class Loop(Compensator, Margins):
    """A compensator, and the margins of its loop on the sound plant."""


def design(plant: LinearPlant, pointing: Array, bench: Bench) -> tuple[Loop, Loop]:
    """The alpha and beta loops on the sound plant, their margins measured.

    Args:
        plant: Linear model of the sound plant.
        pointing: Gains from demanded (alpha, beta) to strut displacements, shape (n, 2).
        bench: Crossovers, roll-off and control period.

    Raises:
        sim.ModelError: The plant has not six degrees of freedom, a coil moves nothing, or a loop
            comes out unstable.
    """
    if plant.A.shape != (12, 12):
        raise ModelError(
            f"the sound machine must have six degrees of freedom, it has {len(plant.A) // 2}"
        )
    P = sampled(plant, pointing, bench.control_period_s)
    alpha, beta = (
        Loop(**vars(each), **vars(margins(P[row, row] * each.discrete)))
        for row, each in enumerate(designed(plant, pointing, bench))
    )
    return alpha, beta


def designed(plant: LinearPlant, pointing: Array, bench: Bench) -> tuple[Compensator, Compensator]:
    """The (alpha, beta) compensators of :func:`design`, without margins, which take a second.

    Raises:
        sim.ModelError: A coil moves nothing, or a loop comes out unstable.
    """
    return _designed(plant, pointing, bench, 0), _designed(plant, pointing, bench, 1)


def _designed(plant: LinearPlant, pointing: Array, bench: Bench, row: int) -> Compensator:
    hz, angle = bench.crossover_hz[row], ANGLES[row]
    channel = control.ss(plant.A, plant.B @ pointing[:, [row]], plant.C_twist[[MAJOR[row]]], 0)
    shape = LoopShape(hz, bench.roll_off_hz, bench.roll_off_damping)
    try:
        return compensator(channel, shape, bench.control_period_s)
    except UnstableLoop:
        raise ModelError(
            f"the {angle} loop is unstable on this machine at a crossover of {hz} Hz: lower it, "
            "or give the struts more damping"
        ) from None
    except NoResponse:
        raise ModelError(f"the coils do not move {angle}") from None


def sampled(plant: LinearPlant, gain: Array, period_s: float) -> control.StateSpace:
    """The plant behind a zero-order hold, from `gain`'s inputs to the twist."""
    continuous = control.ss(plant.A, plant.B @ gain, plant.C_twist, 0)
    return control.c2d(continuous, period_s, method="zoh")
