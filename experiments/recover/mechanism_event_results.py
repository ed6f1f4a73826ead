"""What events cost any robot, as numbers, table, sentences and checks."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from math import inf, sqrt
from typing import Any

import numpy as np

from experiments.recover.event_results import WHOLE, WORST, counted_ratio, rightly
from experiments.recover.event_tables import headline
from experiments.recover.mechanism_events import AFTER_S, MechanismEvents
from experiments.recover.mechanism_results import machine
from experiments.rig.checks import closure_check
from experiments.rig.dither import dither_entry
from experiments.rig.events import EVENTS
from experiments.rig.units import sizes_said
from experiments.study.campaign import Row
from experiments.study.results import Check, Results
from experiments.study.resumable import origin
from experiments.study.tables import Column, Table, tabulate


def results(outcome: MechanismEvents) -> Results:
    """Everything that `fjh recover --model --events` publishes."""
    summary = origin("recover", outcome.done) | summarize(outcome, outcome.done.dataset.rows())
    return replace(
        described(summary),
        records=[lambda folder: outcome.done.dataset.merge(folder / summary["dataset"])],
    )


def described(summary: dict[str, Any]) -> Results:
    """Table, sentences and checks, from `recover.json` alone."""
    return Results(summary, [_table(summary)], _notes(summary), checks(summary))


def checks(summary: dict[str, Any]) -> list[Check]:
    """Closure, and no event in which the diagnosis does harm."""
    what = "largest RMS error over that of a controller that does nothing"
    return [
        closure_check(summary),
        *(
            Check(what, each["event"], inf if each["ended"] else each["counted_worst"], WORST)
            for each in summary["events"]
        ),
    ]


def summarize(outcome: MechanismEvents, rows: Sequence[Row]) -> dict[str, Any]:
    """All numbers of its rows, ready for JSON."""
    rig, flown = outcome.rig, [row for row in rows if row["status"] != "refused"]
    noise = sqrt(len(rig.major)) * rig.noise / rig.size
    own = {name: [row for row in flown if row["event"] == name] for name in EVENTS}
    residuals_m = [row["closure_residual_max_m"] for row in flown if row["status"] == "flown"]
    return {
        "model_sha256": outcome.model_sha256,
        **machine(rig),
        "dither": dither_entry(outcome.dither, rig),
        "noise": noise,
        "worst_allowed": WORST,
        "events": [counted(name, each, noise) for name, each in own.items() if each],
        "refused": sorted({row["message"] for row in rows if row["status"] == "refused"}),
        "closure_residual_max_m": max(residuals_m, default=0.0),
    }


def counted(name: str, rows: Sequence[Row], noise: float) -> dict[str, Any]:
    """What came of the flights of one event; `noise` in sizes of the path."""
    both = [row for row in rows if row["status"] == "flown" and not row["unaware_ended"]]
    pairs = {
        when: [(row[f"rms_supervised_{when}"], row[f"rms_unaware_{when}"]) for row in both]
        for when in WHOLE
    }
    over = {when: [ours / theirs for ours, theirs in each] for when, each in pairs.items()}
    counts = [
        max(counted_ratio(ours, theirs, noise) for ours, theirs in each)
        for each in zip(*pairs.values(), strict=True)
    ]
    return {
        "event": name,
        "flights": len(rows),
        "ended": sum(row["status"] == "ended" for row in rows),
        "over_since": over["since"],
        "over_after": over["after"],
        "over_median": float(np.median(over["since"])) if both else None,
        "counted_worst": max(counts, default=0.0),
        "harmed": sum(each > WORST for each in counts),
        "named_rightly": rightly(name, rows),
        **{
            key: sum(bool(row[key]) for row in rows)
            for key in ("sound_named", "withdrawn", "unexplained", "task_lost")
        },
    }


def _table(summary: dict[str, Any]) -> Table:
    """One row for each event."""
    columns = (
        Column("event", "event"),
        Column("flights", "flights"),
        Column("over doing nothing: median", "over_median", ".2f"),
        Column("worst", partial(_worst, "since"), ".2f"),
        Column("worst from 0.5 s on", partial(_worst, "after"), ".2f"),
        Column("harmed", "harmed"),
        Column("named", "named_rightly", "{0[right]} of {0[cases]}".format),
        Column("sound named", "sound_named"),
        Column("unexplained", "unexplained"),
        Column("given up", "task_lost"),
    )
    legend = (
        "over doing nothing: RMS error of all major rows from the event on, divided by that of the "
        "same controller without diagnosis. harmed: flights in which it, or that from 0.5 s on, is "
        f"above {summary['worst_allowed']:g} and the errors differ by more than the sensors' "
        f"noise, {summary['noise']:.2g} sizes of the path. named: the first actuator named is the "
        "one that failed, or what happened is, where it is no failure. sound named: flights in "
        "which one was named that had not. given up: flights in which the task was."
    )
    return tabulate(f"{summary['robot']}: what events cost", columns, summary["events"], legend)


def _notes(summary: dict[str, Any]) -> list[str]:
    """What was flown, and what the robot cannot have."""
    flights = sum(each["flights"] for each in summary["events"])
    return [
        f"{headline(summary)} {flights} flights on a circle, each with one event, which go on for "
        f"{AFTER_S:g} s from it on; plants differ from the model as in the study of failures. "
        f"{sizes_said(summary)}",
        *(f"Not flown: {each}." for each in summary["refused"]),
    ]


def _worst(when: str, entry: dict[str, Any]) -> float | None:
    return max(entry[f"over_{when}"], default=None)
