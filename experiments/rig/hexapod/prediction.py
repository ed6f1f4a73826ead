"""Predictions of runs by the linear model of the testbed."""

from collections.abc import Sequence
from dataclasses import dataclass

import control
import mujoco
import numpy as np

from experiments.rig.hexapod.columns import MAJOR
from experiments.rig.hexapod.controller import StrutMapping, sampled
from experiments.rig.hexapod.fault_tolerance import nominal_model
from experiments.rig.hexapod.simulation import SpiralRun
from experiments.rig.hexapod.testbed import Testbed, TestbedConfig
from ftc.control.compensator import sensitivity_peak as peak_of_sensitivity
from ftc.fdi.dither import Dither
from ftc.goal import Goal
from ftc.linear_loop import LinearLoop, closed_loop, limited_response
from sim import NOMINAL, Array, Failure, Plant, failed_plant, hexapod, linearize

MARGINAL = 1 + 1e-9
"""A largest pole up to here is an integrator that the mapping lets move nothing."""


def predicted_rms_rad(testbed: Testbed, run: SpiralRun) -> Array:
    """RMS of desired minus true (alpha, beta) over the spiral, shape (2,), [rad].

    The plant, with its failures from the start, is linearized and sampled behind the zero-order
    hold; the loop is closed with the discrete compensators and the mapping at J_0. The spiral goes
    through as it is; white detector noise gives the sum of squares of the pulse response. Left out:
    the DAC's quantization, 0.02 urad here.
    """
    bench, L = testbed.bench, _loop_transfer(testbed, run)
    unity = control.ss([], [], [], np.eye(2), bench.control_period_s)
    T = control.feedback(L, unity)

    time_s = bench.time_s(bench.duration_s if run.duration_s is None else run.duration_s)
    desired_rad = bench.desired_rad(time_s)
    error_rad = desired_rad - _response(T, time_s, desired_rad)
    noise_rad = bench.detector_noise_m / bench.focal_length_m
    variance = noise_rad**2 * sum(
        (_response(T, time_s, pulse) ** 2).sum(axis=0) for pulse in _unit_pulses(len(time_s))
    )
    return np.sqrt((error_rad**2).mean(axis=0) + variance)


@dataclass(frozen=True)
class Prediction:
    """What the linear model says of one run.

    Attributes:
        pole_radius: Largest pole of the sampled loop.
        error_rad: Desired minus true (alpha, beta), tick by tick, shape (N, 2); None: the loop is
            unstable, with a pole beyond `MARGINAL`.
    """

    pole_radius: float
    error_rad: Array | None


def predicted_error_rad(testbed: Testbed, run: SpiralRun) -> Array | None:
    """The error of :func:`prediction`, shape (N, 2), [rad]; None: unstable loop."""
    return prediction(testbed, run).error_rad


def prediction(testbed: Testbed, run: SpiralRun) -> Prediction:
    """Largest pole and error of a run, tick by tick.

    The linear model of :func:`predicted_rms_rad`, driven by what drives one run: the same detector
    noise, floor, and lock off centre, with the limit on the demanded pointing where the testbed has
    one. Saturation of the amplifiers and quantization are left out. Failures are locks or free
    struts from the start: locks at `start_m`, from which the other struts return to the centre.
    """
    bench, loops = testbed.bench, testbed.loops
    spiral_s = bench.time_s(bench.duration_s if run.duration_s is None else run.duration_s)
    rest = round(run.lead_in_s / bench.control_period_s)
    ticks = rest + len(spiral_s)
    desired = np.zeros((ticks, 2))
    desired[rest:] = bench.desired_rad(spiral_s)
    noise = detector_noise_rad(bench, run.seed, ticks)
    floor = np.zeros((ticks, 3))
    if run.floor_m_per_s2 is not None:
        floor[rest:] = run.floor_m_per_s2[: len(spiral_s)]

    geometry = hexapod(testbed.model)
    stuck_m = np.zeros(6)
    for failure in run.failures:
        stuck_m[failure.number] = 0.0 if run.start_m is None else run.start_m[failure.number]
    offset = np.linalg.solve(geometry.inverse_jacobian(NOMINAL), stuck_m)[MAJOR]
    mapping = StrutMapping(geometry, run.goal, "constant", testbed.stiffness)
    # What the mapping commands at zero pointing, because it knows of a strut off centre.
    standing_m = mapping.displacements(np.zeros(2), NOMINAL)

    plant, gain = failed_plant(testbed.model, run.failures), mapping.major_gain()
    compensators = [loop.discrete for loop in loops]
    T = driven_loop(plant, gain, compensators)
    pole_radius = float(np.abs(T.poles()).max())
    if pole_radius > MARGINAL:
        return Prediction(pole_radius, None)
    reference = desired - noise - offset
    disturbance = np.hstack([floor, np.tile(standing_m, (ticks, 1))])
    if bench.demand_limit_urad is None:
        driven = np.hstack([reference, disturbance])
        time_s = np.arange(ticks) * bench.control_period_s
        moved = np.asarray(control.forced_response(T, time_s, driven.T).outputs).T
    else:
        moved = limited_response(
            driven_plant(plant, gain, bench.control_period_s),
            compensators,
            reference[None],
            disturbance,
            np.array([bench.demand_limit_rad]),
            np.array([bench.anti_windup]),
        )[0]
    return Prediction(pole_radius, (desired - (offset + moved))[rest:])


def detector_noise_rad(bench: TestbedConfig, seed: int, ticks: int) -> Array:
    """What the detector of a run adds to (alpha, beta), tick by tick, shape (N, 2)."""
    spot_m = bench.detector_noise_m * np.random.default_rng(seed).standard_normal((ticks, 2))
    return spot_m[:, ::-1] * np.array([1, -1]) / bench.focal_length_m


def driven_loop(
    plant: Plant, gain: Array, compensators: Sequence[control.StateSpace]
) -> control.StateSpace:
    """Closed loop from [desired pointing; floor; further strut commands] to true pointing.

    Args:
        plant: At rest, with its failures.
        gain: Strut displacements per commanded (alpha, beta), shape (6, 2).
        compensators: Of alpha and beta, discrete.
    """
    return closed_loop(driven_plant(plant, gain, compensators[0].dt), compensators)


def driven_plant(plant: Plant, gain: Array, period_s: float) -> control.StateSpace:
    """Sampled plant from [floor; further strut commands; demanded pointing] to true pointing."""
    linear = linearize(plant.model, plant.data)
    inputs = np.hstack([linear.B_floor, linear.B, linear.B @ gain])
    return control.c2d(
        control.ss(linear.A, inputs, linear.C_twist[MAJOR], 0), period_s, method="zoh"
    )


def sensitivity_peak(testbed: Testbed, run: SpiralRun) -> float:
    """Peak over frequency of the largest singular value of (I + L)^-1 of the two pointing loops.

    Its inverse is how near the loops come to instability, both channels and their coupling taken
    together; a well-damped single loop has less than 2.
    """
    return peak_of_sensitivity(_loop_transfer(testbed, run))


def _loop_transfer(testbed: Testbed, run: SpiralRun) -> control.StateSpace:
    """Open pointing loops: compensators, mapping at J_0, converters' hold, failed plant."""
    plant = failed_plant(testbed.model, run.failures)
    mapping = StrutMapping(hexapod(testbed.model), run.goal, "constant", testbed.stiffness)
    compensators = control.append(*(loop.discrete for loop in testbed.loops))
    linear, period_s = linearize(plant.model, plant.data), testbed.bench.control_period_s
    P = sampled(linear, mapping.major_gain(), period_s)
    return P[MAJOR, :] * compensators


def predicted_motion(
    model: mujoco.MjModel, failures: Sequence[Failure], time_s: Array, command_m: Array
) -> Array:
    """Payload twist [rotation; translation] that strut commands cause, shape (N, 6).

    The plant is linearized anew after each failure, which hands its state on: struts that lose
    their coil or spring keep the loops, and so the coordinates. Locks would not.

    Args:
        model: The machine.
        failures: Struts that go free or loose, in the order of time.
        time_s: Control ticks, shape (N,).
        command_m: Commanded strut displacements, held for a tick each, shape (N, 6).
    """
    plant = Plant(model)
    period_s = float(time_s[1] - time_s[0])
    starts = np.searchsorted(time_s, [failure.time_s for failure in failures])
    ends = [*starts, len(time_s)]
    twist, state = [], 0.0
    for k, (begin, end) in enumerate(zip([0, *starts], ends, strict=True)):
        if k > 0:
            failures[k - 1].strike(plant)
        if begin == end:
            continue
        model_now = sampled(linearize(plant.model, plant.data), np.eye(6), period_s)
        ticks = np.arange(end - begin + 1) * period_s
        held = np.vstack([command_m[begin:end], command_m[end - 1]])
        response = control.forced_response(model_now, ticks, held.T, state, return_states=True)
        twist.append(np.asarray(response.outputs).T[:-1])
        state = np.asarray(response.states)[:, -1]
    return np.concatenate(twist)


def _response(T: control.StateSpace, time_s: Array, signal: Array) -> Array:
    """True (alpha, beta) that a signal (N, 2) at the loop's input gives, shape (N, 2)."""
    return np.asarray(control.forced_response(T, time_s, signal.T).outputs).T


def _unit_pulses(ticks: int) -> tuple[Array, Array]:
    """One tick of detector noise, in alpha and in beta; each shape (ticks, 2)."""
    pulses = np.zeros((2, ticks, 2))
    pulses[[0, 1], 0, [0, 1]] = 1.0
    return pulses[0], pulses[1]


def linear_loop(
    testbed: Testbed, goal: Goal, dither: Dither, *, begin_s: float, duration_s: float
) -> LinearLoop:
    """The loop on the spiral, as a run has it, with the mapping of the sound machine at J_0."""
    bench = testbed.bench
    mapping = StrutMapping(hexapod(testbed.model), goal, "constant")
    time_s = bench.time_s(duration_s)
    passed = [
        mapping.displacements(np.zeros(2), NOMINAL, secondary_reference=unit) for unit in np.eye(6)
    ]
    return LinearLoop(
        nominal=nominal_model(testbed.model, bench),
        gain=mapping.major_gain(),
        secondary=np.array([dither.at(each) for each in time_s]) @ np.array(passed),
        reference=bench.desired_rad(begin_s + time_s),
        compensators=testbed.loops,
    )
