"""The tables of `fjh bench`, and the sentences below them."""

from typing import Any

from experiments.benchmark import ratios
from experiments.benchmark.closed_loop import LOOPS
from experiments.benchmark.runs import PACKAGES
from experiments.rig.hexapod.testbed import TestbedConfig
from experiments.study.tables import Column, Table, tabulate

_OF_LOOPS = {"physics": "physics alone", "loop": "closed loop", "supervised": "supervised"}
TICK = {
    "mj_step": "physics alone: mj_step",
    "closed_loop": "closed loop",
    **{
        f"{robot}_{name}": f"{robot}, {label}"
        for robot in ("hexapod", *LOOPS)
        for name, label in _OF_LOOPS.items()
    },
    "hexapod_tick": "hexapod's mapping: Jacobian to apply",
    "diagnosis": "diagnosis: Monitor.step",
    "diagnosis_worst": "  its slowest ticks",
    "square_loops": "kinematics and mapping, six actuators",
    "tied_loops": "  the same, loops tie rates together",
    "manipulability": "kinematics and manipulability, six actuators",
}
ROBOTS = {
    "fjh": "hexapod, strut 1 locked",
    "arm": "arm, limits",
    "ur5e": "UR5e-like arm, limits",
    "humanoid_one_foot": "humanoid on one foot, limits",
    "humanoid": "humanoid on both feet, limits",
}
LATENCY = {
    "controller": "hexapod's controller",
    "supervisor": "the same with diagnosis",
    "fjh_tick": "tick of the hexapod as any robot",
    "humanoid_tick": "tick of the humanoid on both feet",
    "ik_humanoid": "Ik.step of the humanoid",
}
COLLECTOR = {
    "on": "collector on",
    "frozen": "gc.freeze()",
    "off": "gc.freeze() and gc.disable()",
}
_ROUND_OFF = 1e-12
"""Part of a number; smaller ones are not printed, because they depend on the processor."""

SOLVE = {
    "prioritized": "velocity_mapping and apply",
    "batched": "the same, in one batch",
    "daqp_hierarchy": "daqp, hierarchy without H: unit rows",
    "pinv_formula": "eq. (25) with numpy's pinv",
    "dgglse": "LAPACK dgglse, A given",
}
PEERS = (
    ("Problem 1: daqp", "prioritized", ("daqp",), ("daqp_with_build",)),
    ("Problem 1: PlaCo", "prioritized", ("placo",), ("placo_with_build",)),
    ("Problem 1 with limits: daqp", "limited", ("daqp_limited",), ("daqp_limited_with_build",)),
    ("three levels: daqp", "hierarchy3", ("daqp_hierarchy3",), ("daqp_hierarchy3_with_build",)),
    *(
        (f"tick, {words}: mink", f"{name}_tick", (f"{name}_mink",), (f"{name}_mink", up))
        for name, words, up in ((*each, f"{each[0]}_mink_update") for each in ROBOTS.items())
    ),
)
"""Question and peer, this library, the peer with its problem given, and with it built."""


def tables(summary: dict[str, Any]) -> list[Table]:
    """Tables of the ratios and of the times they are made of."""
    seconds, timings = summary["simulated_s"], summary["timings"]
    at_limits = (_at_limit(name, one) for name, one in summary["active_limits"].items())
    part = f", {seconds:g} s of the spiral only" if seconds < TestbedConfig().duration_s else ""
    return [
        ratios.table(summary["ratios"], f"Ratios of medians{part}"),
        _times("One control tick, us", TICK, timings),
        _robots(timings),
        _latency(summary["latency"]),
        _slowest(summary["slowest"]),
        _peers(timings, " ".join(at_limits)),
        _times("One Problem 1 of six actuators in other ways, us", SOLVE, timings),
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


def _robots(timings: dict[str, Any]) -> Table:
    columns = (
        Column("", "label"),
        Column("compiled", "tick"),
        Column("from a reader", "system"),
        Column("as in README", "readme"),
        Column("mink, with update", "mink"),
    )
    entries = []
    for name, label in ROBOTS.items():
        us = {way: timings[f"{name}_{way}"]["median_us"] for way in ("tick", "system", "readme")}
        us["mink"] = (
            timings[f"{name}_mink"]["median_us"] + timings[f"{name}_mink_update"]["median_us"]
        )
        entries.append({"label": label} | {way: _us(each) for way, each in us.items()})
    return tabulate(
        "One tick from joint positions to rates, us",
        columns,
        entries,
        "compiled: JacobianReader.read and VelocityMapping.tick, made once. from a reader: "
        "JacobianReader.at, ConstrainedSystem.of, velocity_mapping, all anew. as in README: "
        "sim.jacobians instead, which also looks up all names. All results agree to 1e-5.",
    )


def _slowest(slowest: dict[str, dict[str, float]]) -> Table:
    columns = (
        Column("", "label"),
        Column("mean", lambda one: _us(one["mean_us"])),
        Column("slowest", lambda one: _us(one["slowest_us"])),
    )
    entries = [{"label": name} | one for name, one in slowest.items()]
    legend = "The slowest is that of an alarm, which looks back over two seconds, or of a decision."
    return tabulate(
        "One tick of a supervisor while an actuator locks, us of the processor",
        columns,
        entries,
        legend,
    )


def _peers(timings: dict[str, Any], at_limits: str) -> Table:
    """Each peer with its problem given, and with it built."""
    columns = (
        Column("", "label"),
        Column("this library", lambda one: _us(one["ours"])),
        Column("given", lambda one: _us(one["given"])),
        Column("ratio", lambda one: one["ours"] / one["given"], ".3g"),
        Column("built", lambda one: _us(one["built"])),
        Column("ratio ", lambda one: one["ours"] / one["built"], ".3g"),
    )

    def total(names: tuple[str, ...]) -> float:
        return sum(timings[name]["median_us"] for name in names)

    entries = [
        {"label": label, "ours": total((ours,)), "given": total(given), "built": total(built)}
        for label, ours, given, built in PEERS
    ]
    return tabulate(
        "Beside other solvers, us",
        columns,
        entries,
        "given, built: daqp without and with the time that H takes, PlaCo likewise its problem, "
        f"mink its kinematics; this library always begins at J or at positions. {at_limits}",
    )


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


def notes(summary: dict[str, Any]) -> list[str]:
    """Real-time factor, agreement, machine and versions."""
    now_s, factor = summary["simulated_s"], summary["real_time_factor"]
    furthest = max(
        max(one["distances"].values()) / one["tolerance"] for one in summary["agreement"]
    )
    names = ("mujoco", "numpy", "scipy", *PACKAGES)
    installed = ", ".join(f"{name} {summary['versions'][name]}" for name in names)
    return [
        f"A {now_s:g} s run takes {now_s / factor:.2g} s (real-time factor {factor:.1f}).",
        f"Before the timing, all results agreed on {len(summary['agreement'])} sets of problems; "
        f"the largest difference was {100 * furthest:.1g} % of its tolerance.",
        f"One process, one thread, {summary['rounds']} rounds in turn, on "
        f"{summary['machine']['processor']}; {installed}.",
    ]
