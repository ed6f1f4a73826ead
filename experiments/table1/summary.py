"""Table I as data: the contents of `table1.json`."""

from dataclasses import asdict
from typing import Any

import numpy as np

from experiments.hexapod import paper
from experiments.hexapod.choices import JacobianChoice
from experiments.hexapod.columns import COLUMNS, Column
from experiments.hexapod.metrics import (
    closure_residual_max_m,
    loop_measures,
    pointing_rms_urad,
    rms,
)
from experiments.output.provenance import versions
from experiments.table1.study import Table1, other_jacobian
from sim import Array


def summarize(table: Table1) -> dict[str, Any]:
    """All numbers of the table, ready for JSON; units are in the names."""
    return {
        "experiment": "table1",
        "seed": table.seed,
        "versions": versions(),
        "model_sha256": table.model_sha256,
        "jacobian": table.jacobian,
        "duration_s": _duration_s(table),
        "configuration": table.configuration.name,
        "fit": table.configuration.fit,
        "bench": asdict(table.configuration.bench) | table.plant_constants,
        "loops": {
            "alpha": loop_measures(table.loops[0]),
            "beta": loop_measures(table.loops[1]),
        },
        "jacobian_comparison": compare_jacobians(table),
        "columns": [_column(table, column) for column in COLUMNS],
    }


def compare_jacobians(table: Table1) -> dict[str, Any]:
    """How far the RMS values move with the other Jacobian, beside what another seed moves them."""
    by_column = {
        name: pointing_rms_urad(run) - pointing_rms_urad(table.trajectories[name])
        for name, run in table.other.items()
    }
    by_jacobian = float(np.abs(list(by_column.values())).max())
    seeds = pointing_rms_urad(table.reseeded) - pointing_rms_urad(table.trajectories["W_a"])
    by_seed = float(np.abs(seeds).max())
    other: JacobianChoice = other_jacobian(table.jacobian)
    verdict = "below" if by_jacobian < by_seed else "above"
    return {
        "other": other,
        "largest_rms_difference_urad": by_jacobian,
        "next_seed_rms_difference_urad": by_seed,
        "next_seed_closure_residual_max_m": closure_residual_max_m(table.reseeded),
        "sentence": (
            f"With the {other} Jacobian no RMS moves by more than {by_jacobian:.1e} urad, which is "
            f"{verdict} the noise: another seed moves W_a by {by_seed:.1e} urad."
        ),
    }


def _column(table: Table1, column: Column) -> dict[str, Any]:
    run = table.trajectories[column.name]
    alpha, beta = pointing_rms_urad(run)
    alpha_measured, beta_measured = 1e6 * rms(run.desired_rad - run.measured_rad)
    alpha_paper, beta_paper = paper.TABLE_I_URAD[column.name]
    alpha_predicted, beta_predicted = 1e6 * table.predicted_rad[column.name]
    alpha_other, beta_other = pointing_rms_urad(table.other[column.name])
    return {
        "name": column.name,
        "locked": column.struts("locked"),
        "free": column.struts("free"),
        "joint_weight": column.goal.joint_weight,
        "secondary_weight_t_x_t_y_t_z_gamma": column.goal.secondary_weight,
        "origin": table.configuration.origin(column.name),
        "alpha_rms_urad": alpha,
        "beta_rms_urad": beta,
        "alpha_measured_rms_urad": alpha_measured,
        "beta_measured_rms_urad": beta_measured,
        "paper_alpha_rms_urad": alpha_paper,
        "paper_beta_rms_urad": beta_paper,
        "predicted_alpha_rms_urad": alpha_predicted,
        "predicted_beta_rms_urad": beta_predicted,
        "other_jacobian_alpha_rms_urad": alpha_other,
        "other_jacobian_beta_rms_urad": beta_other,
        "strut_input_rms_percent": rms(run.strut_input_percent).tolist(),
        "strut_input_peak_percent": np.abs(run.strut_input_percent).max(0).tolist(),
        "secondary_peak": _peaks(run.secondary),
        "secondary_peak_estimated": _peaks(run.secondary_estimated),
        "closure_residual_max_m": closure_residual_max_m(run),
        "other_jacobian_closure_residual_max_m": closure_residual_max_m(table.other[column.name]),
        "recording": f"{column.name}.rrd",
        "data": f"{column.name}.npz",
    }


def _peaks(secondary: Array) -> dict[str, float]:
    names = ("gamma_urad", "t_x_um", "t_y_um", "t_z_um")
    return dict(zip(names, (1e6 * np.abs(secondary).max(0)).tolist(), strict=True))


def _duration_s(table: Table1) -> float:
    return len(table.trajectories["W_a"].time_s) * table.configuration.bench.control_period_s
