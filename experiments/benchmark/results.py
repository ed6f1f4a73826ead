"""The timings as numbers, and all that is published of them."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from importlib.metadata import version
from typing import Any

import numpy as np

from experiments.benchmark.figure import picture
from experiments.benchmark.measurement import power_law, spread
from experiments.benchmark.ratios import RATIOS, checks
from experiments.benchmark.runs import PACKAGES, Timed
from experiments.benchmark.solvers import GROWING, batch_names
from experiments.benchmark.tables import notes, tables
from experiments.rig.hexapod.testbed import TestbedConfig
from experiments.study.provenance import machine, versions
from experiments.study.results import Results
from sim import model_sha256


def results(timed: Timed) -> Results:
    """Everything that `fjh bench` publishes."""
    summary = summarize(timed)
    return Results(
        summary,
        tables=tables(summary),
        notes=notes(summary),
        checks=checks(summary) if timed.check else (),
        pictures=[picture(summary)],
    )


def summarize(timed: Timed) -> dict[str, Any]:
    """All numbers, ready for JSON; times are in microseconds per call, control tick or mapping."""
    samples_us, effort = timed.samples_us, timed.effort
    us = {name: float(np.median(each)) for name, each in samples_us.items()}
    found = {ratio.name: ratio.measured(samples_us) for ratio in RATIOS}
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
        "active_limits": timed.active_limits,
        "out_of_reach": timed.out_of_reach,
        "latency": {"ticks": effort.ticks, "of": timed.latency},
        "slowest": timed.slowest,
        "growth": {
            "actuators": {each.name: _series(each.name, sizes, us) for each in GROWING},
            "batch": {"size": list(batches), "median_us": batched_us} | of_call,
        },
    }


def _series(solver: str, sizes: Sequence[int], us: Mapping[str, float]) -> dict[str, Any]:
    medians = [us[f"{solver}_n{n}"] for n in sizes]
    return {"size": list(sizes), "median_us": medians} | power_law(sizes, medians)
