"""The tables of the benchmark, from `bench.json`."""

from typing import Any

from experiments.hexapod.testbed import Bench
from experiments.output.findings import Table

TICK = {
    "mj_step": "physics alone: mj_step",
    "closed_loop": "closed loop",
    "closed_loop_constant": "closed loop, constant Jacobian",
    "tick": "general path: kinematics to apply",
    "hexapod_tick": "hexapod's closed form: Jacobian to apply",
    "mink": "mink: solve_ik",
    "mink_update": "mink: Configuration.update",
}
PARTS = {
    "sensors": "sensors",
    "estimate": "pose estimate",
    "mapping": "mapping",
    "jacobian": "  one Jacobian, in these two",
    "converter": "converter",
    "compensators": "compensators, by difference",
    "plant": "plant beyond mj_step, by difference",
    "rest": "log and the rest, by difference",
    "all": "all",
}
SOLVE = {
    "prioritized": "velocity_mapping and apply",
    "batched": "the same, in one batch",
    "daqp": "daqp, H given",
    "daqp_with_build": "daqp, H built",
    "daqp_hierarchy": "daqp, hierarchy, no weights",
    "placo": "PlaCo, problem given",
    "placo_with_build": "PlaCo, problem built",
    "pinv_formula": "eq. (25) with numpy's pinv",
    "dgglse": "LAPACK dgglse, A given",
}


def ratio_table(summary: dict[str, Any]) -> Table:
    """What counts, beside its bound and its goal."""
    ratios = summary["ratios"]
    rows = [
        (
            name,
            f"{one['ratio']:.3g}",
            f"{one['p5']:.3g} to {one['p95']:.3g}",
            *("" if one[limit] is None else f"{one[limit]:g}" for limit in ("bound", "goal")),
            _met(one),
        )
        for name, one in ratios.items()
    ]
    title = "Ratios of medians"
    if summary["simulated_s"] < Bench().duration_s:
        title += f", {summary['simulated_s']:g} s of the spiral only"
    means = "\n".join(f"- {name}: {one['means']}" for name, one in ratios.items())
    return Table(title, ("", "ratio", "5 to 95 %", "below", "goal", "met"), rows, means)


def _met(one: dict[str, Any]) -> str:
    if one["reaches_goal"]:
        return "goal"
    return {None: "", True: "bound", False: "no"}[one["within_bound"]]


def times_table(title: str, labels: dict[str, str], summary: dict[str, Any]) -> Table:
    """Medians of those that are labelled."""
    rows = [
        (label, _us(one["median_us"]), f"{_us(one['p5_us'])} to {_us(one['p95_us'])}")
        for label, one in ((label, summary["timings"][name]) for name, label in labels.items())
    ]
    return Table(title, ("", "median", "5 to 95 %"), rows)


def parts_table(parts_us: dict[str, float]) -> Table:
    """Where a tick's time goes."""
    whole = parts_us["all"]
    rows = [(PARTS[name], _us(us), f"{100 * us / whole:.0f}") for name, us in parts_us.items()]
    return Table(
        "What a control tick costs beside physics",
        ("", "us", "%"),
        rows,
        "Medians, each part timed alone and so with warm caches; what no public call does alone "
        "comes by difference. W_a, analytic Jacobian.",
    )


def growth_tables(growth: dict[str, Any]) -> list[Table]:
    """By number of actuators, and by size of the batch."""
    actuators, batch = growth["actuators"], growth["batch"]
    sizes = next(iter(actuators.values()))["size"]
    return [
        Table(
            "One Problem 1 by number of actuators, us",
            ("", *map(str, sizes), "power", "slopes"),
            [(name, *map(_us, one["median_us"]), *_law(one)) for name, one in actuators.items()],
            "Power: slope of the straight line that fits best in the logarithms; slopes: of the "
            "flattest and the steepest piece between neighbouring sizes.",
        ),
        Table(
            "One mapping by size of the batch, us",
            ("", *(f"{size:,}" for size in batch["size"]), "power", "slopes"),
            [("batched", *map(_us, batch["median_us"]), *_law(batch))],
            "The power is that of the whole call.",
        ),
    ]


def _law(one: dict[str, Any]) -> tuple[str, str]:
    flattest, steepest = (round(one[key], 1) + 0.0 for key in ("least", "most"))  # no -0.0
    return f"{one['exponent']:.2f}", f"{flattest}, {steepest}"


def changes_table(comparison: dict[str, Any]) -> Table:
    """Beside an earlier run."""
    rows = [
        (
            name,
            _us(one["saved"]),
            _us(one["now"]),
            f"{one['now_over_saved']:.2f}",
            "changed" if one["changed"] else "",
        )
        for kind in ("ratios", "timings")
        for name, one in comparison[kind].items()
    ]
    return Table(
        "Beside the saved run",
        ("", "saved", "now", "now / saved", ""),
        rows,
        "Ratios, then medians in us; changed: the ranges from 5 to 95 % have nothing in common.",
    )


def _us(value: float) -> str:
    """Three digits: a time deserves no more."""
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"
