"""Table I's last column: every candidate explanation, simulated and predicted, and the map."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from experiments.bench import Bench
from experiments.compensator import Loop
from experiments.measures import pointing_rms_urad, rms
from experiments.parallel import in_parallel
from experiments.prediction import predicted_error_rad, sensitivity_peak
from experiments.run import Trajectory, nominal_loops, track_spiral
from experiments.uncorrected.candidates import BENCH, CANDIDATES, COLUMNS, Candidate
from experiments.uncorrected.machine import damped
from experiments.uncorrected.stability_map import (
    ROLL_OFF_HZ,
    Grid,
    at_crossover,
    grid,
    map_row,
)
from sim import Array, SimulationDiverged, load_model

LOCKS_M = np.linspace(-250e-6, 250e-6, 101)
"""Where strut 1 is stuck, in the sweep of the lock."""

SETTLED_S = 2.0
"""Time for the loop to take the payload to the centre before a spiral."""

QUICK_CANDIDATES = ("lost_strut", "floor_office", "off_centre")

CHECKED_POINTS = ((0.05, 12.0, 25.0), (0.02, 6.0, 40.0), (0.005, 7.3, 40.0))
"""(damping ratio, alpha crossover, roll-off) of map points that are simulated too, [-, Hz, Hz]."""


@dataclass(frozen=True)
class Predicted:
    """What the linear model says of one candidate.

    Attributes:
        loops: The (alpha, beta) compensators.
        rms_urad: (2,) by column; None: unstable, or saturated.
        sensitivity: Peak sensitivity of the stable loops, by column.
        settled_urad: (2,) of W_d and W_e if these, other than the uncorrected run, start after the
            loop has settled; None as in `rms_urad`.
    """

    loops: tuple[Loop, Loop]
    rms_urad: dict[str, Array | None]
    sensitivity: dict[str, float | None]
    settled_urad: dict[str, Array | None]


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
        quick: Only the first seconds of the spiral, four candidates, a coarse map.
        on_progress: Called with finished and total number of jobs.
    """
    model, bench = load_model(), Bench()
    duration_s = bench.quick_duration_s if quick else bench.duration_s
    chosen = tuple(c for c in CANDIDATES if not quick or c.name in QUICK_CANDIDATES)
    words = [{"candidate": c, "seed": seed, "duration_s": duration_s} for c in chosen]
    foretold = in_parallel(predict, words, lambda done, total: None)
    predicted = dict(zip([c.name for c in chosen], foretold, strict=True))
    jobs = [(c, column) for c in chosen for column in c.simulated]
    calls = [_call(c, column, predicted[c.name], seed, duration_s) for c, column in jobs]
    points = [] if quick else _point_calls(seed)
    where = grid(quick=quick)
    rows = [
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
    ]
    simulations = [*calls, *points]
    total = len(simulations) + len(rows)
    ended = in_parallel(attempt, simulations, lambda done, _: on_progress(done, total))
    mapped = in_parallel(map_row, rows, lambda done, _: on_progress(len(simulations) + done, total))
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
        checked=_compare(points, ended[len(calls) :]),
        lock_ratio={c.name: lock_sweep(c, predicted[c.name].loops, seed) for c in _swept(chosen)},
        seed=seed,
        duration_s=duration_s,
    )


def _call(
    candidate: Candidate, column: str, predicted: Predicted, seed: int, duration_s: float
) -> dict[str, Any]:
    """Arguments of `track_spiral` for one run."""
    return candidate.run(column, seed) | {
        "model": candidate.machine(load_model()),
        "bench": candidate.bench,
        "loops": predicted.loops,
        "jacobian": "constant",
        "duration_s": duration_s,
    }


def predict(candidate: Candidate, seed: int, duration_s: float) -> Predicted:
    """The linear model's word on a candidate's four columns."""
    machine = candidate.machine(load_model())
    loops = nominal_loops(machine, candidate.bench)
    rms_urad: dict[str, Array | None] = {}
    sensitivity: dict[str, float | None] = {}
    settled_urad: dict[str, Array | None] = {}
    for column in COLUMNS:
        run = candidate.run(column, seed)
        error = predicted_error_rad(machine, candidate.bench, loops, **run, duration_s=duration_s)
        rms_urad[column] = None if error is None or candidate.saturates else 1e6 * rms(error)
        loop = {key: run[key] for key in ("goal", "failures")}
        sensitivity[column] = (
            None if error is None else sensitivity_peak(machine, candidate.bench, loops, **loop)
        )
    for column in ("W_d", "W_e"):
        later: dict[str, Any] = {"lead_in_s": SETTLED_S}
        run = candidate.run(column, seed) | later
        error = predicted_error_rad(machine, candidate.bench, loops, **run, duration_s=duration_s)
        settled_urad[column] = None if error is None or candidate.saturates else 1e6 * rms(error)
    return Predicted(loops, rms_urad, sensitivity, settled_urad)


def lock_sweep(candidate: Candidate, loops: tuple[Loop, Loop], seed: int) -> Array:
    """Ratios of the uncorrected to the sound RMS over LOCKS_M, shape (101, 2).

    The error is linear in the place of the lock: two responses give all.
    """
    machine, bench = candidate.machine(load_model()), candidate.bench
    run = candidate.run("W_a_uncorrected", seed)
    sound = predicted_error_rad(machine, bench, loops, **candidate.run("W_a", seed))
    at_centre, off = (
        predicted_error_rad(machine, bench, loops, **run | {"start_m": start_m * np.eye(6)[0]})
        for start_m in (0.0, 1e-4)
    )
    assert sound is not None and at_centre is not None and off is not None  # by choice of candidate
    errors = at_centre[:, None] + (off - at_centre)[:, None] * (LOCKS_M / 1e-4)[:, None]
    return rms(errors) / rms(sound)


def _swept(chosen: tuple[Candidate, ...]) -> list[Candidate]:
    return [c for c in chosen if c.name in (BENCH.name, "off_centre_retuned")]


def _point_calls(seed: int) -> list[dict[str, Any]]:
    calls = []
    for ratio, alpha_hz, roll_off_hz in CHECKED_POINTS:
        machine = damped(load_model(), ratio)
        bench = at_crossover(Bench(), alpha_hz, roll_off_hz)
        loops = nominal_loops(machine, bench)
        shared = {"model": machine, "bench": bench, "loops": loops, "jacobian": "constant"}
        calls += [shared | BENCH.run(column, seed) for column in ("W_a", "W_a_uncorrected")]
    return calls


def _compare(calls: list[dict[str, Any]], ended: list[Trajectory | float]) -> list[dict[str, Any]]:
    """Simulated beside predicted RMS at the checked points of the map."""
    compared = []
    for k, (call, run) in enumerate(zip(calls, ended, strict=True)):
        ratio, alpha_hz, roll_off_hz = CHECKED_POINTS[k // 2]
        prediction = {key: call[key] for key in call if key != "jacobian"}
        error = predicted_error_rad(**prediction)
        simulated = pointing_rms_urad(run) if isinstance(run, Trajectory) else None
        compared.append(
            {
                "name": ("W_a", "W_a_uncorrected")[k % 2],
                "damping_ratio": ratio,
                "alpha_crossover_hz": alpha_hz,
                "roll_off_hz": roll_off_hz,
                "predicted_urad": None if error is None else 1e6 * rms(error),
                "simulated_urad": simulated,
            }
        )
    return compared
