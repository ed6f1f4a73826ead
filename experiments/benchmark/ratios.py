"""The published ratios: what they compare, their limits, and those of a saved run."""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from experiments.study.files import published, write_json
from experiments.study.results import Check
from experiments.study.study import WrongInput
from experiments.study.tables import Column, Table, tabulate
from sim import Array

CHECK_MARGIN = 3.0
"""A stable ratio fails beyond this multiple of its bound: between processors alone, the same code
scattered up to 2.3 times it."""
_FORMERLY = {"tick_over_mink": "hexapod_tick_over_mink", "tick": "hexapod_tick"}
"""Before the general path was timed, these names stood for the closed form."""


@dataclass(frozen=True)
class Ratio:
    """A quotient of medians, by its name in `bench.json`.

    `of` computes it from the medians by name. It must be below `bound`, and should be at most
    `goal`; None: it is reported only. A `stable` one scatters so little that a commit may fail on
    it: docs/performance.md.
    """

    name: str
    of: Callable[[Mapping[str, Any]], Any]
    means: str
    bound: float | None = None
    goal: float | None = None
    stable: bool = False

    @property
    def check_bound(self) -> float | None:
        """From where on `--check` fails; None: never."""
        return CHECK_MARGIN * self.bound if self.stable and self.bound is not None else None

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


def _robot_tick(robot: str, what: str) -> Ratio:
    return Ratio(
        f"{robot}_tick_over_mink",
        lambda us: us[f"{robot}_tick"] / (us[f"{robot}_mink"] + us[f"{robot}_mink_update"]),
        f"the general path with velocity limits: {robot}, {what}; over mink's "
        "Configuration.update and solve_ik with the same limits",
        bound=0.5,
        goal=0.2,
    )


def _ik_tick(robot: str, what: str) -> Ratio:
    return Ratio(
        f"ik_{robot}_over_mink",
        lambda us: us[f"ik_{robot}"] / us[f"ik_{robot}_mink"],
        f"fjh.Ik, tasks in strict levels under ranges and a velocity limit: {robot}, {what}; over "
        "mink's Configuration.update and solve_ik of the same tasks, weighed",
        bound=1.0,
        goal=0.1,
    )


RATIOS = (
    Ratio(
        "closed_loop_over_mj_step",
        lambda us: us["closed_loop"] / us["mj_step"],
        "the whole closed loop over the physics steps alone",
        bound=1.25,
        goal=1.12,
    ),
    Ratio(
        "loop_overhead_over_mink",
        lambda us: (us["closed_loop"] - us["mj_step"]) / us["mink"],
        "a control tick without physics, mapping in the hexapod's closed form; over one "
        "mink.solve_ik",
        bound=0.25,
        goal=0.15,
    ),
    Ratio(
        "tick_over_mink",
        lambda us: us["tick"] / (us["mink"] + us["mink_update"]),
        "a tick by the general path, for any MJCF: kinematics, jacobians, reconfiguration, mapping "
        "and apply; over mink's Configuration.update and solve_ik",
        bound=0.4,
        goal=0.2,
        stable=True,
    ),
    _robot_tick("arm", "models/arm.xml, camera in six directions"),
    _robot_tick("humanoid", "29 joints, on both feet, palm in six directions and centre of mass"),
    _ik_tick("arm", "frame and posture"),
    _ik_tick("mobile", "frame and posture"),
    _ik_tick("quadruped", "four feet, trunk and posture"),
    _ik_tick("humanoid", "two feet, centre of mass, hand and posture"),
    Ratio(
        "hexapod_tick_over_mink",
        lambda us: us["hexapod_tick"] / us["mink"],
        "a tick in the hexapod's closed form: Jacobian, reconfiguration, mapping and apply; over "
        "one mink.solve_ik, a solver for any MJCF",
        bound=0.08,
        goal=0.04,
        stable=True,
    ),
    Ratio(
        "diagnosis_over_mj_step",
        lambda us: us["diagnosis"] / us["part_mj_step"],
        "one tick of the diagnosis while nothing has failed, after 2 s; over the eight physics "
        "steps of a control tick",
        bound=0.15,
        goal=0.05,
        stable=True,
    ),
    Ratio(
        "solve_over_daqp",
        lambda us: us["prioritized"] / us["daqp"],
        "one Problem 1 from J and weights; over daqp with H given",
        bound=1.5,
        goal=0.8,
        stable=True,
    ),
    Ratio(
        "solve_over_placo",
        lambda us: us["prioritized"] / us["placo"],
        "the same; over PlaCo's solver with its problem given",
    ),
    Ratio(
        "solve_over_placo_built",
        lambda us: us["prioritized"] / us["placo_with_build"],
        "the same; over PlaCo with its problem built",
        bound=0.4,
        goal=0.2,
        stable=True,
    ),
    Ratio(
        "limited_over_daqp",
        lambda us: us["limited"] / us["daqp_limited_with_build"],
        "one Problem 1 with limits from J and weights; over daqp's flat program with the same "
        "limits, H built; the major task is within reach, else daqp calls it infeasible",
        bound=1.0,
        goal=0.4,
        stable=True,
    ),
    Ratio(
        "hierarchy3_over_daqp",
        lambda us: us["hierarchy3"] / us["daqp_hierarchy3"],
        "limits and three levels from A and b; over daqp with break_points, the last level given "
        "as H; the first two levels are within reach, else daqp solves another problem",
        bound=2.5,
        goal=1.0,
        stable=True,
    ),
    Ratio(
        "batched_over_daqp",
        lambda us: us["batched"] / us["daqp"],
        "one mapping of a large batch; over one by daqp with H given",
        bound=0.12,
        goal=0.08,
        stable=True,
    ),
    Ratio(
        "growth_over_daqp",
        lambda us: us["prioritized_n200"] / us["daqp_n200"],
        "one Problem 1 of 200 actuators, joint weights diagonal; over daqp with H given",
        bound=1.2,
        goal=0.8,
        stable=True,
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


def save(path: Path, summary: dict[str, Any]) -> None:
    """Write the numbers for a later `--compare`."""
    with published(path.parent, index=path.name) as staging:
        write_json(staging / path.name, summary)


def saved(path: Path) -> dict[str, Any]:
    """The `bench.json` of an earlier run, every number under the name that it has now.

    Raises:
        WrongInput: There is no such file, or something else is in it.
    """
    try:
        summary = json.loads(path.read_bytes())
        if summary["experiment"] == "bench":
            compare(summary, summary)  # it has all that a comparison reads
            return _renamed(summary)
    except OSError as error:
        raise WrongInput(f"--compare {path} cannot be read: {error.strerror}") from None
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError):
        pass
    raise WrongInput(f"--compare {path} was not written by this fjh bench")


def _renamed(summary: dict[str, Any]) -> dict[str, Any]:
    if "hexapod_tick" in summary["timings"]:
        return summary
    named = {
        kind: {_FORMERLY.get(name, name): one for name, one in summary[kind].items()}
        for kind in ("ratios", "timings")
    }
    return summary | named | {"renamed": _FORMERLY}


def compare(now: dict[str, Any], before: dict[str, Any]) -> dict[str, Any]:
    """What both runs have timed: now over before, and whether that is more than noise.

    It is when the ranges from the 5th to the 95th percentile have nothing in common. `renamed`:
    names whose meaning has changed since, each with the name under which its numbers are compared.
    """

    def changes(kind: str, key: str, unit: str) -> dict[str, dict[str, Any]]:
        low, high, found = f"p5{unit}", f"p95{unit}", {}
        for name in filter(before[kind].__contains__, now[kind]):
            old, new = before[kind][name], now[kind][name]
            ratio, changed = new[key] / old[key], new[low] > old[high] or new[high] < old[low]
            found[name] = {"saved": old[key], "now": new[key]}
            found[name] |= {"now_over_saved": ratio, "changed": changed}
        return found

    return {
        "saved_simulated_s": before["simulated_s"],
        "renamed": before.get("renamed", {}),
        "ratios": changes("ratios", "ratio", ""),
        "timings": changes("timings", "median_us", "_us"),
    }
