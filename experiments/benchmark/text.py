"""Speed in print, from `bench.json`."""

from typing import Any

from experiments.benchmark.extra import PACKAGES
from experiments.benchmark.summary import complaint
from experiments.benchmark.tables import (
    SOLVE,
    TICK,
    changes_table,
    growth_tables,
    parts_table,
    ratio_table,
    times_table,
)
from experiments.output.findings import Findings, Picture

PICTURES = [
    Picture(
        "bench.png",
        "How the time of one Problem 1 grows with the number of actuators, and the time of one "
        "mapping with the size of the batch.",
        "Two panels with logarithmic axes. Left: five rising lines, microseconds against 6 to 200 "
        "actuators. Right: a line that falls with the size of the batch, beside the level lines "
        "of single solves.",
    )
]


def findings(summary: dict[str, Any], *, check: bool = False) -> Findings:
    """Ratios first, then what they are made of; a time is unsound only when that is asked for."""
    tables = [
        ratio_table(summary),
        times_table("One control tick, us", TICK, summary),
        parts_table(summary["tick_parts_us"]),
        times_table("One Problem 1, hexapod's size, us", SOLVE, summary),
        *growth_tables(summary["growth"]),
    ]
    if "comparison" in summary:
        tables.append(changes_table(summary["comparison"]))
    return Findings(
        summary, tables, _notes(summary), PICTURES, complaint(summary) if check else None
    )


def _notes(summary: dict[str, Any]) -> list[str]:
    furthest = max(
        one["distances"][name] / one["tolerance"]
        for one in summary["agreement"]
        for name in one["distances"]
    )
    names = ("mujoco", "numpy", "scipy", *PACKAGES)
    notes = [
        f"The spiral runs {summary['real_time_factor']:.1f} times as fast as the clock.",
        f"All answers agreed before they were timed, on {len(summary['agreement'])} sets of "
        f"questions; the furthest used {100 * furthest:.2g} % of its tolerance.",
        f"One process, one thread, {summary['rounds']} rounds by turns, on "
        f"{summary['machine']['processor']}; "
        + ", ".join(f"{name} {summary['versions'][name]}" for name in names)
        + ".",
    ]
    now_s = summary["simulated_s"]
    saved_s = summary["comparison"]["saved_simulated_s"] if "comparison" in summary else now_s
    if saved_s != now_s:
        notes.append(
            f"The saved run flew {saved_s:g} s of the spiral, this one {now_s:g} s: with --quick "
            "the loop settles for a larger part of its time, and batches are smaller."
        )
    renamed = summary["comparison"]["renamed"] if "comparison" in summary else {}
    notes += [
        f"The saved run's {before} was measured with the closed form; it is compared with {now}."
        for before, now in renamed.items()
    ]
    return notes
