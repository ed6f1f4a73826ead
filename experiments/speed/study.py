"""How fast a closed-loop run is, as ratios within one process: absolute times are noise."""

import time
from collections.abc import Callable
from statistics import median
from typing import Any

import mujoco

from experiments.bench import Bench
from experiments.choices import JacobianChoice
from experiments.provenance import versions
from experiments.run import nominal_loops, track_spiral
from experiments.table1.study import COLUMNS
from sim import load_model, model_sha256


def measure(
    *,
    seconds: float,
    repeats: int,
    seed: int,
    on_progress: Callable[[int, int], None] = lambda done, total: None,
) -> dict[str, Any]:
    """Time the W_a run with both Jacobians beside bare physics of the same steps.

    Args:
        seconds: Simulated time of each timing.
        repeats: Timings of each, taken in turn; the median counts. One warm-up goes first.
        seed: Of the detector noise.
        on_progress: Called with finished and total number of timings.
    """
    model, bench = load_model(), Bench()
    loops = nominal_loops(model, bench)

    def run(jacobian: JacobianChoice) -> None:
        goal = COLUMNS[0].goal
        track_spiral(model, bench, loops, goal, jacobian=jacobian, seed=seed, duration_s=seconds)

    def physics() -> None:
        data = mujoco.MjData(model)
        simulated_s = bench.settling_s + seconds  # as much as track_spiral steps through
        mujoco.mj_step(model, data, round(simulated_s / model.opt.timestep))

    timed: dict[str, Callable[[], None]] = {
        "mj_step": physics,
        "closed_loop_analytic": lambda: run("analytic"),
        "closed_loop_constant": lambda: run("constant"),
    }
    taken_s: dict[str, list[float]] = {name: [] for name in timed}
    for repeat in range(repeats + 1):
        for k, (name, work) in enumerate(timed.items()):
            start = time.perf_counter()
            work()
            if repeat > 0:  # the first round warms caches
                taken_s[name].append(time.perf_counter() - start)
            on_progress(repeat * len(timed) + k + 1, (repeats + 1) * len(timed))
    medians = {name: median(values) for name, values in taken_s.items()}
    bare = medians["mj_step"]
    return {
        "experiment": "bench",
        "seed": seed,
        "versions": versions(),
        "model_sha256": model_sha256(),
        "simulated_s": seconds,
        "median_s": medians,
        "all_s": taken_s,
        "closed_loop_over_mj_step": {
            "analytic": medians["closed_loop_analytic"] / bare,
            "constant": medians["closed_loop_constant"] / bare,
        },
        "real_time_factor": {name: seconds / value for name, value in medians.items()},
    }
