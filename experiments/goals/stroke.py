"""Stroke-limit avoidance: desired strut rates that lead away from the stops."""

import numpy as np

from experiments.goals.demonstration import Demonstration, Outcome, Way
from experiments.goals.off_axis import (
    JUDGED_FROM_S,
    Seeker,
    controllers,
    no_rates,
    off_axis_path,
    outcome,
)
from experiments.hexapod.compensator import Loop
from experiments.hexapod.goal import Goal
from experiments.hexapod.scaling import Growth, grown_bench, grown_machine
from experiments.hexapod.simulation import fly
from experiments.hexapod.testbed import Bench
from sim import Array, Pose, load_model

TARGET_URAD = (3464.0, 2000.0)
"""4 mrad off the axis, the way of struts 1 and 4: the least sum of squares of the displacements
takes 664 um of these, beyond their stops; the least of the largest is 498 um."""

ACTIVE = 0.82
"""Part of the stroke beyond which a strut is led back."""
RELAX_S = 0.2
"""In which it comes back; slow against the pointing loops, fast against the slew."""
REACHED_UM = 10.0
"""A strut that is nearer to its stop than this has reached it: current and stop end together."""
LONGER = Growth(stroke=1.5, spiral=1.0)
"""The machine on which nothing needs avoiding."""


def stop_potential(displacements_m: Array, stroke_m: float) -> float:
    """What the goal would have small, [m^2]/[s]: zero while no strut is near a stop.

    Half the squares of what struts (6,) stand beyond the active part of their stroke, over the
    time to come back; after Chaumette and Marchand (2000), reference [3] of the paper.
    """
    beyond = np.maximum(0.0, np.abs(displacements_m) - ACTIVE * stroke_m)
    return float(0.5 * np.sum(beyond**2) / RELAX_S)


def rates_from_stops(displacements_m: Array, stroke_m: float) -> Array:
    """Desired strut rates (6,), [m]/[s]: down the gradient of :func:`stop_potential`."""
    beyond = np.maximum(0.0, np.abs(displacements_m) - ACTIVE * stroke_m)
    return -np.sign(displacements_m) * beyond / RELAX_S


def run(way: Way, duration_s: float, loops: tuple[Loop, Loop]) -> Outcome:
    """One search around the target."""
    model, bench = load_model(), Bench()
    stroke_m = float(model.jnt_range[model.actuator_trnid[0, 0], 1])
    if not way.limited:
        model, bench = grown_machine(model, LONGER), grown_bench(bench, LONGER)

    def rates(displacements_m: Array, pose: Pose) -> Array:
        return rates_from_stops(displacements_m, stroke_m)

    controller = controllers(model, bench, loops, way)(Goal(joint_weight=(1.0,) * 6))
    pilot = Seeker(controller, rates if way.pursues else no_rates, bench.control_period_s)
    path = off_axis_path(bench, TARGET_URAD, duration_s)
    flown, _ = fly(model, bench, pilot, desired_rad=path, seed=way.seed)
    margin_m = stroke_m - np.abs(flown.strut_displacement_m).max(axis=1)
    return outcome(flown, 1e6 * margin_m)


DEMONSTRATION = Demonstration(
    name="stroke",
    title="Stroke limits of the struts",
    machine="fjh",
    angles=("alpha", "beta"),
    measure="stroke_margin_um",
    limit=REACHED_UM,
    keeps_below=False,
    judged_from_s=JUDGED_FROM_S,
    duration_s=10.0,
    quick_duration_s=5.0,
    settings={
        "target_urad": TARGET_URAD,
        "active_part_of_stroke": ACTIVE,
        "relax_s": RELAX_S,
        "longer_stroke": LONGER.stroke,
    },
    run=run,
)
