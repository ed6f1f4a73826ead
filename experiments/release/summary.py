"""The release experiment as data: the contents of `release.json`, and whether to believe it."""

from dataclasses import asdict
from typing import Any

import mujoco
import numpy as np

from experiments.hexapod.checks import CLOSURE_LIMIT_M, off_prediction, prediction_tolerance
from experiments.hexapod.metrics import percent, pointing_rms_urad
from experiments.hexapod.provenance import plant_constants
from experiments.hexapod.simulation import Trajectory
from experiments.hexapod.testbed import Bench
from experiments.output.provenance import versions
from experiments.release.study import Case, Release
from prioritized import Classes, FailureAtlas
from sim import Array, load_model, model_sha256, weightless

MISMATCH_LIMIT_PERCENT = 1.0
"""Largest distance of simulated from predicted motion."""


def summarize(release: Release, seed: int) -> dict[str, Any]:
    """All numbers of the experiment, ready for JSON; units are in the names."""
    model: mujoco.MjModel = load_model()
    run = release.trajectories["sound"]
    orbit = plant_constants(weightless(model))
    return {
        "experiment": "release",
        "seed": seed,
        "versions": versions(),
        "model_sha256": model_sha256(),
        "jacobian": "constant",
        "duration_s": len(run.time_s) * Bench().control_period_s,
        "bench": asdict(Bench()) | plant_constants(model),
        "spirals": [_spiral(release, case, orbit) for case in release.cases],
        "sweep": release.sweep,
        "on_the_ground_without_spring": release.fall,
        "atlas": _atlas(release.atlas),
    }


def complaint(summary: dict[str, Any]) -> str | None:
    """One sentence on what makes the experiment unsound; None when nothing does."""
    tolerance = prediction_tolerance(summary["duration_s"])
    for spiral in summary["spirals"]:
        if not spiral["closure_residual_max_m"] < CLOSURE_LIMIT_M:
            return f"in {spiral['name']} a loop opened by {spiral['closure_residual_max_m']:.1e} m"
        off = spiral["motion_mismatch_linear_model_percent"]
        if spiral["kind"] and not off < MISMATCH_LIMIT_PERCENT:
            return f"the motion of {spiral['name']} is {off:.2g} % off the linear model"
        if sentence := off_prediction(spiral, tolerance):
            return sentence
    for point in summary["sweep"]:
        ratio = f"at a stiffness ratio of {point['suspension_over_swing']:g}"
        for name in ("elastic", "linear_model"):
            if not (off := point[f"mismatch_{name}_percent"]) < MISMATCH_LIMIT_PERCENT:
                return f"{ratio} the {name.replace('_', ' ')} is {off:.2g} % off"
        if not abs(point["alpha_corrected_urad"] / 100 - 1) < MISMATCH_LIMIT_PERCENT / 100:
            return f"{ratio} the mapping points at {point['alpha_corrected_urad']:.2f} of 100 urad"
    fall = summary["on_the_ground_without_spring"]
    if not abs(fall["strut_1_um"] / fall["stop_um"] - 1) < MISMATCH_LIMIT_PERCENT / 100:
        return (
            f"the strut without its spring stands at {fall['strut_1_um']:.1f} um, not at its stop"
        )
    return None


def twist(run: Trajectory) -> Array:
    """True payload motion [alpha, beta, gamma, t_x, t_y, t_z], shape (N, 6)."""
    return np.hstack([run.true_rad, run.secondary])


def _spiral(release: Release, case: Case, orbit: dict[str, Any]) -> dict[str, Any]:
    run = release.trajectories[case.name]
    alpha, beta = pointing_rms_urad(run)
    alpha_peak, beta_peak = 1e6 * np.abs(run.desired_rad - run.true_rad).max(axis=0)
    predicted = release.predicted_rad.get(case.name)
    true = twist(run)
    return {
        "name": case.name,
        "kind": case.kind,
        "failure_time_s": case.time_s if case.kind else None,
        "told": case.told,
        "plant": orbit if case.kind == "loose" else {},
        "alpha_rms_urad": alpha,
        "beta_rms_urad": beta,
        "predicted_alpha_rms_urad": None if predicted is None else 1e6 * predicted[0],
        "predicted_beta_rms_urad": None if predicted is None else 1e6 * predicted[1],
        "alpha_peak_urad": alpha_peak,
        "beta_peak_urad": beta_peak,
        "sensitivity_peak": release.sensitivity[case.name],
        "motion_mismatch_linear_model_percent": percent(true - release.linear[case.name], true),
        "motion_mismatch_quasi_static_percent": percent(
            true - release.quasi_static[case.name], true
        ),
        "strut_1_peak_um": 1e6 * float(np.abs(run.strut_displacement_m[:, 0]).max()),
        "closure_residual_max_m": float(run.closure_residual_m.max()),
        "recording": f"{case.name}.rrd",
        "data": f"{case.name}.npz",
    }


def _atlas(atlas: FailureAtlas) -> dict[str, Any]:
    assert atlas.elastic is not None  # the hexapod has springs
    singles = []
    for strut in range(6):
        for kind in ("locked", "free"):
            row = atlas.row(**{kind: [strut]})
            singles.append(
                {
                    "strut": strut + 1,
                    "kind": kind,
                    "rigid": _verdict(atlas, row),
                    "elastic": _verdict(atlas.elastic, row),
                }
            )
    return {
        "conditions": len(atlas.codes),
        "possible_rigid": int(atlas.possible.sum()),
        "possible_elastic": int(atlas.elastic.possible.sum()),
        "smallest_gap": float(min(atlas.gap.min(), atlas.elastic.gap.min())),
        "single_failures": singles,
    }


def _verdict(classes: Classes, row: int) -> dict[str, Any]:
    lost = classes.lost_secondary[row]
    return {
        "possible": bool(classes.possible[row]),
        "worst_gain_rad_per_m": float(classes.worst_gain[row]),
        "unstable_major": bool(classes.unstable_major[row]),
        "lost_gamma_t_x_t_y_t_z": lost[:, np.abs(lost).any(axis=0)].T.tolist(),
    }
