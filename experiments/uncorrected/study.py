"""Table I's last column: every candidate explanation, simulated and predicted, and the map."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from experiments.hexapod.simulation import Trajectory, nominal_loops, track_spiral
from experiments.hexapod.testbed import Bench
from experiments.output.parallel import in_parallel
from experiments.uncorrected.beam_walk import beam_walk_urad, offsets_m
from experiments.uncorrected.candidate import COLUMNS, Candidate
from experiments.uncorrected.candidates import BENCH, CANDIDATES, RETUNED
from experiments.uncorrected.checked_points import compare, point_calls
from experiments.uncorrected.foretold import Predicted, lock_sweep, predict
from experiments.uncorrected.limit_map import LimitGrid, limit_grid, limit_row
from experiments.uncorrected.stability_map import (
    ROLL_OFF_HZ,
    Grid,
    grid,
    map_row,
)
from sim import Array, SimulationDiverged, load_model

QUICK_CANDIDATES = ("lost_strut", "floor_office", "off_centre")


@dataclass(frozen=True)
class Uncorrected:
    """All of the study.

    Attributes:
        candidates: The explanations.
        predicted: By candidate.
        runs: By candidate and column; a time in seconds where the physics left the finite numbers.
        grid: Of the map.
        map_rad: (roll-offs, dampings, crossovers, 2, 2), see `map_row`; `map_poles` alike.
        map_poles: (roll-offs, dampings, crossovers, 4).
        checked: W_a and uncorrected, predicted and simulated RMS at some points of the map.
        limit_grid: Of the map over the demand limit.
        limit_rad: RMS there, shape (*limit_grid.shape, 4, 2), see `limit_row`.
        offset_m: Of the detector behind the focus.
        beam_walk_urad: RMS there, shape (offsets, 4, 2, 2), see `beam_walk_urad`.
        lock_ratio: Predicted ratios over LOCKS_M by candidate, (101, 2); the spiral starts at once.
        seed: Of noise and floor.
        duration_s: Of each simulated run.
    """

    candidates: tuple[Candidate, ...]
    predicted: dict[str, Predicted]
    runs: dict[str, dict[str, Trajectory | float]]
    grid: Grid
    map_rad: Array
    map_poles: Array
    checked: list[dict[str, Any]]
    limit_grid: LimitGrid
    limit_rad: Array
    offset_m: Array
    beam_walk_urad: Array
    lock_ratio: dict[str, Array]
    seed: int
    duration_s: float


def attempt(**call: Any) -> Trajectory | float:
    """The run, or the time at which the physics left the finite numbers: a result, here."""
    try:
        return track_spiral(**call)
    except SimulationDiverged as diverged:
        return diverged.time_s


def run_uncorrected(
    *, seed: int, quick: bool, on_progress: Callable[[int, int], None] = lambda done, total: None
) -> Uncorrected:
    """Run all candidates in four columns of Table I, and the map, on the machine's cores.

    Args:
        seed: Of the detector noise and of the floor.
        quick: Only the first seconds of the spiral, three candidates, a coarse map.
        on_progress: Called with finished and total number of jobs.
    """
    model, bench = load_model(), Bench()
    duration_s = bench.quick_duration_s if quick else bench.duration_s
    chosen = tuple(c for c in CANDIDATES if not quick or c.name in QUICK_CANDIDATES)
    words = [{"candidate": c, "seed": seed, "duration_s": duration_s} for c in chosen]
    foretold = in_parallel(predict, words, lambda done, total: None)
    predicted = dict(zip([c.name for c in chosen], foretold, strict=True))
    jobs = [(c, column) for c in chosen for column in c.simulated]
    calls = [_call(model, c, column, predicted[c.name], seed, duration_s) for c, column in jobs]
    points = [] if quick else point_calls(seed)
    where, limits, offsets = grid(quick=quick), limit_grid(quick=quick), offsets_m(quick=quick)
    sound = {"model": model, "loops": nominal_loops(model, bench), "seed": seed}
    work: list[tuple[Callable[..., Any], list[dict[str, Any]]]] = [
        (attempt, [*calls, *points]),
        (
            map_row,
            [
                {
                    "model": model,
                    "bench": bench,
                    "damping_ratio": ratio,
                    "alpha_crossover_hz": where.alpha_crossover_hz,
                    "roll_off_hz": roll_off_hz,
                    "seed": seed,
                }
                for roll_off_hz in ROLL_OFF_HZ
                for ratio in where.damping_ratio
            ],
        ),
        (
            limit_row,
            [
                sound | {"bench": each, "limit_over_radius": limits.limit_over_radius}
                for each in limits.benches(bench)
            ],
        ),
        (
            beam_walk_urad,
            [sound | {"bench": bench, "offset_m": float(offset)} for offset in offsets],
        ),
    ]
    ended, mapped, limited, walked = _all_of(work, on_progress)
    shape = (len(ROLL_OFF_HZ), len(where.damping_ratio), len(where.alpha_crossover_hz))
    runs: dict[str, dict[str, Trajectory | float]] = {c.name: {} for c in chosen}
    for (c, column), run in zip(jobs, ended[: len(jobs)], strict=True):
        runs[c.name][column] = run
    return Uncorrected(
        candidates=chosen,
        predicted=predicted,
        runs=runs,
        grid=where,
        map_rad=np.reshape([row[0] for row in mapped], (*shape, 2, 2)),
        map_poles=np.reshape([row[1] for row in mapped], (*shape, len(COLUMNS))),
        checked=compare(points, ended[len(calls) :]),
        limit_grid=limits,
        limit_rad=np.reshape(limited, (*limits.shape, len(COLUMNS), 2)),
        offset_m=offsets,
        beam_walk_urad=np.array(walked),
        lock_ratio={c.name: lock_sweep(c, predicted[c.name].loops, seed) for c in _swept(chosen)},
        seed=seed,
        duration_s=duration_s,
    )


def _all_of(
    work: Sequence[tuple[Callable[..., Any], list[dict[str, Any]]]],
    on_progress: Callable[[int, int], None],
) -> list[list[Any]]:
    """Several functions, each over its own calls, as one progress."""
    total, done, ended = sum(len(calls) for _, calls in work), 0, []
    for function, calls in work:
        before = done
        ended.append(
            in_parallel(function, calls, lambda now, _, at=before: on_progress(at + now, total))
        )
        done += len(calls)
    return ended


def _call(
    model: mujoco.MjModel,
    candidate: Candidate,
    column: str,
    predicted: Predicted,
    seed: int,
    duration_s: float,
) -> dict[str, Any]:
    """Arguments of `track_spiral` for one run."""
    return candidate.run(column, seed) | {
        "model": candidate.machine(model),
        "bench": candidate.bench,
        "loops": predicted.loops,
        "jacobian": "constant",
        "duration_s": duration_s,
    }


def _swept(chosen: tuple[Candidate, ...]) -> list[Candidate]:
    return [c for c in chosen if c.name in (BENCH.name, RETUNED.name)]
