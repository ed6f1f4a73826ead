"""One closed-loop run: plant, sensors, controller; arrays come back, files are made elsewhere."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil
from typing import Any

import mujoco
import numpy as np

from experiments.rig.hexapod.choices import JacobianChoice
from experiments.rig.hexapod.controller import controller_for
from experiments.rig.hexapod.testbed import Testbed, TestbedConfig
from ftc.control.mapping import DisplacementForm
from ftc.goal import Goal
from ftc.loop import Controller, LoopRun, State, run_loop
from ftc.oracle import OracleController
from sim import (
    NOMINAL,
    Array,
    Bench,
    Failure,
    Plant,
    Pose,
    Reading,
    pointing_angles,
    secondary_motion,
)


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
    pilot: Controller[State],
    *,
    desired_rad: Array | None = None,
    failures: Sequence[Failure] = (),
    seed: int = 0,
    begin_s: float = 0.0,
    duration_s: float | None = None,
    start_m: Array | None = None,
    lead_in_s: float = 0.0,
    floor_m_per_s2: Array | None = None,
) -> tuple[Trajectory, State]:
    """Track the spiral, or another path, with any pilot; its last state comes back beside the run.

    Args:
        testbed: The machine and the constants around it; the pilot has compensators of its own.
        pilot: Commands the struts from the start.
        desired_rad: (alpha, beta) asked for, tick by tick, shape (N, 2); None is the spiral.
        failures: What happens to the plant.
        seed: Of the noise of all sensors.
        begin_s: Where on the spiral the run begins, at rest at the centre: it has to catch up.
        duration_s: As in :class:`SpiralRun`, and so are all others.
        start_m: As there.
        lead_in_s: As there.
        floor_m_per_s2: As there.

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
    time_s = begin_s + bench.time_s(len(desired_rad) * bench.control_period_s)
    floor = None if floor_m_per_s2 is None else floor_m_per_s2[: len(time_s)]
    if floor is not None and floor.shape != (len(time_s), 3):
        raise ValueError(
            f"floor_m_per_s2 must have 3 columns and at least {len(time_s)} rows, "
            f"got the shape {floor.shape}"
        )
    lead_in = round(lead_in_s / bench.control_period_s)
    machine = simulated(
        testbed,
        _after_rest(lead_in, time_s),
        failures,
        seed,
        start_m=start_m,
        floor_m_per_s2=None if floor is None else _after_rest(lead_in, floor),
    )
    run = run_loop(machine, pilot, _after_rest(lead_in, desired_rad))
    return _trajectory(time_s, desired_rad, machine, run, lead_in), run.state


def settled(testbed: Testbed) -> Testbed:
    """The testbed with its machine settled, once for all runs that begin without current.

    Raises:
        sim.SimulationDiverged: The physics left the finite numbers.
    """
    plant = Plant(testbed.machine.model)
    plant.settle(testbed.bench.settling_s)
    return replace(testbed, inexact=replace(testbed.machine, rest=plant.data))


def simulated(
    testbed: Testbed,
    time_s: Array,
    failures: Sequence[Failure],
    seed: int,
    *,
    start_m: Array | None = None,
    floor_m_per_s2: Array | None = None,
    keep_qpos: bool = False,
    events: object = None,
) -> Bench:
    """The machine in the loop, settled: detector, gauges, amplifiers, and what happens to it.

    Args:
        testbed: The machine and the constants around it.
        time_s: Of each control tick, shape (N,): failures strike at their times.
        failures: What happens.
        seed: Of the noise of all sensors.
        start_m: As in :class:`SpiralRun`.
        floor_m_per_s2: Acceleration of the floor at each tick, shape (N, 3); None is at rest.
        keep_qpos: Whether the log has the positions of all joints.
        events: What else happens; see :class:`sim.Bench`.
    """
    bench, ticks = testbed.bench, len(time_s)
    period_s, machine = bench.control_period_s, testbed.machine
    plant = Plant(machine.model)
    if machine.rest is not None and start_m is None:
        mujoco.mj_copyData(plant.data, plant.model, machine.rest)
    else:
        plant.settle(bench.settling_s, start_m)
    floors = [f for f in (floor_m_per_s2, machine.floor(ticks, period_s)) if f is not None]
    return Bench(
        plant,
        _Sensors(bench, seed, machine.zero_rad(ticks, period_s)),
        time_s=time_s,
        period_s=period_s,
        failures=failures,
        drives=machine.drives(testbed.model, testbed.amplifier().displacement_m, period_s),
        floor_m_per_s2=np.sum(floors, axis=0) if floors else None,
        delay_ticks=machine.delay_ticks,
        hysteresis=machine.hysteresis,
        keep_qpos=keep_qpos,
        events=events,
    )


def _after_rest(ticks: int, signal: Array) -> Array:
    """A signal that is zero for some ticks before it begins; time stands still meanwhile."""
    return np.concatenate([np.zeros((ticks, *signal.shape[1:])), signal])


class _Sensors:
    """The detector behind the telescope, its zero (N, 2) adrift, and the gauges."""

    def __init__(self, bench: TestbedConfig, seed: int, zero_rad: Array) -> None:
        self._detector, self._gauges = bench.detector(), bench.strut_sensors()
        # Sources of their own: whether gauges are read changes nothing of the detector's noise.
        self._detector_rng = np.random.default_rng(seed)
        self._gauge_rng = np.random.default_rng([seed, 1])
        self._zeros_rad = iter(zero_rad)

    def read(self, pose: Pose, displacements: Array) -> Reading:
        return Reading(
            output=self._detector.read(pose.rotation, self._detector_rng) + next(self._zeros_rad),
            displacement=self._gauges.read(displacements, self._gauge_rng),
        )


def _trajectory(
    time_s: Array, desired_rad: Array, bench: Bench, run: LoopRun[Any], lead_in: int
) -> Trajectory:
    rotation, translation_m = bench.rotation[lead_in:], bench.translation_m[lead_in:]
    poses = [NOMINAL if pose is None else pose for pose in run.poses[lead_in:]]
    return Trajectory(
        time_s=time_s,
        desired_rad=desired_rad,
        true_rad=pointing_angles(rotation),
        measured_rad=run.measured[lead_in:],
        strut_input_percent=run.input_percent[lead_in:],
        strut_displacement_m=bench.displacement[lead_in:],
        secondary=secondary_motion(rotation @ rotation[0].T, translation_m - translation_m[0]),
        secondary_estimated=secondary_motion(
            np.array([pose.rotation for pose in poses]),
            np.array([pose.translation_m for pose in poses]),
        ),
        closure_residual_m=bench.closure_residual_m[lead_in:],
    )
