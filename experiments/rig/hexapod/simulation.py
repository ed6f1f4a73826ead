"""Runs on the spiral: what a goal and failures make of it; arrays come back."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil
from typing import Any

import numpy as np

from experiments.rig.hexapod.choices import JacobianChoice
from experiments.rig.hexapod.controller import controller_for
from experiments.rig.hexapod.rig import rig_of
from experiments.rig.hexapod.testbed import Testbed
from experiments.rig.run import Run
from ftc.control.mapping import DisplacementForm
from ftc.goal import Goal
from ftc.loop import Controller
from ftc.oracle import OracleController
from sim import NOMINAL, Array, Failure, secondary_motion


@dataclass(frozen=True)
class Trajectory:
    """What happened, at every control tick.

    Attributes:
        time_s: (N,).
        desired_rad: (N, 2) spiral (alpha, beta).
        true_rad: (N, 2) pointing of the payload.
        measured_rad: (N, 2) the detector's reading.
        strut_input_percent: (N, 6) normalized current sent from this tick on.
        strut_displacement_m: (N, 6) true strut extensions.
        secondary: (N, 4) true [gamma_rad, t_x_m, t_y_m, t_z_m], relative to the settled pose.
        secondary_estimated: (N, 4) the same as the controller estimates it.
        closure_residual_m: (N,) largest gap of a closed loop.
    """

    time_s: Array
    desired_rad: Array
    true_rad: Array
    measured_rad: Array
    strut_input_percent: Array
    strut_displacement_m: Array
    secondary: Array
    secondary_estimated: Array
    closure_residual_m: Array


@dataclass(frozen=True)
class SpiralRun:
    """One run on the spiral with a given secondary goal.

    Attributes:
        goal: Weights, and the failures that the controller knows of from the start.
        failures: What happens to the plant, whether the controller knows or not.
        reconfigured: Goal that the controller goes over to at the first failure, as if it knew at
            once; None: it goes on.
        jacobian: Where the mapping takes its Jacobian from.
        form: How eq. (41) becomes a displacement.
        seed: Of the detector noise.
        duration_s: Only the first seconds of the spiral; None is all of it.
        start_m: Strut displacements (6,) that the coils hold when the run begins; None is no
            current. A failure at time 0 strikes there: this is how a strut locks off centre.
        lead_in_s: So long the closed loop points at zero before the spiral starts, failures of
            time 0 behind it and the floor at rest; it is not kept.
        floor_m_per_s2: Acceleration of the floor in base axes, held for a tick each, at least as
            long as the spiral, shape (N, 3); None is a floor at rest.
    """

    goal: Goal
    failures: Sequence[Failure] = ()
    reconfigured: Goal | None = None
    jacobian: JacobianChoice = "analytic"
    form: DisplacementForm = "absolute"
    seed: int = 0
    duration_s: float | None = None
    start_m: Array | None = None
    lead_in_s: float = 0.0
    floor_m_per_s2: Array | None = None


def track_spiral(testbed: Testbed, run: SpiralRun) -> Trajectory:
    """What happens on a testbed in a run.

    Raises:
        ValueError: The floor's acceleration has not three columns, or ends before the spiral.
        sim.SimulationDiverged: The physics left the finite numbers.
    """
    pilot = controller_for(testbed, run.goal, jacobian=run.jacobian, form=run.form)
    options = {
        "failures": run.failures,
        "seed": run.seed,
        "duration_s": run.duration_s,
        "start_m": run.start_m,
        "lead_in_s": run.lead_in_s,
        "floor_m_per_s2": run.floor_m_per_s2,
    }
    if run.reconfigured is None or not run.failures:
        return track_path(testbed, pilot, **options)[0]
    after = controller_for(testbed, run.reconfigured, jacobian=run.jacobian, form=run.form)
    first_s = min(failure.time_s for failure in run.failures)
    period_s = testbed.bench.control_period_s
    tick = 0 if first_s == 0 else ceil((run.lead_in_s + first_s) / period_s - 1e-6)
    return track_path(testbed, OracleController(pilot, after, tick), **options)[0]


def track_path(
    testbed: Testbed,
    pilot: Controller[Any],
    *,
    desired_rad: Array | None = None,
    duration_s: float | None = None,
    begin_s: float = 0.0,
    start_m: Array | None = None,
    lead_in_s: float = 0.0,
    floor_m_per_s2: Array | None = None,
    **flight: Any,
) -> tuple[Trajectory, Any]:
    """Track the spiral, or another path, with any pilot; its last state comes back beside the run.

    Args:
        testbed: The machine and the constants around it; the pilot has compensators of its own.
        pilot: Commands the struts from the start.
        desired_rad: (alpha, beta) asked for, tick by tick, shape (N, 2); None is the spiral.
        duration_s: As in :class:`SpiralRun`, and so are the others but for `begin_s`.
        begin_s: Where on the spiral the run begins, at rest at the centre: it has to catch up.
        start_m: As there.
        lead_in_s: As there.
        floor_m_per_s2: As there.
        flight: `failures` and `seed` of :meth:`experiments.rig.Rig.fly`.

    Raises:
        ValueError: The floor's acceleration has not three columns, or ends before the path; a
            duration for a path, which has its own.
        sim.SimulationDiverged: The physics left the finite numbers.
    """
    bench = testbed.bench
    if desired_rad is None:
        spiral_s = bench.duration_s if duration_s is None else duration_s
        desired_rad = bench.desired_rad(begin_s + bench.time_s(spiral_s))
    elif duration_s is not None:
        raise ValueError(f"duration_s must be None with a desired_rad, got {duration_s}")
    floor, ticks = floor_m_per_s2, len(desired_rad)
    if floor is not None:
        if floor[:ticks].shape != (ticks, 3):
            raise ValueError(
                f"floor_m_per_s2 must have 3 columns and at least {ticks} rows, "
                f"got the shape {floor.shape}"
            )
        floor = floor[:ticks]
    rig = replace(rig_of(testbed), start_m=start_m, floor_m_per_s2=floor)
    run = rig.fly(pilot, desired_rad, begin_s=begin_s, lead_in_s=lead_in_s, **flight)
    return trajectory(run), run.state


def trajectory(run: Run) -> Trajectory:
    """A flight of the hexapod in its own words."""
    rotation, translation_m = run.pose.rotation, run.pose.translation_m
    poses = [NOMINAL if pose is None else pose for pose in run.estimated]
    return Trajectory(
        time_s=run.time_s,
        desired_rad=run.desired,
        true_rad=run.true,
        measured_rad=run.measured,
        strut_input_percent=run.inputs,
        strut_displacement_m=run.displacement,
        secondary=secondary_motion(rotation @ rotation[0].T, translation_m - translation_m[0]),
        secondary_estimated=secondary_motion(
            np.array([pose.rotation for pose in poses]),
            np.array([pose.translation_m for pose in poses]),
        ),
        closure_residual_m=run.closure_m,
    )
