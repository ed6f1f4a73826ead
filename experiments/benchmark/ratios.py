"""The published ratios: what they compare, and their limits."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from sim import Array

CHECK_MARGIN = 3.0
"""A stable ratio fails beyond this multiple of its bound: between processors alone, the same code
scattered up to 2.3 times it."""


@dataclass(frozen=True)
class Ratio:
    """A quotient of sums of medians, by its name in `bench.json`.

    It must be below `bound`, and should be at most `goal`; None: it is reported only. A `stable`
    one scatters so little that a commit may fail on it: docs/performance.md.
    """

    name: str
    over: str  # names of what is timed, "-" before one that is taken off
    under: str  # likewise
    words: str | None  # what is compared with whom; None is this library with itself
    bound: float | None = None
    goal: float | None = None
    stable: bool = False

    @property
    def check_bound(self) -> float | None:
        """From where on `--check` fails; None: never."""
        return CHECK_MARGIN * self.bound if self.stable and self.bound is not None else None

    def of(self, us: Mapping[str, Any]) -> Any:
        """Its value, from times by name."""
        return _total(self.over, us) / _total(self.under, us)

    def row(self, samples_us: Mapping[str, Array]) -> dict[str, Any]:
        """Its value, from samples by name, shape (rounds, samples), beside its limits.

        p5 and p95 are percentiles over the rounds, each with its own medians.
        """
        value = float(self.of({name: np.median(each) for name, each in samples_us.items()}))
        by_round = self.of({name: np.median(each, axis=1) for name, each in samples_us.items()})
        p5, p95 = np.percentile(by_round, [5, 95])
        is_met = None if self.bound is None else "bound" if value < self.bound else "no"
        reaches_goal = self.goal is not None and value <= self.goal
        return {
            "name": self.name,
            "over": self.over,
            "under": self.under,
            "ratio": value,
            "p5": float(p5),
            "p95": float(p95),
            "bound": self.bound,
            "goal": self.goal,
            "met": "goal" if reaches_goal else is_met,
            "check_bound": self.check_bound,
        }


def _total(names: str, us: Mapping[str, Any]) -> Any:
    return sum(-us[name[1:]] if name[0] == "-" else us[name] for name in names.split())


def _loop(robot: str, bounds: tuple[float, float], goals: tuple[float, float]) -> list[Ratio]:
    """Of a bundled robot: the loop over its physics, and the loop that diagnoses."""
    return [
        Ratio(
            f"{robot}_{kind}_over_physics", f"{robot}_{kind}", f"{robot}_physics", None, bound, goal
        )
        for kind, bound, goal in zip(("loop", "supervised"), bounds, goals, strict=True)
    ]


def _tick(name: str, robot: str, words: str, bound: float, goal: float) -> Ratio:
    """A tick for any MJCF, kinematics and one compiled call; mink with its update."""
    under, words = f"{robot}_mink {robot}_mink_update", f"tick, {words} / mink"
    return Ratio(name, f"{robot}_tick", under, words, bound, goal, True)


def _ik(robot: str, words: str) -> Ratio:
    """`Ik` in strict levels; mink with its update and the same tasks, weighed."""
    name, words = f"ik_{robot}", f"inverse kinematics, {words} / mink"
    return Ratio(f"{name}_over_mink", name, f"{name}_mink", words, 1.0, 0.1)


RATIOS = (
    Ratio(
        *("closed_loop_over_mj_step", "closed_loop", "mj_step"),
        *("closed loop / physics alone", 1.2, 1.12),
    ),
    *_loop("hexapod", (2.0, 2.5), (1.25, 1.5)),
    *_loop("arm", (12.0, 30.0), (2.5, 5.0)),
    *_loop("hand", (12.0, 30.0), (3.0, 6.0)),
    *_loop("arms", (10.0, 20.0), (3.0, 6.0)),
    *_loop("platform", (10.0, 20.0), (3.0, 6.0)),
    Ratio(
        *("loop_overhead_over_mink", "closed_loop -mj_step", "fjh_mink"),
        *("control tick without physics / mink", 0.25, 0.15),
    ),
    _tick("tick_over_mink", "fjh", "hexapod", 0.15, 0.08),
    _tick("arm_tick_over_mink", "arm", "arm", 0.2, 0.08),
    _tick(
        "humanoid_one_foot_tick_over_mink", "humanoid_one_foot", "humanoid on one foot", 0.25, 0.1
    ),
    _tick("humanoid_tick_over_mink", "humanoid", "humanoid on both feet", 0.3, 0.12),
    _ik("arm", "arm"),
    _ik("mobile", "mobile base"),
    _ik("quadruped", "quadruped"),
    _ik("humanoid", "humanoid"),
    Ratio(
        *("hexapod_tick_over_mink", "hexapod_tick", "fjh_mink"),
        *("tick, hexapod's closed form / mink", 0.05, 0.03, True),
    ),
    Ratio(
        *("diagnosis_over_mj_step", "diagnosis", "mj_step"),
        *("diagnosis / physics alone", 0.08, 0.04, True),
    ),
    Ratio(
        *("diagnosis_worst_over_mj_step", "diagnosis_worst", "mj_step"),
        *("diagnosis, worst of its ticks / physics alone", 0.3, 0.15, True),
    ),
    Ratio("solve_over_daqp", "prioritized", "daqp", "one Problem 1 / daqp", 1.5, 0.8, True),
    Ratio("solve_over_placo", "prioritized", "placo", "one Problem 1 / PlaCo"),
    Ratio(
        *("solve_over_placo_built", "prioritized", "placo_with_build"),
        *("one Problem 1 / PlaCo, built", 0.4, 0.2, True),
    ),
    Ratio(
        *("limited_over_daqp", "limited", "daqp_limited_with_build"),
        *("Problem 1 with limits / daqp, built", 0.5, 0.3, True),
    ),
    Ratio(
        *("limited_over_daqp_given", "limited", "daqp_limited"),
        *("Problem 1 with limits / daqp", 2.0, 1.0, True),
    ),
    Ratio(
        *("hierarchy3_over_daqp", "hierarchy3", "daqp_hierarchy3"),
        *("three levels with limits / daqp", 1.5, 1.0, True),
    ),
    # A bound of 0.1 was asked of a solver for batches alone.
    Ratio("batched_over_daqp", "batched", "daqp", "one mapping of a batch / daqp", 0.2, 0.06, True),
    Ratio(
        *("growth_over_daqp", "prioritized_n200", "daqp_n200"),
        *("one Problem 1, 200 actuators / daqp", 1.2, 0.8, True),
    ),
    Ratio("tied_over_square", "tied_loops", "square_loops", None, 2.0, 1.3, True),
    Ratio("manipulability_over_tick", "manipulability", "square_loops", None, 5.0, 2.0, True),
)
