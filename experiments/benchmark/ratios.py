"""The published ratios: what they compare, and their limits."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from experiments.study.results import Check
from experiments.study.tables import Column, Table, tabulate
from sim import Array

CHECK_MARGIN = 3.0
"""A stable ratio fails beyond this multiple of its bound: between processors alone, the same code
scattered up to 2.3 times it."""


@dataclass(frozen=True)
class Ratio:
    """A quotient of sums of medians, by its name in `bench.json`.

    It must be below `bound`, and should be at most `goal`; None: it is reported only. A `stable`
    one scatters so little that a commit may fail on it: docs/performance.md.

    Attributes:
        over: Names of what is timed, "-" before one that is taken off.
        under: Likewise.
        words: What is compared with whom, for the figure; None is this library with itself.
        means: The same exactly.
    """

    name: str
    over: str
    under: str
    words: str | None
    means: str
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

    def measured(self, samples_us: Mapping[str, Array]) -> dict[str, Any]:
        """Its value, from samples by name, shape (rounds, samples), beside its limits.

        p5 and p95 are percentiles over the rounds, each with its own medians.
        """
        value = float(self.of({name: np.median(each) for name, each in samples_us.items()}))
        by_round = self.of({name: np.median(each, axis=1) for name, each in samples_us.items()})
        p5, p95 = np.percentile(by_round, [5, 95])
        return {
            "ratio": value,
            "p5": float(p5),
            "p95": float(p95),
            "means": self.means,
            "bound": self.bound,
            "goal": self.goal,
            "within_bound": None if self.bound is None else value < self.bound,
            "reaches_goal": None if self.goal is None else value <= self.goal,
            "check_bound": self.check_bound,
        }


def _total(names: str, us: Mapping[str, Any]) -> Any:
    return sum(-us[name[1:]] if name[0] == "-" else us[name] for name in names.split())


def _tick(name: str, robot: str, words: str, what: str, bound: float, goal: float) -> Ratio:
    return Ratio(
        name,
        f"{robot}_tick",
        f"{robot}_mink {robot}_mink_update",
        f"tick, {words} / mink",
        f"a tick for any MJCF, kinematics and one compiled call: {what}; over mink's "
        "Configuration.update and solve_ik",
        bound,
        goal,
        stable=True,
    )


def _ik(robot: str, words: str, what: str) -> Ratio:
    return Ratio(
        f"ik_{robot}_over_mink",
        f"ik_{robot}",
        f"ik_{robot}_mink",
        f"inverse kinematics, {words} / mink",
        f"fjh.Ik, tasks in strict levels under ranges and a velocity limit: {what}; over mink's "
        "Configuration.update and solve_ik of the same tasks, weighed",
        1.0,
        0.1,
    )


def _loop(robot: str, words: str, goal: float, supervised_goal: float, bounds: str) -> list[Ratio]:
    """Of a bundled robot: the loop over its physics, and the loop that diagnoses."""
    goals = {"loop": goal, "supervised": supervised_goal}
    said = {"loop": "closed loop", "supervised": "supervised loop"}
    return [
        Ratio(
            f"{robot}_{name}_over_physics",
            f"{robot}_{name}",
            f"{robot}_physics",
            None,
            f"the {said[name]} of {words} over the physics steps alone",
            float(bound),
            goals[name],
        )
        for name, bound in zip(goals, bounds.split(), strict=True)
    ]


_STANDS = "palm in six directions and centre of mass, velocity limits"
RATIOS = (
    Ratio(
        *("closed_loop_over_mj_step", "closed_loop", "mj_step", "closed loop / physics alone"),
        "the whole closed loop over the physics steps alone",
        *(1.2, 1.12),
    ),
    *_loop("hexapod", "hexapod", 1.25, 1.5, "2 2.5"),
    *_loop("arm", "arm of seven joints", 2.5, 5.0, "12 30"),
    *_loop("hand", "hand of closed loops", 3.0, 6.0, "12 30"),
    *_loop("arms", "two arms with one load", 3.0, 6.0, "10 20"),
    *_loop("platform", "parallel platform", 3.0, 6.0, "10 20"),
    Ratio(
        *("loop_overhead_over_mink", "closed_loop -mj_step", "fjh_mink"),
        "control tick without physics / mink",
        "a control tick of the hexapod without physics; over one mink.solve_ik",
        *(0.25, 0.15),
    ),
    _tick(
        *("tick_over_mink", "fjh", "hexapod", "the hexapod points, strut 1 locked"),
        *(0.15, 0.08),
    ),
    _tick("arm_tick_over_mink", "arm", "arm", "camera in six directions, limits", 0.2, 0.08),
    _tick(
        *("humanoid_one_foot_tick_over_mink", "humanoid_one_foot", "humanoid on one foot"),
        *(f"29 joints, on one foot, {_STANDS}", 0.25, 0.1),
    ),
    _tick(
        *("humanoid_tick_over_mink", "humanoid", "humanoid on both feet"),
        *(f"29 joints, on both feet, {_STANDS}", 0.3, 0.12),
    ),
    _ik("arm", "arm", "arm, frame and posture"),
    _ik("mobile", "mobile base", "mobile base, frame and posture"),
    _ik("quadruped", "quadruped", "quadruped, four feet, trunk and posture"),
    _ik("humanoid", "humanoid", "humanoid, two feet, centre of mass, hand and posture"),
    Ratio(
        *("hexapod_tick_over_mink", "hexapod_tick", "fjh_mink"),
        "tick, hexapod's closed form / mink",
        "a tick in the hexapod's closed form: Jacobian, reconfiguration, mapping and apply; over "
        "one mink.solve_ik, a solver for any MJCF",
        *(0.05, 0.03, True),
    ),
    Ratio(
        *("diagnosis_over_mj_step", "diagnosis", "mj_step", "diagnosis / physics alone"),
        "one tick of the diagnosis while nothing has failed, after 2 s; over the physics steps of "
        "a control tick",
        *(0.08, 0.04, True),
    ),
    Ratio(
        *("diagnosis_worst_over_mj_step", "diagnosis_worst", "mj_step"),
        "diagnosis, worst of its ticks / physics alone",
        "the same for those ticks in which it does most",
        *(0.3, 0.15, True),
    ),
    Ratio(
        *("solve_over_daqp", "prioritized", "daqp", "one Problem 1 / daqp"),
        "one Problem 1 from J and weights; over daqp with H given",
        *(1.5, 0.8, True),
    ),
    Ratio(
        *("solve_over_placo", "prioritized", "placo", "one Problem 1 / PlaCo"),
        "the same; over PlaCo's solver with its problem given",
    ),
    Ratio(
        *("solve_over_placo_built", "prioritized", "placo_with_build"),
        "one Problem 1 / PlaCo, built",
        "the same; over PlaCo with its problem built",
        *(0.4, 0.2, True),
    ),
    Ratio(
        *("limited_over_daqp", "limited", "daqp_limited_with_build"),
        "Problem 1 with limits / daqp, built",
        "one Problem 1 with limits from J and weights; over daqp's flat program with the same "
        "limits, H built; the major task is within reach, else daqp calls it infeasible",
        *(0.5, 0.3, True),
    ),
    Ratio(
        *("limited_over_daqp_given", "limited", "daqp_limited"),
        "Problem 1 with limits / daqp",
        "the same with H given",
        *(2.0, 1.0, True),
    ),
    Ratio(
        *("hierarchy3_over_daqp", "hierarchy3", "daqp_hierarchy3"),
        "three levels with limits / daqp",
        "limits and three levels from A and b; over daqp with break_points, the last level given "
        "as H; the first two levels are within reach, else daqp solves another problem",
        *(1.5, 1.0, True),
    ),
    Ratio(
        *("batched_over_daqp", "batched", "daqp", "one mapping of a batch / daqp"),
        "one mapping of a large batch; over one by daqp with H given",
        *(0.2, 0.06, True),  # 0.1 was asked of a solver for batches alone
    ),
    Ratio(
        *("growth_over_daqp", "prioritized_n200", "daqp_n200"),
        "one Problem 1, 200 actuators / daqp",
        "one Problem 1 of 200 actuators, joint weights diagonal; over daqp with H given",
        *(1.2, 0.8, True),
    ),
    Ratio(
        *("tied_over_square", "tied_loops", "square_loops", None),
        "kinematics and mapping of six actuators, two of whose loop rows tie rates together; over "
        "the same with square loops",
        *(2.0, 1.3, True),
    ),
    Ratio(
        *("manipulability_over_tick", "manipulability", "square_loops", None),
        "kinematics and manipulability, every flag, of six actuators; over kinematics and mapping",
        *(5.0, 2.0, True),
    ),
)


def checks(summary: dict[str, Any]) -> list[Check]:
    """Stable ratios stay below their bounds, with a margin."""
    return [
        Check("ratio of medians", name, one["ratio"], one["check_bound"])
        for name, one in summary["ratios"].items()
        if one["check_bound"] is not None
    ]


def table(ratios: dict[str, Any], title: str) -> Table:
    """Each ratio beside its limits, and what it means."""
    columns = (
        Column("", "name"),
        Column("ratio", "ratio", ".3g"),
        Column("5 to 95 %", lambda one: f"{one['p5']:.3g} to {one['p95']:.3g}"),
        Column("below", "bound", "g"),
        Column("goal", "goal", "g"),
        Column("met", _met),
    )
    entries = [{"name": name} | one for name, one in ratios.items()]
    means = "\n".join(f"- {name}: {one['means']}" for name, one in ratios.items())
    return tabulate(title, columns, entries, means)


def _met(one: dict[str, Any]) -> str:
    if one["reaches_goal"]:
        return "goal"
    return {None: "", True: "bound", False: "no"}[one["within_bound"]]
