"""The timings as numbers, tables, sentences and files."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from importlib.metadata import version
from typing import Any

import numpy as np

from experiments.benchmark import ratios
from experiments.benchmark.figure import picture
from experiments.benchmark.measurement import power_law, spread
from experiments.benchmark.runs import PACKAGES, Timed
from experiments.benchmark.solvers import GROWING, batch_names
from experiments.hexapod.testbed import TestbedConfig
from experiments.output.provenance import machine, versions
from experiments.output.results import Results
from experiments.output.tables import Column, Table, tabulate
from sim import model_sha256

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
    "daqp_hierarchy": "daqp, hierarchy, no weights",
    "placo": "PlaCo, problem given",
    "placo_with_build": "PlaCo, problem built",
    "pinv_formula": "eq. (25) with numpy's pinv",
    "dgglse": "LAPACK dgglse, A given",
}

LARGE = 3
"""So many of the largest sizes are fitted on their own: below, a fixed cost hides the power."""


def results(timed: Timed) -> Results:
    """Everything that `fjh bench` publishes, and the saved file outside its folder."""
    summary = summarize(timed)
    shown = dict(summary)
    if timed.before is not None:
        shown["comparison"] = ratios.compare(summary, timed.before)
    return Results(
        shown,
        tables=tables(shown),
        notes=notes(shown),
        checks=ratios.checks(shown) if timed.check else (),
        pictures=[picture(shown)],
        records=[lambda _, file=file: ratios.save(file, summary) for file in [timed.save] if file],
    )


def summarize(timed: Timed) -> dict[str, Any]:
    """All numbers, ready for JSON; times are in microseconds per call, control tick or mapping."""
    samples_us, effort = timed.samples_us, timed.effort
    us = {name: float(np.median(each)) for name, each in samples_us.items()}
    found = {ratio.name: ratio.measured(samples_us) for ratio in ratios.RATIOS}
    sizes, batches = effort.actuators, effort.batches
    batched_us = [us[name] for name in batch_names(batches)]
    of_call = power_law(batches, np.multiply(batched_us, batches))
    return {
        "experiment": "bench",
        "seed": timed.seed,
        "versions": versions() | {name: version(name) for name in PACKAGES},
        "model_sha256": model_sha256(),
        "machine": machine(),
        "numerical_threads": 1,
        "simulated_s": effort.seconds,
        "rounds": effort.rounds,
        "agreement": [asdict(each) for each in timed.agreements],
        **{name: each["ratio"] for name, each in found.items()},
        "real_time_factor": 1e6 * TestbedConfig().control_period_s / us["closed_loop"],
        "ratios": found,
        "timings": {name: spread(each) for name, each in samples_us.items()},
        "tick_parts_us": _parts(us),
        "growth": {
            "actuators": {each.name: _series(each.name, sizes, us) for each in GROWING},
            "batch": {"size": list(batches), "median_us": batched_us} | of_call,
        },
    }


def _series(solver: str, sizes: Sequence[int], us: Mapping[str, float]) -> dict[str, Any]:
    medians = [us[f"{solver}_n{n}"] for n in sizes]
    large = sizes[-LARGE:]
    fit = {"from": large[0], "to": large[-1]} | power_law(large, medians[-LARGE:])
    return {"size": list(sizes), "median_us": medians, "large": fit} | power_law(sizes, medians)


def _parts(us: Mapping[str, float]) -> dict[str, float]:
    """Times of the parts of a control tick; parts without a public call are differences."""
    overhead = us["closed_loop"] - us["mj_step"]
    plant = us["part_plant_step"] - us["part_mj_step"]
    alone = us["part_estimate"] + us["part_mapping"] + us["part_converter"]
    direct = ("sensors", "estimate", "mapping", "jacobian", "converter")
    return {name: us[f"part_{name}"] for name in direct} | {
        "compensators": us["part_controller"] - alone,
        "plant": plant,
        "rest": overhead - us["part_sensors"] - us["part_controller"] - plant,
        "all": overhead,
    }


def tables(summary: dict[str, Any]) -> list[Table]:
    """Tables of the ratios and of the times they are made of."""
    seconds, timings = summary["simulated_s"], summary["timings"]
    part = f", {seconds:g} s of the spiral only" if seconds < TestbedConfig().duration_s else ""
    found = [
        ratios.table(summary["ratios"], f"Ratios of medians{part}"),
        _times("One control tick, us", TICK, timings),
        _tick_parts(summary["tick_parts_us"]),
        _times("One Problem 1, hexapod's size, us", SOLVE, timings),
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


def _times(title: str, labels: dict[str, str], timings: dict[str, Any]) -> Table:
    columns = (
        Column("", "label"),
        Column("median", lambda one: _us(one["median_us"])),
        Column("5 to 95 %", lambda one: f"{_us(one['p5_us'])} to {_us(one['p95_us'])}"),
    )
    entries = [{"label": label} | timings[name] for name, label in labels.items()]
    return tabulate(title, columns, entries)


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
        f"the largest difference was {100 * furthest:.2g} % of its tolerance.",
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
