"""The timings as data: the contents of `bench.json`."""

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from experiments.benchmark import extra
from experiments.benchmark.growth import Series, fitted
from experiments.benchmark.ratios import RATIOS, Ratio, measured
from experiments.benchmark.study import Timed
from experiments.output.provenance import machine, versions
from sim import Array, model_sha256


def summarize(timed: Timed) -> dict[str, Any]:
    """All numbers, ready for JSON; times are in microseconds per call, control tick or mapping."""
    us = timed.samples_us
    ratios = {ratio.name: _ratio(ratio, us) for ratio in RATIOS}
    tick_us = 1e6 * timed.flight.bench.control_period_s
    return {
        "experiment": "bench",
        "seed": timed.flight.seed,
        "versions": versions() | extra.versions(),
        "model_sha256": model_sha256(),
        "machine": machine(),
        "numerical_threads": 1,
        "simulated_s": timed.flight.seconds,
        "rounds": timed.effort.rounds,
        "agreement": [asdict(each) for each in timed.agreements],
        **{name: each["ratio"] for name, each in ratios.items()},
        "real_time_factor": tick_us / float(np.median(us["closed_loop"])),
        "ratios": ratios,
        "timings": {name: _spread(each) for name, each in us.items()},
        "tick_parts_us": _parts(us),
        "growth": {
            "actuators": {each.solver: _growth(each, us) for each in timed.actuators},
            "batch": _growth(timed.batches, us, of_whole_call=True),
        },
    }


def _spread(samples_us: Array) -> dict[str, float]:
    p5, median, p95 = np.percentile(samples_us, [5, 50, 95])
    return {"median_us": float(median), "p5_us": float(p5), "p95_us": float(p95)}


def _ratio(ratio: Ratio, samples_us: Mapping[str, Array]) -> dict[str, Any]:
    one = measured(ratio, samples_us)
    return asdict(one) | {
        "means": ratio.means,
        "bound": ratio.bound,
        "goal": ratio.goal,
        "within_bound": None if ratio.bound is None else one.ratio < ratio.bound,
        "reaches_goal": None if ratio.goal is None else one.ratio <= ratio.goal,
        "check_bound": ratio.check_bound,
    }


def _parts(samples_us: Mapping[str, Array]) -> dict[str, float]:
    """Where a tick's time goes; what no public call does alone comes by difference."""
    us = {name: float(np.median(each)) for name, each in samples_us.items()}
    overhead = us["closed_loop"] - us["mj_step"]
    plant = us["part_plant_step"] - us["part_mj_step"]
    alone = us["part_estimate"] + us["part_mapping"] + us["part_converter"]
    return {
        "sensors": us["part_sensors"],
        "estimate": us["part_estimate"],
        "mapping": us["part_mapping"],
        "jacobian": us["part_jacobian"],
        "converter": us["part_converter"],
        "compensators": us["part_controller"] - alone,
        "plant": plant,
        "rest": overhead - us["part_sensors"] - us["part_controller"] - plant,
        "all": overhead,
    }


def _growth(
    series: Series, samples_us: Mapping[str, Array], *, of_whole_call: bool = False
) -> dict[str, Any]:
    """Sizes, medians, and the exponent with which the time of a call grows."""
    medians = [float(np.median(samples_us[name])) for name in series.names]
    units = series.sizes if of_whole_call else np.ones(len(series.sizes))
    law = fitted(series.sizes, np.multiply(medians, units))
    return {"size": list(series.sizes), "median_us": medians} | asdict(law)


def complaint(summary: dict[str, Any]) -> str | None:
    """One sentence on a ratio beyond its bound, of those that scatter little enough to say so."""
    for name, one in summary["ratios"].items():
        limit = one["check_bound"]
        if limit is not None and not one["ratio"] < limit:
            return f"{name} is {one['ratio']:.2f}, and {limit:g} is where --check draws the line"
    return None
