"""One case simulated and foretold: a row of numbers and words."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from experiments.hexapod.goal import MAJOR
from experiments.hexapod.mapping import StrutMapping
from experiments.hexapod.metrics import closure_residual_max_m, pointing_rms_urad, rms
from experiments.hexapod.prediction import detector_noise_rad, driven_loop
from experiments.hexapod.simulation import Trajectory, track_spiral
from experiments.sweep.case import Case
from experiments.sweep.machine import loops, machine, stiffness
from sim import NOMINAL, Array, ModelError, SimulationDiverged, failed_plant, hexapod

Row = dict[str, Any]

MARGINAL = 1 + 1e-9
"""A largest pole up to here is an integrator that the mapping lets move nothing."""


@dataclass(frozen=True)
class Foretold:
    """What the linear model says of a case.

    Attributes:
        pole_radius: Largest pole of the sampled loop.
        rms_urad: Of desired minus true (alpha, beta), (2,); None: the loop is unstable.
    """

    pole_radius: float
    rms_urad: Array | None


def run_case(case: Case) -> Row:
    """Fly one case.

    Returns:
        Its parameters, how it ended as `status`, and what was measured, so far as there is any:

        - "exact": it ran to the end, the mapping meeting the pointing task exactly.
        - "least_squares", "self_motion": it ran to the end, but part of the pointing task is out
          of the mapping's reach; or free to move.
        - "unstable": the same, but the linear model's loop is not stable.
        - "diverged": the physics left the finite numbers.
        - "refused": the loops cannot be closed on this bench, or physics not stepped at its rate.
    """
    row = case.parameters()
    try:
        mapping = _mapping(case)
        foretold = _foretold(case, mapping)
        status = mapping.at(mapping.geometry.inverse_jacobian(NOMINAL)).mapping.status
        row |= _predicted(foretold) | {"status": status.name.lower()}
        row["dac_step_urad"] = _dac_step_urad(case, mapping)
        if foretold and foretold.rms_urad is None:
            row["status"] = "unstable"
        return row | _measured(_fly(case))
    except SimulationDiverged as diverged:
        return row | {
            "status": "diverged",
            "message": str(diverged),
            "diverged_at_s": diverged.time_s,
        }
    except ModelError as refused:
        return row | {"status": "refused", "message": str(refused)}


def _mapping(case: Case) -> StrutMapping:
    """As it is after the failure, at J_0."""
    return StrutMapping(hexapod(machine()), case.reconfigured, "constant", stiffness())


def _fly(case: Case) -> Trajectory:
    from_start = case.failure_time_s == 0
    return track_spiral(
        machine(),
        case.bench,
        loops(case.bench),
        case.reconfigured if from_start else case.goal,
        failures=case.failures,
        reconfigured=case.reconfigured if case.known and not from_start else None,
        stiffness=stiffness(),
        jacobian=case.jacobian,
        seed=case.seed,
        duration_s=case.duration_s,
    )


def _foretold(case: Case, mapping: StrutMapping) -> Foretold | None:
    """None where the linear model is not of the plant as it runs.

    That is where it changes in flight, or falls on a stop, which a strut without its spring does.
    """
    failures, bench = case.failures, case.bench
    if any(failure.time_s > 0 or failure.kind == "loose" for failure in failures):
        return None
    plant = failed_plant(machine(), failures)
    compensators = [loop.discrete for loop in loops(bench)]
    T = driven_loop(plant, mapping.pointing_gain(), compensators)
    radius = float(np.abs(T.poles()).max())
    if radius > MARGINAL:
        return Foretold(radius, None)
    time_s = bench.time_s(case.duration_s)
    desired = bench.desired_rad(time_s)
    driven = desired - detector_noise_rad(bench, case.seed, len(time_s))
    pointing = T[MAJOR, MAJOR]  # a floor at rest, and nothing beside the compensators
    true = _response(pointing.A, pointing.B, pointing.C, pointing.D, driven)
    return Foretold(radius, 1e6 * rms(desired - true))


def _response(A: Array, B: Array, C: Array, D: Array, driven: Array) -> Array:
    """Output of a sampled system from rest, (N, 2)."""
    state, outputs = np.zeros(len(A)), []
    for u in driven:
        outputs.append(C @ state + D @ u)
        state = A @ state + B @ u
    return np.array(outputs)


def _dac_step_urad(case: Case, mapping: StrutMapping) -> float:
    """What one step of one strut's converter moves the pointing: less, the loops cannot command."""
    amplifier = case.bench.amplifier(newton_per_m=float(machine().actuator_gainprm[0, 0]))
    step_m = amplifier.displacement_m(np.eye(6) * 100 / 2 ** (case.bench.dac_bits - 1))
    steps_rad = [mapping.pointing(strut_m, NOMINAL) for strut_m in step_m]
    return 1e6 * float(np.linalg.norm(steps_rad, axis=1).max())


def _predicted(foretold: Foretold | None) -> Row:
    if foretold is None:
        return {}
    row: Row = {"predicted_pole_radius": foretold.pole_radius}
    if foretold.rms_urad is not None:
        alpha, beta = foretold.rms_urad.tolist()
        row |= {"predicted_alpha_rms_urad": alpha, "predicted_beta_rms_urad": beta}
    return row


def _measured(run: Trajectory) -> Row:
    error_urad = 1e6 * (run.desired_rad - run.true_rad)
    measured_urad = 1e6 * (run.desired_rad - run.measured_rad)
    columns = [
        (("alpha_rms_urad", "beta_rms_urad"), pointing_rms_urad(run)),
        (("alpha_peak_urad", "beta_peak_urad"), np.abs(error_urad).max(0)),
        (("alpha_measured_rms_urad", "beta_measured_rms_urad"), rms(measured_urad)),
        (INPUT_RMS, rms(run.strut_input_percent)),
        (INPUT_PEAK, np.abs(run.strut_input_percent).max(0)),
        (SECONDARY_PEAK, 1e6 * np.abs(run.secondary).max(0)),
        (("closure_residual_max_m",), np.array([closure_residual_max_m(run)])),
    ]
    return {
        name: value
        for names, values in columns
        for name, value in zip(names, values.tolist(), strict=True)
    }


INPUT_RMS = tuple(f"strut_input_rms_percent_{k}" for k in range(1, 7))
INPUT_PEAK = tuple(f"strut_input_peak_percent_{k}" for k in range(1, 7))
SECONDARY_PEAK = ("gamma_peak_urad", "t_x_peak_um", "t_y_peak_um", "t_z_peak_um")
