"""What linear theory says of a lost strut, of a candidate, and of a detector off the focus."""

from dataclasses import dataclass
from typing import Any

import control
import mujoco
import numpy as np

from experiments.rig.hexapod.columns import MAJOR
from experiments.rig.hexapod.controller import Loop, StrutMapping, nominal_loops, sampled
from experiments.rig.hexapod.machine import detector_noise_rad
from experiments.rig.hexapod.testbed import Testbed, TestbedConfig
from experiments.rig.prediction import MARGINAL, loop_peak, open_loop, pole_radius
from experiments.rig.run import after_rest, rms
from experiments.uncorrected.candidates import (
    COLUMNS,
    EXPERIMENTS,
    PAPER_RATIOS,
    RATIO_TOLERANCE,
    STRUT,
    Candidate,
)
from ftc.fdi.fault_model import Fault
from sim import NOMINAL, Array, Plant, failed_plant, hexapod, linearize, load_model

SETTLED_S = 2.0
"""Time for the loop to take the payload to the centre before a spiral."""


def remaining_gain(model: mujoco.MjModel) -> Array:
    """True per demanded (alpha, beta) of W_a's mapping while strut 1 stands still, shape (2, 2)."""
    geometry = hexapod(model)
    J_m = np.linalg.inv(geometry.inverse_jacobian(NOMINAL))[:2]
    mapping = StrutMapping(geometry, EXPERIMENTS["W_a"].goal, "constant").major_gain()
    mapping[STRUT] = 0.0
    return J_m @ mapping


def strut_direction(model: mujoco.MjModel) -> float:
    """How much more strut 1 moves alpha than beta, for the same extension."""
    column = np.linalg.inv(hexapod(model).inverse_jacobian(NOMINAL))[:, STRUT]
    return float(column[0] / column[1])


def fast_loop_ratio(gain: Array) -> Array:
    """RMS errors over those of the sound machine, for any linear compensators, shape (2,).

    With G the gain that is left and L = diag(L_alpha, L_beta) the sound loops, the error is
    e = (I + G L)^-1 r, since each compensator sees its own angle alone. Where |L| >> 1 this is
    L^-1 G^-1 r, and the sound error L^-1 r: each angle passes the same filter in both, which
    cancels from the ratio. The spiral has as much of alpha as of beta at every frequency, a quarter
    turn apart; so what is left are the norms of the rows of G^-1, whatever the compensators are.
    """
    return np.linalg.norm(np.linalg.inv(gain), axis=1)


def gain_and_plant(model: mujoco.MjModel, column: str) -> tuple[Array, Plant]:
    """Strut displacements per demanded (alpha, beta), and the failed plant, of one of COLUMNS."""
    experiment = EXPERIMENTS[column]
    gain = StrutMapping(hexapod(model), experiment.goal, "constant").major_gain()
    return gain, failed_plant(model, experiment.failures)


@dataclass(frozen=True)
class Predicted:
    """What the linear model says of one candidate, by column; None: unstable, or saturated."""

    loops: tuple[Loop, Loop]  # the (alpha, beta) compensators
    rms_urad: dict[str, Array | None]  # (2,)
    sensitivity: dict[str, float | None]  # peak of the stable loops
    settled_urad: dict[str, Array | None]  # (2,) of W_d and W_e, started with the loop settled


def predict(candidate: Candidate, seed: int, duration_s: float) -> Predicted:
    """The linear model of a candidate's four columns."""
    machine, bench = candidate.machine(load_model()), candidate.bench
    testbed = Testbed(machine, bench, loops := nominal_loops(machine, bench))

    def error_rad(column: str, lead_in_s: float = candidate.lead_in_s) -> Array | None:
        return predicted_error_rad(testbed, candidate, column, seed, duration_s, lead_in_s)

    def rms_urad(error: Array | None) -> Array | None:
        return None if error is None or candidate.saturates else 1e6 * rms(error)

    def peak(column: str) -> float:
        rig = candidate.rig(testbed, column, seed, duration_s)
        return loop_peak(rig, rig.goal, faults_of(column))

    errors = {column: error_rad(column) for column in COLUMNS}
    return Predicted(
        loops,
        rms_urad={column: rms_urad(error) for column, error in errors.items()},
        sensitivity={
            column: None if error is None else peak(column) for column, error in errors.items()
        },
        settled_urad={column: rms_urad(error_rad(column, SETTLED_S)) for column in ("W_d", "W_e")},
    )


def faults_of(column: str) -> list[Fault]:
    """Faults of the plant in one of COLUMNS."""
    return [Fault.of(failure) for failure in EXPERIMENTS[column].failures]


def predicted_error_rad(
    testbed: Testbed,
    candidate: Candidate,
    column: str,
    seed: int,
    duration_s: float,
    lead_in_s: float,
) -> Array | None:
    """Desired minus true (alpha, beta) of a run, (N, 2), by the linear model; None: unstable.

    It is driven by what drives the run: detector noise, floor, lock off centre, and the limit on
    the demanded pointing. Saturation of the amplifiers and quantization are left out.
    """
    rig, bench = candidate.rig(testbed, column, seed, duration_s), testbed.bench
    if pole_radius(open_loop(rig, rig.goal, faults_of(column))) > MARGINAL:
        return None
    rest, floor = round(lead_in_s / bench.control_period_s), rig.machine.floor_m_per_s2
    path = after_rest(rest, bench.spiral_rad(duration_s))
    return rig.predict(
        path,
        failures=EXPERIMENTS[column].failures,
        told=False,
        noise=detector_noise_rad(bench, seed, len(path)),
        start=rig.machine.start_m,
        floor_m_per_s2=None if floor is None else after_rest(rest, floor),
    ).error[rest:]


def offsets_m(*, quick: bool) -> Array:
    """Of the detector behind the focal plane; -1 m, at the telescope itself, is no telescope."""
    return np.linspace(-1.0, 1.0, 3 if quick else 41)


def beam_walk_urad(
    model: mujoco.MjModel,
    bench: TestbedConfig,
    loops: tuple[Loop, Loop],
    offset_m: float,
    seed: int,
) -> Array:
    """RMS errors of the linear loops, shape (4, 2, 2), [urad]; infinite where a loop is unstable.

    A thin lens of focal length f puts a ray of height h and slope theta at f theta + d (theta - h /
    f), d behind its focal plane. The factor f + d of the angle is calibrated away; what is left is
    an angle read for a translation t of the payload, of d t / f^2 but for that factor.

    Axes of the errors: COLUMNS; desired minus true, desired minus read; alpha, beta.
    """
    walk = offset_m / bench.focal_length_m**2
    reading = np.eye(6)[MAJOR]
    reading[:, 3:5] = walk * np.array([[0.0, -1.0], [1.0, 0.0]])
    time_s = bench.time_s(bench.duration_s)
    desired = bench.desired_rad(time_s)
    noise = detector_noise_rad(bench, seed, len(time_s))
    compensators = control.append(*(loop.discrete for loop in loops))
    errors = np.full((len(COLUMNS), 2, 2), np.inf)
    for k, name in enumerate(COLUMNS):
        gain, plant = gain_and_plant(model, name)
        L = sampled(linearize(plant.model, plant.data), gain, bench.control_period_s) * compensators
        closed = control.ss(
            L.A - L.B @ reading @ L.C, L.B, np.vstack([L.C[MAJOR], reading @ L.C]), 0, L.dt
        )
        if np.abs(closed.poles()).max() >= 1:
            continue
        outputs = control.forced_response(closed, time_s, (desired - noise).T).outputs
        true, read = np.split(np.asarray(outputs).T, 2, axis=1)
        errors[k] = 1e6 * np.array([rms(desired - true), rms(desired - read - noise)])
    return errors


def beam_walk(offset_m: Array, rms_urad: Array) -> dict[str, Any]:
    """How near offsets (K,) bring the ratios, from :func:`beam_walk_urad` there, (K, 4, 2, 2)."""
    ratio = rms_urad[:, -1] / rms_urad[:, 0]
    met = (np.abs(ratio / PAPER_RATIOS - 1) < RATIO_TOLERANCE).all(axis=-1)
    return {
        "offset_m": [offset_m.min(), offset_m.max()],
        "offsets": len(offset_m),
        "offsets_met": int(met.any(axis=-1).sum()),
        "largest_ratio_true": ratio[:, 0].max(axis=0).tolist(),
        "largest_ratio_detector": ratio[:, 1].max(axis=0).tolist(),
    }
