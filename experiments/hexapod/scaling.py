"""Spiral and stroke grown together, until the Jacobian can no longer be taken as constant."""

import copy
from dataclasses import dataclass, replace

import mujoco

from experiments.hexapod.testbed import Bench


@dataclass(frozen=True)
class Growth:
    """A larger machine task: how many times the stroke, how many times the spiral."""

    stroke: float
    spiral: float

    def __str__(self) -> str:
        if self.stroke == self.spiral:
            return f"x{self.spiral:g}"
        return f"x{self.spiral:g} on stroke x{self.stroke:g}"


GROWTHS = (
    Growth(1, 1),
    Growth(3, 3),
    Growth(10, 10),
    Growth(30, 30),
    Growth(100, 100),
    # A longer stroke would not leave the struts' triangle whole; the spiral has room to grow.
    Growth(100, 300),
    Growth(100, 1000),
)


def grown_machine(model: mujoco.MjModel, growth: Growth) -> mujoco.MjModel:
    """The machine with longer strokes, and coils strong enough for them; all else as it is."""
    grown = copy.copy(model)
    grown.jnt_range[grown.actuator_trnid[:, 0]] *= growth.stroke
    grown.actuator_forcerange[:] *= growth.stroke
    grown.actuator_ctrlrange[:] *= growth.stroke
    return grown


def grown_bench(bench: Bench, growth: Growth) -> Bench:
    """A larger spiral, a detector that sees it, and amplifiers that drive the stroke.

    Detector noise and crossovers stay as they are.
    """
    return replace(
        bench,
        spiral_radius_urad=bench.spiral_radius_urad * growth.spiral,
        detector_half_width_m=bench.detector_half_width_m * growth.spiral,
        dac_full_input_a=bench.dac_full_input_a * growth.stroke,
        amplifier_limit_a=bench.amplifier_limit_a * growth.stroke,
    )
