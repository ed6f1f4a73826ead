"""Numbers of single runs: error, saturation, recovery; and of the loops: the circle criterion."""

from typing import Any

import numpy as np

from argument_checks.ties import least
from experiments.limits.allocation import STRICT, UNLIMITED, Strategy
from experiments.limits.arm import PERIOD_S, RANGE_RAD, ArmRun
from experiments.limits.runs import HEAVE_M, REST_S, Case, attainable, limits_of
from experiments.rig.hexapod.columns import MAJOR
from experiments.rig.hexapod.controller import StrutMapping, sampled
from experiments.rig.hexapod.testbed import Testbed
from experiments.rig.run import Run, rms
from ftc.control.anti_windup import circle_margin
from ftc.goal import Goal
from sim import Array, Failure, failed_plant, hexapod, linearize

RECOVERED_RAD = 25e-6
"""A run has recovered where its pointing is as near to that of the machine without limits."""
AT_LIMIT_M = 0.1e-6
AT_LIMIT_RAD = 1e-6


def spiral_entry(testbed: Testbed, case: Case, run: Run, unlimited: Run) -> dict[str, Any]:
    """One spiral, ready for JSON."""
    period_s, limits = testbed.bench.control_period_s, limits_of(testbed)
    error = np.linalg.norm(run.error, axis=1)
    off = np.linalg.norm(run.true - unlimited.true, axis=1)
    inside = room(attainable(testbed, case), run.desired) > 0
    working = np.delete(np.arange(6), list(case.locked_at))
    entry: dict[str, Any] = {
        "name": case.name,
        "condition": case.condition,
        "strategy": case.strategy.name,
        "allocation": case.strategy.allocation,
        "anti_windup": case.strategy.anti_windup,
        "major_weight": case.strategy.major_weight,
        "tracking_time_s": tracking_time_s(testbed, case),
        "rms_urad": 1e6 * rms(error),
        "peak_urad": 1e6 * error.max(),
        "attainable_rms_urad": 1e6 * rms(error[inside]),
        "recovery_s": longest((off > RECOVERED_RAD) & inside) * period_s,
        "rest_peak_urad": 1e6 * error[-round(0.5 * REST_S / period_s) :].max(),
        "closure_residual_max_m": run.closure_max_m,
    }
    moved_m = run.displacement[:, working]
    reference_m = HEAVE_M if case.heave else 0.0
    entry["secondary_rms_um"] = 1e6 * float(np.sqrt(((moved_m - reference_m) ** 2).mean()))
    if case.strategy == UNLIMITED:
        return entry | {"at_limit_s": None, "beyond_limit_um": None}
    command_m = testbed.amplifier().displacements(run.inputs)[:, working]
    least = np.minimum(limits[1][working] - command_m, command_m - limits[0][working])
    entry["at_limit_s"] = float((least < AT_LIMIT_M).any(axis=1).sum() * period_s)
    return entry | {"beyond_limit_um": 1e6 * float((-least).max())}


def tracking_time_s(testbed: Testbed, case: Case) -> list[float] | None:
    """In which the integrators of both loops lose their excess; None without anti-windup."""
    if not case.strategy.anti_windup:
        return None
    gains = (loop.numerator[-1] / loop.denominator[-2] for loop in testbed.loops)
    return [float(case.strategy.slowness / gain) for gain in gains]


def tuned(runs: list[dict[str, Any]], key: str) -> dict[str, dict[str, Any]]:
    """Of each kind of allocation the run with the least RMS error, and its error over strict's.

    A rule that no user has: each number is chosen after the run, for that run.
    """
    of_kind: dict[str, list[dict[str, Any]]] = {}
    for run in runs:
        of_kind.setdefault(run["allocation"], []).append(run)
    strict = next(run[key] for run in runs if run["strategy"] == STRICT.name)
    best = {kind: ran[least([run[key] for run in ran])] for kind, ran in of_kind.items()}
    return {
        kind: {"strategy": run["strategy"], "rms_over_strict": run[key] / strict}
        for kind, run in best.items()
        if kind not in (STRICT.allocation, UNLIMITED.allocation)
    }


def condition_entry(
    testbed: Testbed, case: Case, run: Run, entries: list[dict[str, Any]]
) -> dict[str, Any]:
    """What all strategies have in common: what can be attained, stability; and the best of each."""
    lacking = -np.minimum(room(attainable(testbed, case), run.desired), 0.0)
    return {
        "name": case.condition,
        "stuck": case.stuck,
        "heave": case.heave,
        "least_rms_urad": 1e6 * rms(lacking),
        "not_attainable_s": float((lacking > 0).sum() * testbed.bench.control_period_s),
        "circle_margin": loop_margin(testbed, case, anti_windup=True),
        "circle_margin_winding_up": loop_margin(testbed, case, anti_windup=False),
        "tuned": tuned([one for one in entries if one["condition"] == case.condition], "rms_urad"),
    }


def loop_margin(testbed: Testbed, case: Case, *, anti_windup: bool) -> float:
    """:func:`.circle_margin` of both loops on the linear model of the plant."""
    plant = failed_plant(testbed.model, [Failure(strut, "locked") for strut in case.locked_at])
    locked_at = dict.fromkeys(case.locked_at, 0.0)
    goal = Goal(joint_weight=(1.0,) * 6, locked_at=locked_at)
    gain = StrutMapping(hexapod(testbed.model), goal, "constant").major_gain()
    linear = linearize(plant.model, plant.data)
    period_s = testbed.bench.control_period_s
    pointing = sampled(linear, gain, period_s)[MAJOR, :]
    return circle_margin(pointing, testbed.loops, anti_windup=anti_windup)


def arm_entry(strategy: Strategy, run: ArmRun) -> dict[str, Any]:
    """One motion of the arm, ready for JSON."""
    reached = np.abs(run.joint_rad).max(axis=1)
    return {
        "strategy": strategy.name,
        "allocation": strategy.allocation,
        "major_weight": strategy.major_weight,
        "rms_mrad": 1e3 * float(rms(run.error_rad)),
        "peak_mrad": 1e3 * float(run.error_rad.max()),
        "at_limit_s": float((reached > RANGE_RAD - AT_LIMIT_RAD).sum() * PERIOD_S),
        "beyond_limit_rad": float(reached.max() - RANGE_RAD),
    }


def longest(holds: Array) -> int:
    """Number of samples in the longest run of truth."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], holds.astype(int), [0]])))
    return int((edges[1::2] - edges[::2]).max(initial=0))


def room(corners: Array, points: Array) -> Array:
    """Distance of points (N, 2) from the outline, shape (N,): positive inside, negative outside."""
    begin, along = corners, np.roll(corners, -1, axis=0) - corners
    length = np.linalg.norm(along, axis=1)
    off = points[:, None] - begin
    part = (off * along).sum(axis=2) / length**2
    nearest = off - part.clip(0, 1)[..., None] * along
    distance = np.linalg.norm(nearest, axis=2).min(axis=1)
    inward = (along[:, 0] * off[..., 1] - along[:, 1] * off[..., 0]) / length
    return np.where((inward >= 0).all(axis=1), distance, -distance)
