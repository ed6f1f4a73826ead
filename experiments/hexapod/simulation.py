"""One closed-loop run: plant, sensors, controller; arrays come back, files are made elsewhere."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import ceil
from typing import NamedTuple

import numpy as np

from experiments.hexapod.choices import JacobianChoice
from experiments.hexapod.controller import controller_for
from experiments.hexapod.testbed import Testbed, TestbedConfig
from ftc.controller import Measurement
from ftc.goal import Goal
from ftc.mapping import DisplacementForm
from ftc.oracle import Controller, OracleController, State
from sim import (
    Array,
    Failure,
    Plant,
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
    plant = Plant(testbed.model)
    plant.settle(bench.settling_s, start_m)
    lead_in = round(lead_in_s / bench.control_period_s)
    path = _Path(
        time_s=_after_rest(lead_in, time_s),
        desired_rad=_after_rest(lead_in, desired_rad),
        floor_m_per_s2=None if floor is None else _after_rest(lead_in, floor),
    )
    ticks, state = [], pilot.start()
    for tick, after in _ticks(plant, pilot, state, failures, bench, path, seed):
        ticks.append(tick)
        state = after  # the last is kept: a supervisor's are large
    return _trajectory(time_s, desired_rad, ticks[lead_in:]), state


class _Path(NamedTuple):
    """What drives a run, tick by tick; time stands still while the loop points at zero.

    A floor at rest is None.
    """

    time_s: Array
    desired_rad: Array
    floor_m_per_s2: Array | None


def _after_rest(ticks: int, signal: Array) -> Array:
    return np.concatenate([np.zeros((ticks, *signal.shape[1:])), signal])


class _Tick(NamedTuple):
    """What is kept of one control tick; angles are worked out afterwards, all at once."""

    rotation: Array
    translation_m: Array
    rotation_estimated: Array
    translation_estimated_m: Array
    measured_rad: Array
    strut_input_percent: Array
    strut_displacement_m: Array
    closure_residual_m: Array


def _ticks(
    plant: Plant,
    pilot: Controller[State],
    state: State,
    failures: Sequence[Failure],
    bench: TestbedConfig,
    path: _Path,
    seed: int,
) -> Iterator[tuple[_Tick, State]]:
    detector, strut_sensors = bench.detector(), bench.strut_sensors()
    # Sources of their own: whether strut sensors are read changes nothing of the detector's noise.
    detector_rng, strut_rng = np.random.default_rng(seed), np.random.default_rng([seed, 1])
    to_come = sorted(failures, key=lambda failure: failure.time_s)
    ticks = zip(path.time_s, path.desired_rad, strict=True)
    for tick, (now, desired) in enumerate(ticks):
        while to_come and to_come[0].time_s <= now:
            to_come.pop(0).strike(plant)
        if path.floor_m_per_s2 is not None:
            plant.shake(path.floor_m_per_s2[tick])
        pose, struts_m = plant.pose(), plant.displacements()
        measurement = Measurement(
            output=detector.read(pose.rotation, detector_rng),
            displacement=strut_sensors.read(struts_m, strut_rng),
        )
        state = pilot.step(state, desired, measurement)
        kept = _Tick(
            rotation=pose.rotation,
            translation_m=pose.translation_m,
            rotation_estimated=state.pose.rotation,
            translation_estimated_m=state.pose.translation_m,
            measured_rad=measurement.output,
            strut_input_percent=state.input_percent,
            strut_displacement_m=struts_m,
            closure_residual_m=np.asarray(plant.closure_residual_m()),
        )
        yield kept, state
        command_m = pilot.amplifier.displacement_m(state.input_percent)
        plant.step(command_m, bench.control_period_s)


def _trajectory(time_s: Array, desired_rad: Array, ticks: Sequence[_Tick]) -> Trajectory:
    kept = _Tick(*map(np.array, zip(*ticks, strict=True)))
    settled = kept.rotation[0].T
    return Trajectory(
        time_s=time_s,
        desired_rad=desired_rad,
        true_rad=pointing_angles(kept.rotation),
        measured_rad=kept.measured_rad,
        strut_input_percent=kept.strut_input_percent,
        strut_displacement_m=kept.strut_displacement_m,
        secondary=secondary_motion(
            kept.rotation @ settled, kept.translation_m - kept.translation_m[0]
        ),
        secondary_estimated=secondary_motion(kept.rotation_estimated, kept.translation_estimated_m),
        closure_residual_m=kept.closure_residual_m,
    )
