"""What events cost, as numbers and checks: against a controller that does nothing."""

from collections.abc import Sequence
from dataclasses import replace
from math import inf, sqrt
from typing import Any

import numpy as np

from experiments.recover.event_figure import pictures
from experiments.recover.event_plan import AFTER_S, EARLY_S, LATER_S
from experiments.recover.event_runs import Events
from experiments.recover.event_tables import notes, tables
from experiments.recover.rates import per_hour, rate
from experiments.rig.events import EVENTS
from experiments.rig.hexapod.metrics import CLOSURE, CLOSURE_LIMIT_M
from experiments.rig.hexapod.mismatch import ALL_SIZES, DRAWN, OTHER
from experiments.rig.hexapod.testbed import TestbedConfig
from experiments.study.campaign import Row
from experiments.study.draw import CORRELATION
from experiments.study.results import Check, Results
from experiments.study.resumable import origin
from ftc.fdi.diagnosis import DEFAULT_CONFIG
from ftc.fdi.uncertainty import TYPICAL

WORST = 1.1
"""Design requirement, in every flight: RMS error over that of a controller that does nothing."""

THROWN_URAD = 1000.0
"""Ten times the path: where a spring is lost, or a coil gives full force."""

_CLOSED = (
    ("near", "all flights within {:g} urad", CLOSURE_LIMIT_M),
    ("thrown", "flights that an event throws beyond {:g} urad", 10 * CLOSURE_LIMIT_M),
)
"""Loops that MuJoCo holds by soft constraints open by a part of what the machine moves."""

WHOLE = ("since", "after")
"""Spans of errors: from the event on, and from 0.5 s after it on."""

_BENCH = TestbedConfig()
NOISE_URAD = 1e6 * sqrt(2) * _BENCH.detector_noise_m / _BENCH.focal_length_m
"""RMS of the detector's noise, both angles: smaller differences of RMS errors do not count."""


def results(outcome: Events) -> Results:
    """Everything that `fjh recover --events` publishes."""
    summary = origin("recover", outcome.done) | summarize(outcome.done.dataset.rows())
    return replace(
        described(summary),
        pictures=pictures(summary),
        records=[lambda folder: outcome.done.dataset.merge(folder / summary["dataset"])],
    )


def described(summary: dict[str, Any]) -> Results:
    """Tables, sentences and checks, from `recover.json` alone."""
    return Results(summary, tables(summary), notes(summary), checks(summary))


def checks(summary: dict[str, Any]) -> list[Check]:
    """Closure; no flight without events changed; no event in which the diagnosis does harm."""
    sound = summary["sound"]
    where = f"{sound['duration_s']:g} s without events"
    what = "largest RMS error over that of a controller that does nothing"
    return [
        *(
            Check(CLOSURE.words, where.format(THROWN_URAD), summary["closure_m"][name], limit_m)
            for name, where, limit_m in _CLOSED
        ),
        Check("number of flights that diverged", "all flights", summary["diverged"], 1),
        Check("number of struts named", where, sound["sound_named"], 1),
        Check("number of flights whose commands an alarm changed", where, sound["changed"], 1),
        *(
            Check(what, each["event"], inf if each["ended"] else each["counted_worst"], WORST)
            for each in summary["events"]
        ),
    ]


def summarize(rows: Sequence[Row]) -> dict[str, Any]:
    """All numbers of the rows, ready for JSON, units in the names."""
    flown = [row for row in rows if row["status"] in ("flown", "ended")]
    events = [row for row in flown if row["sort"] == "event"]
    return {
        "prior": {name: getattr(TYPICAL, name) for name in DRAWN},
        "mismatch": ALL_SIZES,
        "other_family": {name: getattr(OTHER, name) / sqrt(3) for name in DRAWN}
        | {"correlation": CORRELATION},
        "at_s": {"early": EARLY_S, "later": LATER_S, "after": AFTER_S},
        "noise_urad": NOISE_URAD,
        "worst_allowed": WORST,
        "diverged": len(rows) - len(flown),
        "events": [
            counted(name, own)
            for name in EVENTS
            if (own := [row for row in events if row["event"] == name])
        ],
        "families": {
            name: over_unaware([row for row in events if row["mismatch"] == name])
            for name in sorted({row["mismatch"] for row in events})
        },
        "sound": _sound(next(row for row in rows if row["sort"] == "sound")),
        "closure_m": _closure(flown),
    }


def counted(name: str, rows: Sequence[Row]) -> dict[str, Any]:
    """What came of the flights of one event."""
    kind = EVENTS[name]
    informed = [ratio for row in rows if (ratio := over(row, "informed", "since")) is not None]

    def number(key: str) -> int:
        return sum(bool(row[key]) for row in rows)

    return {
        "event": name,
        "of": kind.of,
        "flights": len(rows),
        "ended": sum(row["status"] == "ended" for row in rows),
        "unaware_ended": number("unaware_ended"),
        **over_unaware(rows),
        "over_informed_median": float(np.median(informed)) if informed else None,
        "named_rightly": rightly(name, rows),
        **{key: number(key) for key in ("kind_right", "sound_named", "withdrawn", "unexplained")},
        "task_lost": number("task_lost"),
        "peak_urad": {who: _peak(rows, who) for who in ("supervised", "unaware")},
    }


def rightly(name: str, rows: Sequence[Row]) -> dict[str, Any] | None:
    """In how many the right actuator was named, or the cause; None: nothing is rightly named."""
    kind = EVENTS[name]
    if not (kind.named_as or kind.cause):
        return None
    return rate([bool(row["strut_right" if kind.named_as else "cause_right"]) for row in rows])


def over_unaware(rows: Sequence[Row]) -> dict[str, Any]:
    """RMS errors over those of a controller that does nothing, of flights in which both have some.

    From the event on, and from the end of its transient on, which can hide what follows; that which
    counts is the greater of both, at most 1 where errors differ by less than the detector's noise.
    """
    known = [row for row in rows if over(row, "unaware", "since") is not None]
    since, after = ([over(row, "unaware", when) or 0.0 for row in known] for when in WHOLE)
    counts = [max(_counts(row, when) for when in WHOLE) for row in known]
    return {
        "over_since": since,
        "over_after": after,
        "over_median": float(np.median(since)) if since else None,
        "counted": counts,
        "counted_worst": max(counts, default=0.0),
        "harmed": sum(each > WORST for each in counts),
    }


def over(row: Row, controller: str, when: str) -> float | None:
    """RMS error of the supervised controller over that of another one; None: one has none."""
    ours, theirs = (row[f"rms_{who}_{when}_urad"] for who in ("supervised", controller))
    return None if ours is None or theirs is None else ours / theirs


def _counts(row: Row, when: str) -> float:
    ours, theirs = (row[f"rms_{who}_{when}_urad"] for who in ("supervised", "unaware"))
    return counted_ratio(ours, theirs, NOISE_URAD)


def counted_ratio(ours: float, theirs: float, noise: float) -> float:
    """RMS error over another one; at most 1 where they differ by less than the sensors' noise."""
    return ours / theirs if ours - theirs > noise else min(ours / theirs, 1.0)


def _peak(rows: Sequence[Row], who: str) -> float | None:
    peaks = [row[f"peak_{who}_{when}_urad"] for row in rows for when in ("during", "after")]
    return max((peak for peak in peaks if peak is not None), default=None)


def _closure(rows: Sequence[Row]) -> dict[str, float]:
    """Largest residual of flights that stay near, and of those that an event throws far."""
    largest = {"near": 0.0, "thrown": 0.0}
    for row in rows:
        where = "thrown" if (_peak([row], "supervised") or 0.0) > THROWN_URAD else "near"
        largest[where] = max(largest[where], row["closure_residual_max_m"] or 0.0)
    return largest


def _sound(row: Row) -> dict[str, Any]:
    hours = max(row["duration_s"] - DEFAULT_CONFIG.learning_s, 0.0) / 3600
    return {
        "duration_s": row["duration_s"],
        **per_hour(row["alarms"] or 0, hours),
        "sound_named": int(bool(row["sound_named"])),
        "changed": int(bool(row["commands_changed"])),
    }
