"""The table and the figure of a run: `python -m benchmarks.table RUN.json [FOLDER] [--check]`.

RUN.json is what pytest-benchmark wrote (`make bench`). With --check the exit code is 1 if a ratio
that hardly scatters exceeds three times its bound: between processors alone, the same code
scattered up to 2.3 times it.
"""

import json
import sys
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

from matplotlib.figure import Figure

MARGIN = 3.0


class Ratio(NamedTuple):
    """One time over another, by names of contenders.

    Attributes:
        words: What is compared.
        over: What is timed.
        under: What it is divided by.
        bound: It should be below; None: reported only.
        goal: It should reach; None likewise.
        stable: Whether it scatters so little that a commit may fail on it.
    """

    words: str
    over: str
    under: str
    bound: float | None = None
    goal: float | None = None
    stable: bool = False


def _loop(robot: str, *limits: float) -> list[Ratio]:
    bound, supervised, goal, its_goal = limits
    physics = f"{robot}_physics"
    return [
        Ratio(f"{robot}: closed loop / physics", f"{robot}_loop", physics, bound, goal),
        Ratio(f"{robot}: with diagnosis", f"{robot}_supervised", physics, supervised, its_goal),
    ]


def _tick(robot: str, bound: float, goal: float) -> Ratio:
    words = f"tick, {robot.replace('_', ' ')} / mink"
    return Ratio(words, f"{robot}_tick", f"{robot}_mink", bound, goal, True)


RATIOS = (
    *_loop("hexapod", 2.0, 2.5, 1.25, 1.5),
    *_loop("arm", 12.0, 30.0, 2.5, 5.0),
    *_loop("hand", 12.0, 30.0, 3.0, 6.0),
    *_loop("arms", 10.0, 20.0, 3.0, 6.0),
    *_loop("platform", 10.0, 20.0, 3.0, 6.0),
    _tick("hexapod", 0.15, 0.08),
    _tick("arm", 0.2, 0.08),
    _tick("ur5e", 0.3, 0.12),
    _tick("humanoid_one_foot", 0.25, 0.1),
    _tick("humanoid", 0.3, 0.12),
    *(
        Ratio(f"inverse kinematics, {name} / mink", f"ik_{name}", f"ik_{name}_mink", 1.0, 0.1)
        for name in ("arm", "mobile", "quadruped", "humanoid")
    ),
    Ratio("one Problem 1 / daqp, matrices given", "prioritized", "daqp", 1.5, 0.8, True),
    Ratio("one Problem 1 / daqp, built", "prioritized", "daqp_built"),
    Ratio("one Problem 1 / PlaCo, problem given", "prioritized", "placo"),
    Ratio("one Problem 1 / PlaCo, built", "prioritized", "placo_built", 0.4, 0.2, True),
    Ratio("one Problem 1 / LAPACK's dgglse", "prioritized", "dgglse"),
    Ratio("one Problem 1 / eq. (25) by pinv", "prioritized", "pinv_formula"),
    Ratio("limits / daqp, matrices given", "prioritized_limited", "daqp_limited", 2.0, 1.0, True),
    Ratio("limits / daqp, built", "prioritized_limited", "daqp_built_limited", 0.5, 0.3, True),
    Ratio("three levels / daqp, matrices given", "levels", "daqp_levels", 1.5, 1.0, True),
    Ratio("three levels / daqp, built", "levels", "daqp_levels_built"),
    Ratio("one of a batch of 10,000 / daqp", "prioritized_batch", "daqp", 0.2, 0.06, True),
    Ratio("one of 200 actuators / daqp", "prioritized_n200", "daqp_n200", 1.2, 0.8, True),
)


def times_us(run: dict[str, Any]) -> dict[str, float]:
    """Time of one tick or mapping by contender: the median over the turns of pytest-benchmark."""
    found: dict[str, list[float]] = {}
    for each in run["benchmarks"]:
        info = each["extra_info"]
        found.setdefault(info["name"], []).append(1e6 * each["stats"]["median"] / info["units"])
    return {name: median(times) for name, times in found.items()}


def table(us: dict[str, float]) -> str:
    """All ratios whose times there are, in Markdown."""
    lines = ["| compared | us | beside | ratio | bound | goal |", "| --- |" + " --- |" * 5]
    for each in measured(us):
        over, under = us[each.over], us[each.under]
        limits = ["" if limit is None else f"{limit:g}" for limit in (each.bound, each.goal)]
        cells = [each.words, f"{over:.3g}", f"{under:.3g}", f"{over / under:.3g}", *limits]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def measured(us: dict[str, float]) -> list[Ratio]:
    """The ratios whose times there are."""
    return [each for each in RATIOS if {each.over, each.under} <= us.keys()]


def exceeding(us: dict[str, float]) -> list[str]:
    """A sentence on each stable ratio beyond its bound and margin."""
    return [
        f"{each.words}: {us[each.over] / us[each.under]:.3g}, expected below "
        f"{MARGIN * each.bound:g}"
        for each in measured(us)
        if each.stable and each.bound and us[each.over] > MARGIN * each.bound * us[each.under]
    ]


def figure(us: dict[str, float]) -> Figure:
    """The ratios on a logarithmic axis, left of 1 this library is the faster; goals as ticks."""
    shown = measured(us)[::-1]
    drawn = Figure(figsize=(7.0, 0.26 * len(shown) + 0.8), layout="constrained")
    axes, rows = drawn.add_subplot(), range(len(shown))
    axes.axvline(1.0, color="0.6", linewidth=1.0)
    axes.plot([us[one.over] / us[one.under] for one in shown], rows, "o", color="#0072b2")
    goals = [(one.goal, row) for row, one in zip(rows, shown, strict=True) if one.goal]
    axes.plot(*zip(*goals, strict=True), "|", color="#d55e00", markersize=10, label="goal")
    axes.set_yticks(rows, [one.words for one in shown], fontsize=8)
    axes.set(xscale="log", xlabel="time over the other's")
    axes.grid(axis="x", color="0.9")
    axes.legend(loc="lower right")
    return drawn


def main(words: list[str]) -> int:
    """Print the table, write it with the figure, and say which ratios exceed their bounds."""
    files = [Path(word) for word in words if not word.startswith("--")]
    us = times_us(json.loads(files[0].read_text(encoding="utf-8")))
    print(table(us))
    for folder in files[1:]:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "bench.md").write_text(f"{table(us)}\n", encoding="utf-8")
        figure(us).savefig(folder / "bench.png", dpi=150)
    wrong = exceeding(us) if "--check" in words else []
    print(*wrong, sep="\n")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
