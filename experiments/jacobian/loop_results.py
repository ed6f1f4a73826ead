"""The constant Jacobian in closed loop: the `loop` of `jacobian.json`, its checks and tables."""

from typing import Any

import numpy as np

from argument_checks.ties import greatest
from experiments.jacobian.loop import AT_NOMINAL, GROWN, GROWTHS, VARIANTS, Growth, LoopRun, Tracked
from experiments.jacobian.variation import NORMS, ByNorm, variation
from experiments.rig.checks import CLOSURE_LIMIT_M
from experiments.rig.hexapod import paper
from experiments.rig.hexapod.columns import secondary
from experiments.rig.hexapod.testbed import TestbedConfig
from experiments.rig.run import rms
from experiments.study.results import Check
from experiments.study.tables import Column, Table, tabulate
from sim import hexapod, load_model

GEOMETRY_TOLERANCE = 0.15
"""How near the constant Jacobian must come to what geometry and floor together say."""
COSTS = {"static_extra_percent": "goal", "loop_gain_error_percent": "loop gain"}
"""Errors caused by a constant Jacobian, and their names."""
COSTS_PERCENT = (1.0, 10.0)
"""Errors whose size of spiral is interpolated, in percent."""

Loops = dict[LoopRun, Tracked]


def summarize_loop(runs: Loops, seed: int) -> dict[str, Any]:
    """All numbers of the closed-loop runs, ready for JSON; units are in the names."""
    geometry, ticks = hexapod(load_model()), len(next(iter(runs.values())).run.time_s)
    done = [growth for growth in GROWTHS if LoopRun(GROWN, growth, "constant", seed) in runs]
    columns = [c for c in AT_NOMINAL if LoopRun(c, GROWTHS[0], "constant", seed) in runs]

    def in_the_box(stroke: float) -> ByNorm:
        return {n: variation(geometry, stroke * paper.STROKE_M, n).value for n in NORMS}

    growth = [_grown(runs, one, seed) | {"e_box": in_the_box(one.stroke)} for one in done]
    loop: dict[str, Any] = {
        "seed": seed,
        "duration_s": ticks * TestbedConfig().control_period_s,
        "spiral_duration_s": TestbedConfig().duration_s,
        "runs": [_run(run, tracked) for run, tracked in runs.items()],
        "nominal": [_compared(runs, column, seed) for column in columns],
        "growth": growth,
        # Beyond the longest stroke the spiral grows alone, and no box belongs to the size.
        "costs": [
            cost | {"e_box": in_the_box(factor) if factor <= done[-1].stroke else None}
            for cost in _costs(growth)
            for factor in [cost["spiral_factor"]]
        ],
    }
    return loop | {"paragraph": _paragraph(loop)}


def loop_checks(loop: dict[str, Any]) -> list[Check]:
    """Checks: closure residuals, and the constant Jacobian's error against geometry and floor."""
    # A gap counts against the angles that are tracked: here they grow with the spiral.
    found = []
    for run in loop["runs"]:
        gap_m, limit_m = run["closure_residual_max_m"], CLOSURE_LIMIT_M * run["spiral_factor"]
        found.append(Check("closure residual [m]", run["name"], gap_m, limit_m))
    for one in loop["growth"]:
        extra = {name: variant["extra_percent"] for name, variant in one["variants"].items()}
        expected = np.hypot(one["static_extra_percent"], extra["relinearized"])
        what = (
            f"relative difference between the constant Jacobian's simulated deviation from the "
            f"optimum, {extra['constant']:.2g} %, and the {expected:.2g} % of geometry and floor"
        )
        off = float(abs(expected - extra["constant"]) / extra["constant"])
        found.append(Check(what, one["name"], off, GEOMETRY_TOLERANCE))
    return found


def loop_table(loop: dict[str, Any]) -> Table:
    """One row for each size of the spiral."""
    headings = ("const.", "analyt.", "increm.", "relin.")
    columns = (
        Column("", lambda one: f"x{one['spiral_factor']:g}"),
        Column("e", lambda one: one["e_visited"]["frobenius"], ".1e"),
        Column("geometry", "static_extra_percent", ".2f"),
        *(
            Column(heading, lambda one, key=key: one["variants"][key]["extra_percent"], ".2f")
            for heading, key in zip(headings, VARIANTS, strict=True)
        ),
        Column("loop gain", "loop_gain_error_percent", ".2f"),
    )
    return tabulate(
        "Closed loop, strut 1 locked: deviation of the secondary goal from its optimum, and error "
        "of the loop gain, %",
        columns,
        loop["growth"],
        "First column: size of the spiral over the paper's. e: eq. (40) over the lengths visited. "
        "geometry: expected for a constant Jacobian without dynamics. const. to relin.: simulated "
        "with each form of the mapping.",
    )


def _run(run: LoopRun, tracked: Tracked) -> dict[str, Any]:
    done = tracked.run
    alpha, beta = 1e6 * done.rms()
    gamma, t_x, t_y, t_z = 1e6 * rms(secondary(done))
    return {
        "name": run.name,
        "column": run.column,
        "variant": run.variant,
        "seed": run.seed,
        "stroke_factor": run.growth.stroke,
        "spiral_factor": run.growth.spiral,
        "alpha_rms_urad": alpha,
        "beta_rms_urad": beta,
        "secondary_rms": {"gamma_urad": gamma, "t_x_um": t_x, "t_y_um": t_y, "t_z_um": t_z},
        "strut_input_rms_percent": rms(done.inputs).tolist(),
        "extra_percent": tracked.extra_percent,
        "static_extra_percent": tracked.static_extra_percent,
        "e_visited": dict(tracked.e_visited),
        "closure_residual_max_m": done.closure_max_m,
        "data": f"{run.name}.npz" if run.is_recorded else None,
        "recording": f"{run.name}.rrd" if run.is_recorded else None,
    }


def _compared(runs: Loops, column: str, seed: int) -> dict[str, Any]:
    """Each variant against the analytic Jacobian, beside what another seed changes."""

    def difference(variant: str, seed: int) -> dict[str, float]:
        one = runs[LoopRun(column, GROWTHS[0], variant, seed)].run
        pointing = np.abs(1e6 * (one.rms() - analytic.rms())).max()
        moved = 1e6 * rms(secondary(one) - secondary(analytic))
        inputs = rms(one.inputs - analytic.inputs)
        return {
            "pointing_rms_urad": float(pointing),
            "gamma_rms_urad": float(moved[0]),
            "translation_rms_um": float(moved[1:].max()),
            "strut_input_rms_percent": float(inputs.max()),
        }

    analytic = runs[LoopRun(column, GROWTHS[0], "analytic", seed)].run
    others = {variant: difference(variant, seed) for variant in VARIANTS if variant != "analytic"}
    return {"column": column, "noise": difference("analytic", seed + 1), "variants": others}


def _grown(runs: Loops, growth: Growth, seed: int) -> dict[str, Any]:
    ours = {variant: runs[LoopRun(GROWN, growth, variant, seed)] for variant in VARIANTS}
    motion = {variant: secondary(tracked.run) for variant, tracked in ours.items()}
    drift = (motion["incremental"] - motion["relinearized"])[:, 0]
    last_turn = slice(
        -round(TestbedConfig().spiral_period_s / TestbedConfig().control_period_s), None
    )
    analytic_urad = 1e6 * ours["analytic"].run.rms()

    def costs(tracked: Tracked) -> dict[str, float]:
        changes = 1e6 * tracked.run.rms() / analytic_urad - 1
        largest = float(changes[greatest(np.abs(changes))])
        return {"extra_percent": tracked.extra_percent, "pointing_cost_percent": 100 * largest}

    return {
        "name": str(growth),
        "stroke_factor": growth.stroke,
        "spiral_factor": growth.spiral,
        "e_visited": dict(ours["constant"].e_visited),
        "loop_gain_error_percent": 100 * ours["constant"].loop_gain_error,
        "static_extra_percent": ours["constant"].static_extra_percent,
        "incremental_gamma_drift_urad": 1e6 * float(drift[last_turn].mean()),
        "variants": {variant: costs(tracked) for variant, tracked in ours.items()},
    }


def _costs(growth: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Where the constant Jacobian begins to cost 1 % and 10 %, between the sizes that were run."""
    places, found = np.arange(len(growth)), []
    sizes = {
        "spiral_factor": [one["spiral_factor"] for one in growth],
        "e_visited_frobenius": [one["e_visited"]["frobenius"] for one in growth],
    }
    for what in COSTS:
        cost = np.array([one[what] for one in growth])
        for percent in COSTS_PERCENT:
            if cost[0] <= percent <= cost[-1]:
                place = np.interp(np.log(percent), np.log(cost), places)
                there = {
                    key: float(np.exp(np.interp(place, places, np.log(values))))
                    for key, values in sizes.items()
                }
                found.append({"cost": what, "percent": percent} | there)
    return found


_QUANTITIES = {
    "pointing_rms_urad": "pointing",
    "gamma_rms_urad": "gamma",
    "translation_rms_um": "translation",
    "strut_input_rms_percent": "strut inputs",
}


def _paragraph(loop: dict[str, Any]) -> str:
    """The answer in one paragraph, to be cited."""
    growth = loop["growth"]
    first, last = growth[0], growth[-1]
    extra = {name: one["extra_percent"] for name, one in last["variants"].items()}
    pointing = {name: one["pointing_cost_percent"] for name, one in last["variants"].items()}

    def more_than_noise(variant: str) -> str:
        above = [
            f"{words} of {one['column']}"
            for what, words in _QUANTITIES.items()
            for one in loop["nominal"]
            if not one["variants"][variant][what] < one["noise"][what]
        ]
        return ", ".join(above) or "nothing"

    def per_e(cost: str) -> str:
        ratios = [one[cost] / (100 * one["e_visited"]["frobenius"]) for one in growth]
        return f"{min(ratios):.1f} to {max(ratios):.1f}"

    where = ", ".join(
        f"{cost['percent']:g} % of the {COSTS[cost['cost']]} at e = "
        f"{cost['e_visited_frobenius']:.1e} (spiral x{cost['spiral_factor']:.0f})"
        for cost in loop["costs"]
    )
    part = "Part of the spiral only, not to be compared with the whole. "
    return (part if loop["duration_s"] < loop["spiral_duration_s"] else "") + (
        f"Tracking {loop['duration_s']:g} s of the spiral with strut 1 locked ({GROWN}, seed "
        f"{loop['seed']}) visits strut lengths up to e = {first['e_visited']['frobenius']:.1e}; "
        f"over the whole stroke e is {first['e_box']['frobenius']:.1e} (Frobenius). Compared with "
        f"a Jacobian re-evaluated at every tick, a constant one changes "
        f"{more_than_noise('constant')} by more than another noise seed does, and increments "
        f"change {more_than_noise('incremental')} by more. With a larger spiral and stroke, "
        f"geometry alone gives a deviation of the secondary goal from its optimum of "
        f"{per_e('static_extra_percent')} e with a constant Jacobian, and an error of the loop "
        f"gain of {per_e('loop_gain_error_percent')} e: {where}. The simulation resolves this "
        f"above the {first['variants']['constant']['extra_percent']:.1f} % that converters, noise "
        f"and dynamics cause at nominal size. With a spiral {last['spiral_factor']:g} times as "
        f"large the deviation is {extra['constant']:.0f} % with the constant Jacobian, "
        f"{extra['analytic']:.0f} % with the re-evaluated Jacobian on absolute displacements, "
        f"{extra['incremental']:.0f} % on increments, and {extra['relinearized']:.1f} % with one "
        f"Gauss-Newton step per tick. The pointing RMS, relative to the re-evaluated Jacobian on "
        f"absolute displacements, changes by {pointing['constant']:+.1f} % (constant), "
        f"{pointing['incremental']:+.1f} % (increments) and {pointing['relinearized']:+.1f} % "
        f"(Gauss-Newton)."
    )
