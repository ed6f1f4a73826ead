"""Numbers in sentences on diagnosis, robots and speed, by name; docs/data has the results."""

import math
import re
from collections.abc import Callable, Iterable
from typing import Any

import pandas as pd
from results import DOCS, count, interval, is_shown, pooled, row, rows, study

from experiments.recover.tables import WORST

# docs/recover.md


def _failures(mismatch: str, factor: float = 1.0) -> Any:
    return row("recover", "by_mismatch", mismatch=mismatch, factor=factor)


def _single() -> list[Any]:
    """Return the groups of failures at the usual size of each mismatch."""
    return rows("recover", "by_mismatch", factor=1.0)


def _together(groups: Iterable[Any], key: str) -> str:
    return count(pooled(groups, key), key)


def _alone() -> list[Any]:
    together = ("exact", "all", "other family")
    return [group for group in _single() if group["mismatch"] not in together]


def _over_informed(*kinds: str) -> str:
    groups = (row("recover", "by_kind", kind=kind) for kind in kinds)
    return f"{max(group['over_informed_after_worst'] for group in groups):.2f}"


def _dither_cost(key: str) -> float:
    """Return the largest change of a pointing error by the dither, in microradians."""
    result = study("recover")
    return 1e6 * result["path_size_rad"] * max(abs(r[key]) for r in result["dither_cost"])


def _separation(setting: str) -> float:
    """Return the least separation of a locked strut from failures of other struts."""
    found = rows("recover", "ambiguity", setting=setting, kind="locked")
    return min(one["from_other_actuators"] for one in found)


def _x(mismatch: str, factor: float) -> str:
    return count(_failures(mismatch, factor), "right").replace(" of ", "/")


def _drifts() -> str:
    drifts = (_failures(f"{name}_per_s", 100.0) for name in ("drift_urad", "gain_drift"))
    return _together(list(drifts), "right").replace(" of ", "/")


def _pairs() -> str:
    [pairs] = rows("recover", "pairs")
    return count(pairs, "handled")


# Events.


def _events(name: str = "events") -> list[Any]:
    """Return the groups of runs of each kind of event that the robot can have."""
    groups = rows(name, "by_event")
    return [group for group in groups if group["over_unaware_since_median"] is not None]


def _others() -> list[float]:
    medians = {one["event"]: one["over_unaware_since_median"] for one in _events()}
    return [median for event, median in medians.items() if not is_shown(event)]


def _worst(name: str) -> float:
    return max(group["counted_worst"] for group in _events(name))


def _harmless(name: str) -> str:
    groups = _events(name)
    return f"{sum(group['counted_worst'] <= WORST for group in groups)} of {len(groups)}"


def _harmed(name: str) -> str:
    """Return in how many runs diagnosis increases the error by more than a tenth."""
    groups = _events(name)
    return "{} of {}".format(*(sum(group[key] for group in groups) for key in ("harmed", "runs")))


def _most_healthy() -> str:
    """Return the two kinds of event with most wrong diagnoses, as "hum (6) and strong (5)"."""
    groups = sorted(_events(), key=lambda group: -group["healthy_named_count"])[:2]
    return " and ".join(f"{one['event']} ({one['healthy_named_count']})" for one in groups)


def _isolated(robot: str) -> str:
    """Return how many failures the designed dither isolates with all sensors, as "10 of 12"."""
    cases = sum(kind["runs"] for kind in rows(robot, "by_kind", sense="both"))
    return f"{len(study(robot)['dither']['both']['isolable'])} of {cases}"


def _over_unaware(event: str) -> str:
    return f"{row('events', 'by_event', event=event)['over_unaware_since_median']:.2f}"


# docs/performance.md


def _ratios(question: str, role: str = "") -> str:
    """Return the least and largest ratio of times for such questions, as "0.59 to 1.03"."""
    ratios = [
        group["ratio"]
        for group in rows("bench", "ratios")
        if re.fullmatch(question, group["question"]) and group["over"].startswith(role)
    ]
    return " to ".join(dict.fromkeys(f"{number:.2g}" for number in (min(ratios), max(ratios))))


def _with_goal() -> list[Any]:
    return [group for group in rows("bench", "ratios") if group["goal"] is not None]


def _given() -> str:
    """Return the range of the ratios to daqp with given matrices, of small problems."""
    small = ("problem_1", "limited", "three_levels")
    ratios = [
        group["ratio"]
        for group in rows("bench", "ratios", under="daqp")
        if group["question"] in small
    ]
    return f"{min(ratios):.2g} to {max(ratios):.2g}"


def _met() -> str:
    return str(sum(group["ratio"] <= group["goal"] for group in _with_goal()))


def _pandas() -> pd.DataFrame:
    """Return the runs of the Panda with a failure, at all steps."""
    files = (DOCS / "data" / f"panda_{step}ms" / "recover.parquet" for step in (1, 2, 5))
    runs = pd.concat([pd.read_parquet(file) for file in files])
    return runs[runs.sort == "failure"]


def _lost_tasks() -> str:
    runs = _pandas()
    return f"{(runs.rms_supervised_after > LOST).sum()} of {len(runs)}"


LOST = 10.0
"""RMS error, in sizes of the path, of a lost task."""


# README.md


def _lock(key: str) -> str:
    """Return the RMS error of all rows of the arm together [mm]."""
    return f"{1e3 * math.hypot(*study('lock')[key]):.2g}"


def _healthy(key: str) -> dict[str, Any]:
    return pooled(rows("recover", "healthy"), key)


VALUES: dict[str, Callable[[], str]] = {
    "panda.lost": _lost_tasks,
    "panda.informed": lambda: str((_pandas().rms_informed_after > LOST).sum()),
    "recover.all": lambda: count(_failures("all"), "right"),
    "recover.all_interval": lambda: interval(_failures("all"), "right"),
    "recover.median": lambda: f"{1e3 * _failures('all')['named_median_s']:.0f}",
    "recover.slowest": lambda: f"{1e3 * _failures('all')['named_largest_s']:.0f}",
    "recover.other": lambda: count(_failures("other family"), "right"),
    "recover.other_interval": lambda: interval(_failures("other family"), "right"),
    "recover.hours": lambda: f"{sum(one['hours'] for one in rows('recover', 'healthy')):.3g}",
    "recover.alarms": lambda: str(sum(one["alarms"] for one in rows("recover", "healthy"))),
    "recover.healthy": lambda: count(_healthy("healthy_named"), "healthy_named"),
    "recover.healthy_interval": lambda: interval(_healthy("healthy_named"), "healthy_named"),
    "recover.hourly": lambda: "{:.2g}".format(
        max(one["alarms_per_hour_high_95"] for one in rows("recover", "healthy"))
    ),
    "recover.alone": lambda: _together(_alone(), "right"),
    "recover.exact": lambda: count(_failures("exact"), "right"),
    "recover.early": lambda: str(sum(one["alarm_before_count"] for one in _single())),
    "recover.rigid_over": lambda: _over_informed("locked", "free"),
    "recover.weak_over": lambda: _over_informed("weak"),
    "recover.pairs": _pairs,
    "recover.dither": lambda: f"{_dither_cost('change'):.0e}".replace("e-0", "e-"),
    "recover.moved": lambda: f"{_dither_cost('moved'):.2f}",
    "recover.alike": lambda: f"{_separation('angles'):.1f}",
    "recover.least": lambda: f"{_separation('angles, dither'):.0f}",
    "recover.beliefs": lambda: str(len({one["belief"] for one in rows("recover", "beliefs")})),
    "recover.truths": lambda: str(len({one["truth"] for one in rows("recover", "beliefs")})),
    "recover.all_x3": lambda: _x("all", 3.0),
    "recover.drifts_x100": _drifts,
    "recover.inertia_x30": lambda: _x("inertia", 30.0),
    "recover.damping_x3": lambda: _x("damping", 3.0),
    "events.kinds": lambda: str(len(_events())),
    "events.worst": lambda: f"{_worst('events'):.2f}",
    "events.others": lambda: str(len(_others())),
    "events.low": lambda: f"{min(_others()):.2f}",
    "events.high": lambda: f"{max(_others()):.2f}",
    "events.healthy": lambda: _together(_events(), "healthy_named"),
    "events.healthy_interval": lambda: interval(
        pooled(_events(), "healthy_named"), "healthy_named"
    ),
    "events.most_healthy": _most_healthy,
    "arm.ratio": lambda: f"{_worst('arm_events'):.2f}",
    "hand.ratio": lambda: f"{_worst('hand_events'):.1f}",
    "lock.with": lambda: _lock("rms_after"),
    "lock.without": lambda: _lock("rms_after_without_diagnosis"),
    "lock.delay": lambda: f"{1e3 * study('lock')['diagnoses'][0]['delay_s']:.0f}",
    "robots.models": lambda: str(study("robots")["models"]),
    "robots.completed": lambda: str(study("robots")["completed"]),
    "robots.wrong": lambda: count(study("robots"), "healthy_wrong"),
    "arm.runs": lambda: _harmed("arm_events"),
    "hand.harmless": lambda: _harmless("hand_events"),
    "hand.runs": lambda: _harmed("hand_events"),
    "diagnosis.arm": lambda: _isolated("arm"),
    "diagnosis.arms": lambda: _isolated("arms"),
    "diagnosis.hand": lambda: _isolated("hand"),
    "diagnosis.platform": lambda: _isolated("platform"),
    "bench.hexapod": lambda: _ratios("loop_hexapod", "loop"),
    "bench.hexapod_diagnosed": lambda: _ratios("loop_hexapod", "supervised"),
    "bench.robots": lambda: _ratios(r"loop_(?!hexapod)\w+", "loop"),
    "bench.robots_diagnosed": lambda: _ratios(r"loop_(?!hexapod)\w+", "supervised"),
    "bench.tick": lambda: _ratios(r"tick_\w+"),
    "bench.ik": lambda: _ratios(r"ik_\w+"),
    "bench.given": _given,
    "bench.goals": lambda: str(len(_with_goal())),
    "bench.met": _met,
    "track.locked": lambda: _over_unaware("locked"),
    "track.stuck": lambda: _over_unaware("stuck"),
}
