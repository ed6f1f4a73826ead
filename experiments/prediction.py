"""What the linear model of this bench says a run should give."""

from collections.abc import Sequence

import control
import mujoco
import numpy as np

from experiments.bench import Bench
from experiments.compensator import Loop, sampled
from experiments.mapping import MAJOR, Goal, StrutMapping
from sim import Array, Failure, Plant, failed_plant, hexapod, linearize


def predicted_rms_rad(
    model: mujoco.MjModel,
    bench: Bench,
    loops: tuple[Loop, Loop],
    goal: Goal,
    *,
    failures: Sequence[Failure] = (),
    stiffness: Array | None = None,
    duration_s: float | None = None,
) -> Array:
    """RMS of desired minus true (alpha, beta) over the spiral, shape (2,), [rad].

    The plant, with its failures from the start, is linearized and sampled behind the zero-order
    hold; the loop is closed with the discrete compensators and the mapping at J_0. The spiral goes
    through as it is; white detector noise gives the sum of squares of the pulse response. Left out:
    the DAC's quantization, 0.02 urad here.
    """
    L = _loop_transfer(model, bench, loops, goal, failures, stiffness)
    unity = control.ss([], [], [], np.eye(2), bench.control_period_s)
    T = control.feedback(L, unity)

    time_s = bench.time_s(bench.duration_s if duration_s is None else duration_s)
    desired_rad = bench.desired_rad(time_s)
    error_rad = desired_rad - _response(T, time_s, desired_rad)
    noise_rad = bench.detector_noise_m / bench.focal_length_m
    variance = noise_rad**2 * sum(
        (_response(T, time_s, pulse) ** 2).sum(axis=0) for pulse in _unit_pulses(len(time_s))
    )
    return np.sqrt((error_rad**2).mean(axis=0) + variance)


def sensitivity_peak(
    model: mujoco.MjModel,
    bench: Bench,
    loops: tuple[Loop, Loop],
    goal: Goal,
    *,
    failures: Sequence[Failure] = (),
    stiffness: Array | None = None,
) -> float:
    """Peak over frequency of the largest singular value of (I + L)^-1 of the two pointing loops.

    Its inverse is how near the loops come to instability, both channels and their coupling taken
    together; a well-damped single loop has less than 2.
    """
    L = _loop_transfer(model, bench, loops, goal, failures, stiffness)
    frequency_rad_s = 2 * np.pi * np.geomspace(0.1, 0.45 / bench.control_period_s, 3000)
    response = np.moveaxis(control.frequency_response(L, frequency_rad_s).frdata, -1, 0)
    return float(1 / np.linalg.svd(np.eye(2) + response, compute_uv=False).min())


def _loop_transfer(
    model: mujoco.MjModel,
    bench: Bench,
    loops: tuple[Loop, Loop],
    goal: Goal,
    failures: Sequence[Failure],
    stiffness: Array | None,
) -> control.StateSpace:
    """Open pointing loops: compensators, mapping at J_0, converters' hold, failed plant."""
    plant = failed_plant(model, failures)
    gain = StrutMapping(hexapod(model), goal, "constant", stiffness).pointing_gain()
    compensators = control.append(*(loop.discrete for loop in loops))
    P = sampled(linearize(plant.model, plant.data), gain, bench.control_period_s)
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
