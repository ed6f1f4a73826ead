"""The tables of `fjh bench`, and the sentences below them."""

from typing import Any

from experiments.benchmark import ratios
from experiments.benchmark.runs import PACKAGES
from experiments.rig.hexapod.testbed import TestbedConfig
from experiments.study.tables import Column, Table, tabulate

TICK = {
    "mj_step": "physics alone: mj_step",
    "closed_loop": "closed loop",
    "closed_loop_constant": "closed loop, constant Jacobian",
    "tick": "general path: kinematics to apply",
    "hexapod_tick": "hexapod's closed form: Jacobian to apply",
    "mink": "mink: solve_ik",
    "mink_update": "mink: Configuration.update",
    "diagnosis": "diagnosis: Monitor.step",
}
ROBOTS = {
    "arm_tick": "arm: general path",
    "arm_mink": "  mink: solve_ik, arm",
    "arm_mink_update": "  mink: Configuration.update, arm",
    "humanoid_tick": "humanoid: general path",
    "humanoid_mink": "  mink: solve_ik, humanoid",
    "humanoid_mink_update": "  mink: Configuration.update, humanoid",
}
LATENCY = {
    "controller": "hexapod's controller",
    "tick": "general path",
}
COLLECTOR = {
    "on": "collector on",
    "frozen": "gc.freeze()",
    "off": "gc.freeze() and gc.disable()",
}
_ROUND_OFF = 1e-12
"""Part of a number; smaller ones are not printed, because they depend on the processor."""

PARTS = {
    "sensors": "sensors",
    "estimate": "pose estimate",
    "mapping": "mapping",
    "jacobian": "  one Jacobian, included in both",
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
    "daqp_hierarchy": "daqp, hierarchy without H: unit rows",
    "placo": "PlaCo, problem given",
    "placo_with_build": "PlaCo, problem built",
    "pinv_formula": "eq. (25) with numpy's pinv",
    "dgglse": "LAPACK dgglse, A given",
}
LIMITED = {
    "limited": "Problem 1: velocity_mapping and apply",
    "daqp_limited": "  daqp, H given",
    "daqp_limited_with_build": "  daqp, H built",
    "hierarchy3": "three levels: lexicographic_least_squares",
    "daqp_hierarchy3": "  daqp with break_points, H given",
    "daqp_hierarchy3_with_build": "  the same, H built",
}


def tables(summary: dict[str, Any]) -> list[Table]:
    """Tables of the ratios and of the times they are made of."""
    seconds, timings = summary["simulated_s"], summary["timings"]
    at_limits = {name: _at_limit(name, one) for name, one in summary["active_limits"].items()}
    with_limits = " ".join(at_limits.pop(name) for name in list(at_limits) if "tick" in name)
    part = f", {seconds:g} s of the spiral only" if seconds < TestbedConfig().duration_s else ""
    found = [
        ratios.table(summary["ratios"], f"Ratios of medians{part}"),
        _times("One control tick, us", TICK, timings),
        _tick_parts(summary["tick_parts_us"]),
        _times(
            "One control tick with velocity limits, us",
            ROBOTS,
            timings,
            f"{with_limits} Limits of -1 and 1 rad/s; all results agree to 1e-6.",
        ),
        _latency(summary["latency"]),
        _times("One Problem 1, hexapod's size, us", SOLVE, timings),
        _times(
            "Problems with limits, us",
            LIMITED,
            timings,
            f"{' '.join(at_limits.values())} Six rates; limits of -1 and 1; all results agree to "
            "1e-9.",
        ),
        _out_of_reach(summary["out_of_reach"]),
        _growth(
            "One Problem 1 by number of actuators, us",
            summary["growth"]["actuators"],
            "power: slope of the best-fitting line in the logarithms. slopes: smallest and largest "
            "slope between neighbouring sizes.",
        ),
        _growth(
            "One mapping by size of the batch, us",
            {"batched": summary["growth"]["batch"]},
            "power: of the time of the whole call.",
        ),
    ]
    return [*found, _changes(summary["comparison"])] if "comparison" in summary else found


def _us(value: float) -> str:
    """The time with three digits."""
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"


def _times(title: str, labels: dict[str, str], timings: dict[str, Any], legend: str = "") -> Table:
    columns = (
        Column("", "label"),
        Column("median", lambda one: _us(one["median_us"])),
        Column("5 to 95 %", lambda one: f"{_us(one['p5_us'])} to {_us(one['p95_us'])}"),
    )
    entries = [{"label": label} | timings[name] for name, label in labels.items()]
    return tabulate(title, columns, entries, legend)


def _at_limit(question: str, counts: list[int]) -> str:
    """How many limits bind; `counts` are the problems with 0, 1, ... rates at a limit."""
    return (
        f"{question}: {sum(counts[1:])} of {sum(counts)} problems have rates at a limit, "
        f"{sum(k * count for k, count in enumerate(counts))} rates in all."
    )


def _latency(latency: dict[str, Any]) -> Table:
    columns = (
        Column("", "label"),
        Column("median", lambda one: _us(one["median_us"])),
        Column("99.9 %", lambda one: _us(one["p999_us"])),
        Column("worst", lambda one: _us(one["worst_us"])),
        Column("worst, processor", lambda one: _us(one["worst_processor_us"])),
    )
    entries = [
        {"label": f"{LATENCY[name]}, {COLLECTOR[setting]}"} | one
        for name, settings in latency["of"].items()
        for setting, one in settings.items()
    ]
    return tabulate(
        "Latency of single ticks in wall time, us",
        columns,
        entries,
        f"{latency['ticks']:,} ticks each, one after another. worst, processor: without the time "
        "in which other processes had the processor. Hexapod's controller: "
        "PrioritizedController.step with recorded measurements. General path: as above.",
    )


def _out_of_reach(found: dict[str, Any]) -> Table:
    def number(key: str, of: str) -> Column:
        return Column(f"{key}, {of}", lambda one: _above_round_off(one[key][of]))

    columns = [Column("", "name")]
    columns += [number(key, of) for key in ("change", "excess") for of in ("median", "largest")]
    factors = ", ".join(f"{factor:g}" for factor in found["weight_factors"])
    return tabulate(
        "Major residual where limits hold the major task back",
        columns,
        [{"name": name} | one for name, one in found["solvers"].items()],
        f"{found['problems']} random problems whose major task is out of reach. change: of the "
        f"residual's norm when secondary weights are multiplied by {factors}, as a fraction of it. "
        "excess: over the least within the limits (scipy.optimize.lsq_linear), likewise. daqp: "
        "break_points and H, default settings. Without break_points daqp calls "
        f"{found['flat_infeasible']} of {found['flat']} infeasible.",
    )


def _above_round_off(part: float) -> str:
    return f"{part:.1e}" if part > _ROUND_OFF else f"< {_ROUND_OFF:.0e}"


def _tick_parts(parts_us: dict[str, float]) -> Table:
    columns = (
        Column("", "label"),
        Column("us", lambda one: _us(one["us"])),
        Column("%", lambda one: 100 * one["us"] / parts_us["all"], ".0f"),
    )
    return tabulate(
        "Time of a control tick without physics",
        columns,
        [{"label": PARTS[name], "us": us} for name, us in parts_us.items()],
        "Medians, each part timed separately, with warm caches; parts without a public call of "
        "their own are differences. W_a, analytic Jacobian.",
    )


def _growth(title: str, growth: dict[str, Any], legend: str) -> Table:
    sizes = next(iter(growth.values()))["size"]
    columns = (
        Column("", "name"),
        *(
            Column(f"{size:,}", lambda one, k=k: _us(one["median_us"][k]))
            for k, size in enumerate(sizes)
        ),
        Column("power", "exponent", ".2f"),
        Column("slopes", lambda one: f"{one['least']:z.1f}, {one['most']:z.1f}"),
    )
    entries = [{"name": name} | one for name, one in growth.items()]
    return tabulate(title, columns, entries, legend)


def _changes(comparison: dict[str, Any]) -> Table:
    """Beside an earlier run."""
    columns = (
        Column("", "name"),
        Column("saved", lambda one: _us(one["saved"])),
        Column("now", lambda one: _us(one["now"])),
        Column("now / saved", "now_over_saved", ".2f"),
        Column("", lambda one: "changed" if one["changed"] else ""),
    )
    both = comparison["ratios"] | comparison["timings"]
    return tabulate(
        "Comparison with the saved run",
        columns,
        [{"name": name} | one for name, one in both.items()],
        "Ratios, then medians in us. changed: the ranges from 5 to 95 % do not overlap.",
    )


def notes(summary: dict[str, Any]) -> list[str]:
    """Real-time factor, agreement, machine and versions, and what the saved run had otherwise."""
    now_s, factor = summary["simulated_s"], summary["real_time_factor"]
    furthest = max(
        max(one["distances"].values()) / one["tolerance"] for one in summary["agreement"]
    )
    names = ("mujoco", "numpy", "scipy", *PACKAGES)
    installed = ", ".join(f"{name} {summary['versions'][name]}" for name in names)
    found = [
        f"A {now_s:g} s run takes {now_s / factor:.2g} s (real-time factor {factor:.1f}).",
        f"Before the timing, all results agreed on {len(summary['agreement'])} sets of problems; "
        f"the largest difference was {100 * furthest:.1g} % of its tolerance.",
        f"One process, one thread, {summary['rounds']} rounds in turn, on "
        f"{summary['machine']['processor']}; {installed}.",
    ]
    if "comparison" not in summary:
        return found
    saved_s = summary["comparison"]["saved_simulated_s"]
    if saved_s != now_s:
        found.append(
            f"The saved run simulated {saved_s:g} s of the spiral, this one {now_s:g} s: with "
            "--quick settling is a larger part of the time, and batches are smaller."
        )
    return found + [
        f"The saved run's {before} was measured with the closed form; it is compared with {now}."
        for before, now in summary["comparison"]["renamed"].items()
    ]
