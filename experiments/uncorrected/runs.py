"""Every candidate explanation, simulated and predicted, and the maps."""

from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from experiments.rig.hexapod.controller import nominal_loops
from experiments.rig.hexapod.testbed import Testbed, TestbedConfig
from experiments.rig.run import Run
from experiments.study.parallel import in_parallel
from experiments.study.study import OnProgress
from experiments.uncorrected.candidates import CANDIDATES, COLUMNS, EXPERIMENTS, Candidate
from experiments.uncorrected.predicted import (
    Predicted,
    beam_walk_urad,
    offsets_m,
    predict,
)
from experiments.uncorrected.stability_map import (
    ROLL_OFF_HZ,
    Grid,
    checked_calls,
    compare_checked,
    grid,
    map_row,
)
from sim import Array, SimulationDiverged, load_model

QUICK_CANDIDATES = ("lost_strut", "floor_office", "off_centre")


@dataclass(frozen=True)
class Uncorrected:
    """All of the study; a run that left the finite numbers is the time in seconds when it did."""

    seed: int
    duration_s: float  # of each simulated run
    candidates: tuple[Candidate, ...]
    predicted: dict[str, Predicted]  # by candidate
    runs: dict[str, dict[str, Run | float]]  # by candidate and column
    grid: Grid
    map_rad: Array  # (roll-offs, dampings, crossovers, 2, 2), see map_row
    map_poles: Array  # (roll-offs, dampings, crossovers, 4)
    checked: list[dict[str, Any]]  # predicted and simulated RMS at some points of the map
    offset_m: Array  # of the detector behind the focus
    beam_walk_urad: Array  # RMS there, (offsets, 4, 2, 2)


def run_uncorrected(*, seed: int, quick: bool, on_progress: OnProgress) -> Uncorrected:
    """Run all candidates in four columns of Table I, and the maps, on the machine's cores.

    With `quick` the first seconds of the spiral, three candidates and coarse maps.
    """
    model, bench = load_model(), TestbedConfig()
    duration_s = bench.quick_duration_s if quick else bench.duration_s
    chosen = tuple(c for c in CANDIDATES if not quick or c.name in QUICK_CANDIDATES)
    calls = [{"candidate": c, "seed": seed, "duration_s": duration_s} for c in chosen]
    found = in_parallel(predict, calls, on_progress)
    predicted = dict(zip([c.name for c in chosen], found, strict=True))

    jobs = [(c, column) for c in chosen for column in c.simulated]
    points = [] if quick else checked_calls(seed)
    calls = [
        {
            "testbed": Testbed(c.machine(model), c.bench, predicted[c.name].loops),
            **{"candidate": c, "column": column, "seed": seed, "duration_s": duration_s},
        }
        for c, column in jobs
    ]
    ended = in_parallel(simulate, [*calls, *points], on_progress)
    runs: dict[str, dict[str, Run | float]] = {c.name: {} for c in chosen}
    for (c, column), run in zip(jobs, ended[: len(jobs)], strict=True):
        runs[c.name][column] = run

    where, offsets = grid(quick=quick), offsets_m(quick=quick)
    map_rad, map_poles = _map(where, seed, on_progress)
    linear = {"model": model, "bench": bench, "loops": nominal_loops(model, bench), "seed": seed}
    calls = [linear | {"offset_m": float(offset)} for offset in offsets]
    walked = in_parallel(beam_walk_urad, calls, on_progress)
    return Uncorrected(
        seed=seed,
        duration_s=duration_s,
        candidates=chosen,
        predicted=predicted,
        runs=runs,
        grid=where,
        map_rad=map_rad,
        map_poles=map_poles,
        checked=compare_checked(points, ended[len(jobs) :]),
        offset_m=offsets,
        beam_walk_urad=np.array(walked),
    )


def simulate(
    testbed: Testbed, candidate: Candidate, column: str, seed: int, duration_s: float
) -> Run | float:
    """The run, or the time at which the physics left the finite numbers: a result, here."""
    rig = candidate.rig(testbed, column, seed, duration_s)
    how = {"failures": EXPERIMENTS[column].failures, "seed": seed}
    try:
        path = testbed.bench.spiral_rad(duration_s)
        return rig.fly(rig.controller(), path, lead_in_s=candidate.lead_in_s, **how)
    except SimulationDiverged as diverged:
        return diverged.time_s


def _map(where: Grid, seed: int, on_progress: OnProgress) -> tuple[Array, Array]:
    """RMS errors and largest poles over damping and crossover, as in :class:`Uncorrected`."""
    linear = {"model": load_model(), "bench": TestbedConfig(), "seed": seed}
    over = {"alpha_crossover_hz": where.alpha_crossover_hz}
    calls = [
        linear | over | {"damping_ratio": ratio, "roll_off_hz": roll_off_hz}
        for roll_off_hz, ratio in product(ROLL_OFF_HZ, where.damping_ratio)
    ]
    rows = in_parallel(map_row, calls, on_progress)
    shape = (len(ROLL_OFF_HZ), len(where.damping_ratio), len(where.alpha_crossover_hz))
    errors, poles = zip(*rows, strict=True)
    return np.reshape(errors, (*shape, 2, 2)), np.reshape(poles, (*shape, len(COLUMNS)))
