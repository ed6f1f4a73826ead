"""The constant Jacobian in closed loop as data: the `loop` of `jacobian.json`."""

from typing import Any

import numpy as np

from experiments.hexapod import paper
from experiments.hexapod.checks import CLOSURE_LIMIT_M
from experiments.hexapod.metrics import closure_residual_max_m, pointing_rms_urad, rms
from experiments.hexapod.scaling import GROWTHS, Growth
from experiments.hexapod.simulation import Trajectory
from experiments.hexapod.testbed import Bench
from experiments.jacobian.loop import AT_NOMINAL, GROWN, VARIANTS, Case, Outcome
from experiments.jacobian.loop_text import loop_paragraph
from experiments.jacobian.norms import NORMS
from experiments.jacobian.variation import variation
from sim import Array, hexapod, load_model

GEOMETRY_TOLERANCE = 0.15
"""How near the constant Jacobian must come to what geometry and floor together say."""
COSTS_PERCENT = (1.0, 10.0)
"""What a constant Jacobian is asked for: from where on does it cost this much?"""

Outcomes = dict[Case, Outcome]


def summarize_loop(outcomes: Outcomes, seed: int) -> dict[str, Any]:
    """All numbers of the closed-loop runs, ready for JSON; units are in the names."""
    geometry, run = hexapod(load_model()), next(iter(outcomes.values())).trajectory
    done = [growth for growth in GROWTHS if Case(GROWN, growth, "constant", seed) in outcomes]

    def in_the_box(stroke: float) -> dict[str, float]:
        return {n: variation(geometry, stroke * paper.STROKE_M, n).value for n in NORMS}

    growth = [_grown(outcomes, one, seed) | {"e_box": in_the_box(one.stroke)} for one in done]
    loop: dict[str, Any] = {
        "seed": seed,
        "duration_s": len(run.time_s) * Bench().control_period_s,
        "spiral_duration_s": Bench().duration_s,
        "runs": [_run(case, outcome) for case, outcome in outcomes.items()],
        "nominal": [_compared(outcomes, c, seed) for c in AT_NOMINAL if _has(outcomes, c, seed)],
        "growth": growth,
        # Beyond the longest stroke the spiral grows alone, and no box belongs to the size.
        "costs": [
            cost | {"e_box": in_the_box(factor) if factor <= done[-1].stroke else None}
            for cost in _costs(growth)
            for factor in [cost["spiral_factor"]]
        ],
    }
    return loop | {"paragraph": loop_paragraph(loop)}


def loop_complaint(loop: dict[str, Any]) -> str | None:
    """One sentence on what makes the runs unsound; None when nothing does."""
    for run in loop["runs"]:
        # A gap counts against the angles that are tracked: here they grow with the spiral.
        if not run["closure_residual_max_m"] < CLOSURE_LIMIT_M * run["spiral_factor"]:
            return f"in {run['name']} a loop opened by {run['closure_residual_max_m']:.1e} m"
    for one in loop["growth"]:
        static, seen = one["static_extra_percent"], one["variants"]["constant"]["extra_percent"]
        floor = one["variants"]["relinearized"]["extra_percent"]
        if abs(np.hypot(static, floor) - seen) > GEOMETRY_TOLERANCE * seen:
            return (
                f"at {one['name']} the constant Jacobian is {seen:.2g} % off the optimum, where "
                f"geometry and floor give {np.hypot(static, floor):.2g} %"
            )
    return None


def _has(outcomes: Outcomes, column: str, seed: int) -> bool:
    return Case(column, GROWTHS[0], "constant", seed) in outcomes


def _run(case: Case, outcome: Outcome) -> dict[str, Any]:
    run = outcome.trajectory
    alpha, beta = pointing_rms_urad(run)
    gamma, t_x, t_y, t_z = 1e6 * rms(run.secondary)
    return {
        "name": case.name,
        "column": case.column,
        "variant": case.variant,
        "seed": case.seed,
        "stroke_factor": case.growth.stroke,
        "spiral_factor": case.growth.spiral,
        "alpha_rms_urad": alpha,
        "beta_rms_urad": beta,
        "secondary_rms": {"gamma_urad": gamma, "t_x_um": t_x, "t_y_um": t_y, "t_z_um": t_z},
        "strut_input_rms_percent": rms(run.strut_input_percent).tolist(),
        "extra_percent": outcome.extra_percent,
        "static_extra_percent": outcome.static_extra_percent,
        "e_visited": dict(outcome.e_visited),
        "closure_residual_max_m": closure_residual_max_m(run),
        "data": f"{case.name}.npz" if case.is_recorded else None,
        "recording": f"{case.name}.rrd" if case.is_recorded else None,
    }


def _compared(outcomes: Outcomes, column: str, seed: int) -> dict[str, Any]:
    """Each variant against the analytic Jacobian, beside what another seed changes."""
    nominal = GROWTHS[0]
    analytic = outcomes[Case(column, nominal, "analytic", seed)].trajectory
    reseeded = outcomes[Case(column, nominal, "analytic", seed + 1)].trajectory
    others = {
        variant: _difference(outcomes[Case(column, nominal, variant, seed)].trajectory, analytic)
        for variant in VARIANTS
        if variant != "analytic"
    }
    return {"column": column, "noise": _difference(reseeded, analytic), "variants": others}


def _difference(one: Trajectory, other: Trajectory) -> dict[str, float]:
    pointing = np.abs(pointing_rms_urad(one) - pointing_rms_urad(other)).max()
    secondary = 1e6 * rms(one.secondary - other.secondary)
    return {
        "pointing_rms_urad": float(pointing),
        "gamma_rms_urad": float(secondary[0]),
        "translation_rms_um": float(secondary[1:].max()),
        "strut_input_rms_percent": float(
            rms(one.strut_input_percent - other.strut_input_percent).max()
        ),
    }


def _grown(outcomes: Outcomes, growth: Growth, seed: int) -> dict[str, Any]:
    runs = {variant: outcomes[Case(GROWN, growth, variant, seed)] for variant in VARIANTS}
    constant = runs["constant"]
    analytic_rms = pointing_rms_urad(runs["analytic"].trajectory)
    drift = runs["incremental"].trajectory.secondary - runs["relinearized"].trajectory.secondary
    return {
        "name": str(growth),
        "stroke_factor": growth.stroke,
        "spiral_factor": growth.spiral,
        "e_visited": dict(constant.e_visited),
        "loop_gain_error_percent": 100 * constant.loop_gain_error,
        "static_extra_percent": constant.static_extra_percent,
        "incremental_gamma_drift_urad": 1e6 * float(_last_turn(drift[:, 0])),
        "variants": {
            variant: {
                "extra_percent": outcome.extra_percent,
                "pointing_cost_percent": 100
                * float(_worst(pointing_rms_urad(outcome.trajectory) / analytic_rms - 1)),
            }
            for variant, outcome in runs.items()
        },
    }


def _last_turn(signal: Array) -> float:
    return float(signal[-round(Bench().spiral_period_s / Bench().control_period_s) :].mean())


def _worst(changes: Array) -> float:
    return float(changes[np.abs(changes).argmax()])


def _costs(growth: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Where the constant Jacobian begins to cost 1 % and 10 %, between the sizes that were run."""
    factor = np.array([one["spiral_factor"] for one in growth])
    visited = np.array([one["e_visited"]["frobenius"] for one in growth])
    found = []
    for what in ("static_extra_percent", "loop_gain_error_percent"):
        cost = np.array([one[what] for one in growth])
        for percent in COSTS_PERCENT:
            if cost[0] <= percent <= cost[-1]:
                share = np.interp(np.log(percent), np.log(cost), np.arange(len(cost)))
                found.append(
                    {
                        "cost": what,
                        "percent": percent,
                        "spiral_factor": _between(factor, share),
                        "e_visited_frobenius": _between(visited, share),
                    }
                )
    return found


def _between(values: Array, index: float) -> float:
    """Geometric interpolation at a fractional index."""
    return float(np.exp(np.interp(index, np.arange(len(values)), np.log(values))))
