"""Recovery from failures and events as numbers, checks, tables and sentences."""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from functools import partial
from math import inf, nan
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from argument_checks.ties import least
from experiments.recover.case import sizes_of
from experiments.recover.figure import headline, pictures
from experiments.recover.predictions import ISOLABLE
from experiments.recover.recordings import record
from experiments.recover.statistics import WORST, frame_of, noise_of, statistics
from experiments.rig.checks import CLOSURE_LIMIT_M, closure_check
from experiments.rig.dither import dither_entry
from experiments.rig.events import EVENTS
from experiments.rig.mismatch import EXACT
from experiments.rig.rig import Rig
from experiments.rig.units import by_unit, sizes_said
from experiments.study.results import Check, Results
from experiments.study.resumable import origin
from experiments.study.resumable import rate as session_rate
from experiments.study.tables import Column, Table, tabulate
from ftc.fdi.diagnosis import DEFAULT_CONFIG
from ftc.fdi.separation import ACCURACY
from sim import CLOSURE_TOLERANCE

if TYPE_CHECKING:
    from experiments.recover.command import Outcome

NOT_ISOLATED, OVER_INFORMED, ALARMS_PER_HOUR, NAMED_S = 0.01, 1.10, 0.1, 0.3
"""Goals with all mismatches: share of isolable failures that are not identified, RMS error over an
informed controller's, rate of false alarms, and median time until the failed actuator is named."""
ENOUGH_H = 30.0
"""Fewer hours could not show the rate of false alarms even without any alarm; of the usual two the
check asks only that the alarms do not disprove it, by their lower bound."""
THROWN = 10.0
"""Error, in path sizes, of a run that an event throws far: loops that MuJoCo holds by soft
constraints open by a part of what the machine moves."""


def results(outcome: "Outcome | dict[str, Any]") -> Results:
    """Everything that `fjh recover` publishes."""
    if isinstance(outcome, dict):
        return replace(described(outcome), published=True)
    frame = frame_of(outcome.done.dataset.rows(), outcome.beside.get("others", []))
    summary = summarize(outcome, frame)
    merge = outcome.done.dataset.merge
    whole = [partial(record, summary, each, checks(summary)) for each in outcome.kept]
    return replace(
        described(summary),
        pictures=pictures(summary, frame),
        records=[lambda folder: merge(folder / summary["dataset"]), *whole],
    )


def described(summary: dict[str, Any]) -> Results:
    """Tables, sentences and checks, from `recover.json` alone."""
    return Results(summary, tables(summary), notes(summary), checks(summary))


def summarize(outcome: "Outcome", frame: pd.DataFrame) -> dict[str, Any]:
    """All numbers, ready for JSON: errors in sizes of the path, other units in the names."""
    rig = next(iter(outcome.rigs.values()))
    summary, noise = origin("recover", outcome.done), noise_of(rig)
    if rig.file is not None:
        summary["model_sha256"] = summary["basis"]["robot_sha256"]
    ended = frame["status"].eq("ended") | frame[[*_ENDED]].notna().any(axis=1)
    thrown = frame["peak_supervised_since"] > THROWN
    # Against the size of a mismatch runs go on to where the loops themselves are unstable.
    places = {"near": ~thrown & frame["sort"].ne("size"), "thrown": thrown}
    gaps_m = frame["closure_residual_max_m"].fillna(0.0)
    return summary | {
        "robot": rig.title,
        "actuators": list(rig.actuators),
        "major": list(rig.major),
        "path_size": rig.size,
        "sensor_noise": rig.noise,
        "encoder_noise": rig.encoder_noise,
        **by_unit("path_size", rig.size, rig.row_units),
        **by_unit("sensor_noise", rig.noise, rig.row_units),
        **by_unit("encoder_noise", rig.encoder_noise, rig.units),
        "control_period_s": rig.period_s,
        "mismatch": {name: _sizes(rig, name) for name in frame["mismatch"].unique()},
        "rules": asdict(DEFAULT_CONFIG),
        "dither": {
            name: dither_entry(d, outcome.rigs[name]) for name, d in outcome.designs.items()
        },
        "noise": noise,
        "worst_allowed": WORST,
        "separation_required": ISOLABLE,
        "sorts": dict(Counter(frame["sort"])),
        "ended": int((ended & frame["sort"].ne("event")).sum()),
        "refused": sorted({*frame.loc[frame["status"].eq("refused"), "message"]}),
        "closure_m": {name: float(gaps_m.where(at, 0.0).max()) for name, at in places.items()},
        "closure_limit_m": CLOSURE_LIMIT_M if rig.file is None else CLOSURE_TOLERANCE,
        **statistics(frame, noise),
        **outcome.predicted,
        "shown": {each.name: each.entry for each in outcome.kept},
        **_compared(outcome, frame),
    }


def _compared(outcome: "Outcome", frame: pd.DataFrame) -> dict[str, Any]:
    """Somebody else's controller in the cases with all mismatches, and in the shown runs."""
    if outcome.controller is None:
        return {}
    mixed = frame[frame["controller_failure"].notna() | frame["rms_other_after"].notna()]
    failed = [each.entry["controller_failure"] for each in outcome.kept if each.controller]
    failed += [*mixed["controller_failure"]]
    square = (mixed[["rms_other_after", "rms_informed_after"]] ** 2).mean()
    return {
        "controller": {
            "name": outcome.controller,
            "after_over_informed": float(np.sqrt(square.iloc[0] / square.iloc[1])),
            "runs": len(failed),
            "failures": [each for each in failed if isinstance(each, str)],
        }
    }


_ENDED = ("informed_ended", "unaware_ended")


def _sizes(rig: Rig, mismatch: str) -> dict[str, Any]:
    sizes = asdict(sizes_of(rig, mismatch))
    return {key: value for key, value in sizes.items() if value != getattr(EXACT, key)}


# Checks.


def checks(summary: dict[str, Any]) -> list[Check]:
    """Closed loops, runs to their end, no event in which the diagnosis does harm; and the goals."""
    closure_m, limit_m = summary["closure_m"], summary["closure_limit_m"]
    shown, events = summary["shown"].values(), summary["by_event"]
    near_m = max(closure_m["near"], *(each["closure_residual_max_m"] for each in shown), 0.0)
    found = [
        closure_check("runs near the path, at the usual sizes", near_m, limit_m),
        closure_check("runs that an event throws far", closure_m["thrown"], 10 * limit_m),
        Check("number of runs that ended early", summary["robot"], summary["ended"], 1),
    ]
    what = "largest RMS error over that of a controller that does nothing"
    for each in events:
        worst = inf if each["ended"] else each["counted_worst"]
        found.append(Check(what, each["event"], worst, WORST))
    for each in summary["healthy"] if events or "beliefs" in summary else []:
        where, named = "runs without failures or events", each["healthy_named"]["right"]
        found.append(Check("number of runs in which an actuator was named", where, named, 1))
        what = "number of runs whose commands an alarm changed"
        found.append(Check(what, where, each["commands_changed"], 1))
    return found + list(_goals(summary) if "beliefs" in summary else [])


def _goals(summary: dict[str, Any]) -> Iterator[Check]:
    """The goals of the hexapod's failures, and its shown runs."""
    beliefs, [healthy], [pairs] = (summary[key] for key in ("beliefs", "healthy", "pairs"))
    where = f"{beliefs['worst_truth']}, {beliefs['worst_belief']} diagnosed"
    what = "number of unstable pairs of true and diagnosed fault"
    yield Check(what, where, beliefs["unstable"], 1)
    failures = {e["mismatch"]: e for e in summary["by_mismatch"] if e["factor"] == 1.0}
    for name, plant in {"exact": "exact plant", "all": "all mismatches"}.items():
        entry = failures[name]
        yield _identified(f"{plant}, actuator as first named", entry["isolable_right"])
        yield _identified(f"{plant}, actuator and kind in the end", entry["isolable_all_right"])
        what = "RMS after recovery divided by that of a controller informed at once"
        yield Check(what, plant, entry["over_informed"]["after"]["pooled"], OVER_INFORMED)
    named_s = failures["all"]["named_s"]
    what = "median time until the failed actuator is named [s]"
    yield Check(what, "all mismatches", nan if named_s is None else named_s["median"], NAMED_S)
    named = sum(each["healthy_named"]["right"] for each in failures.values())
    what = "number of runs in which a healthy actuator was named"
    yield Check(what, "runs with a failure", named, 1)
    bound, side = ("high", "upper") if healthy["hours"] >= ENOUGH_H else ("low", "lower")
    what = f"{side} 95 % bound of the false alarms per hour"
    rate = healthy["alarms_per_hour"][f"{bound}_95"]
    yield Check(what, "runs without failures", nan if rate is None else rate, ALARMS_PER_HOUR)
    yield _identified("two failures in a run", pairs["handled"])
    for name, entry in summary["shown"].items():
        if "right" in entry:
            what = "wrong diagnosis of the failures or of the task (0 no, 1 yes),"
            yield Check(what, f"run {name}", float(not entry["right"]), 0.5)
    if (other := summary.get("controller")) is not None:
        what = f"number of runs in which it failed ({[*other['failures'], 'none'][0]})"
        yield Check(what, f"controller {other['name']}", len(other["failures"]), 0.5)


def _identified(where: str, rate: Mapping[str, Any]) -> Check:
    what = "share of the isolable failures that is not identified"
    missed = nan if rate["rate"] is None else 1 - rate["rate"]
    return Check(what, where, missed, NOT_ISOLATED)


# Tables and sentences.

_SENSED = {"task": "task sensor", "joints": "encoders", "both": "both"}
_CONTROLLERS = {
    "supervised": "supervised",
    "informed": "informed at once",
    "unaware": "fault-unaware",
    "other": "the other controller",
}
Cell = Callable[[Mapping[str, Any]], str | None]


def _of(key: str) -> Cell:
    """Cells of a rate: how many of how many; nothing where there is no case."""
    return lambda e: "{right} of {cases}".format(**e[key]) if e[key]["cases"] else None


def percent(rate: Mapping[str, Any]) -> str | None:
    """A rate with its interval; nothing where there is no case."""
    if not rate["cases"]:
        return None
    low, high = 100 * rate["low"], 100 * rate["high"]
    return f"{rate['right']} of {rate['cases']} ({low:.1f}-{high:.1f} %)"


def _levels(key: str) -> Cell:
    return lambda e: e[key] and "/".join(f"{1e3 * s:.0f}" for s in e[key].values())


def _error(controller: str, span: str, factor: float) -> Cell:
    def cell(entry: Mapping[str, Any]) -> str | None:
        error = entry["errors"].get(controller, {}).get(span)
        return error and f"{factor * error['rms']:.2f}/{factor * error['peak']:.1f}"

    return cell


def _ratio(other: str, span: str, *levels: str) -> Cell:
    def cell(entry: Mapping[str, Any]) -> str | None:
        ratio = entry[f"over_{other}"][span]
        return ratio and "/".join(f"{ratio[level]:.3g}" for level in levels)

    return cell


_FOUND = (
    Column("runs", "runs"),
    Column("ended", lambda e: e["ended"] or None),
    Column("alarm before", lambda e: e["alarm_before"]["right"]),
    Column("alarm", _of("detected")),
    Column("named", _of("named")),
    Column("right (95 %)", lambda e: percent(e["right"])),
    Column("isolable", _of("isolable_right")),
    Column("kind", _of("kind_right")),
    Column("healthy named", lambda e: e["healthy_named"]["right"]),
    Column("unexplained", "unexplained"),
    Column("alarm, ms", _levels("alarm_s")),
    Column("named, ms", _levels("named_s")),
)
_FOUND_LEGEND = (
    "Number of runs. alarm before: a false one, before the failure or event. named: an actuator, "
    "since then. right: the first one named is the one that failed, or, where no actuator did, the "
    "cause is named. isolable: right, of the failures that the linear model separates. kind: of "
    "the right ones, right or not told apart. healthy named: at any time. Times from the failure "
    "or event on: median/95 %/largest."
)


def _costs(summary: dict[str, Any]) -> tuple[tuple[Column, ...], str]:
    """Columns on errors and ratios of errors, and their legend."""
    units = [unit for unit in ("rad", "m") if f"path_size_{unit}" in summary]
    factor, unit = 1.0, "sizes of the path"
    if len(units) == 1:
        factor, unit = 1e6 * summary["path_size"], f"u{units[0]}"
    spans = ("since",) if summary["by_event"] else ("during", "after")
    columns = [Column("before: supervised", _error("supervised", "before", factor))]
    columns += [
        Column(f"{span}: {label}", _error(controller, span, factor))
        for span in spans
        for controller, label in _CONTROLLERS.items()
    ]
    columns += [
        Column("over informed", _ratio("informed", spans[-1], "pooled", "median", "worst")),
        Column("over doing nothing", _ratio("unaware", "since", "median", "worst")),
        Column("from recovery on", _ratio("unaware", "after", "median", "worst")),
        Column("harmed", lambda e: e["harmed"] if e["over_unaware"]["since"] else None),
        Column("task lost", lambda e: f"{e['lost_and_given_up']} of {e['lost']}" * bool(e["lost"])),
        Column("wrongly", lambda e: (e["task_lost"] - e["lost_and_given_up"]) or None),
    ]
    return tuple(columns), (
        f"RMS/largest error in {unit}: before the failure or event, during the first "
        f"{summary['recovered_from_s']:g} s, after these, and since it. over: RMS error of the "
        "supervised controller divided by that of one informed at once (all runs/median/worst), or "
        "of one that does nothing (median/worst). harmed: runs in which the latter is above "
        f"{summary['worst_allowed']:g} and the errors differ by more than the sensors' noise. task "
        "lost: given up, of those in which the other actuators cannot do it; wrongly: they can."
    )


def tables(summary: dict[str, Any]) -> list[Table]:
    """For each grouping: what was found, and what it cost; then healthy runs, and isolability."""
    sees = Column("sees", "sense", _SENSED.__getitem__)
    groups = [
        ("plants", (Column("mismatch", "mismatch"), Column("size", "factor", "g")), "by_mismatch"),
        ("failures", (sees, Column("failure", "kind")), "by_kind"),
        ("events", (Column("event", "event"),), "by_event"),
    ]
    made, title, (costs, legend) = list[Table](), summary["robot"], _costs(summary)
    for name, keys, key in groups:
        if entries := summary[key]:
            found = _table(f"{title}, {name}: found", (*keys, *_FOUND), entries, _FOUND_LEGEND)
            made += [found, _table(f"{title}, {name}: cost", (*keys, *costs), entries, legend)]
    columns = (
        *(
            sees,
            Column("runs", "runs"),
            Column("hours", "hours", ".3g"),
            Column("alarms", "alarms"),
        ),
        Column(
            "per hour", lambda e: "{low_95:.2g} to {high_95:.2g}".format(**e["alarms_per_hour"])
        ),
        Column("actuator named", lambda e: e["healthy_named"]["right"]),
        Column("commands changed", "commands_changed"),
    )
    legend = "Alarms per hour in which one is possible: two one-sided bounds at 95 %."
    if summary["healthy"]:
        made.append(_table(f"{title}, nothing happens", columns, summary["healthy"], legend))
    return [*made, *([ambiguity(summary)] if "ambiguity" in summary else [])]


def _table(
    title: str, columns: Sequence[Column], entries: Sequence[Mapping[str, Any]], legend: str
) -> Table:
    """Without the columns that are empty in all entries."""
    kept = [each for each in columns if any(each.cell(entry) for entry in entries)]
    return tabulate(title, kept, entries, legend)


def ambiguity(summary: dict[str, Any]) -> Table:
    """Smallest distances between failures over the struts, and the pairs that look alike."""
    told, entries = summary["ambiguity"], []
    frame = pd.DataFrame(told["failures"])
    for (kind, where, setting), seen in frame.groupby(["kind", "where", "setting"]):
        nearest = seen.iloc[least(seen["from_other_kinds"], ACCURACY)]
        alike = [
            f"{own}={twin['actuator']}{'' if twin['kind'] == kind else ' ?'}"
            for own, twins in zip(seen["actuator"], seen["alike"], strict=True)
            for twin in twins
        ]
        cells = {"failure": kind, "where": where, "setting": setting, "alike": ", ".join(alike)}
        cells["other strut"] = f"{seen['from_other_actuators'].min():.1f}"
        said = f"{nearest['from_other_kinds']:.1f} ({nearest['nearest_other_kind']})"
        entries.append(cells | {"other kind": said})
    headings = ("failure", "where", "setting", "other strut", "other kind", "alike")
    return tabulate(
        "Isolability: distances between failures, exact model",
        [Column(heading, heading) for heading in headings],
        entries,
        f"Distance between the outputs of a failure over {told['evidence_s']:g} s and those of the "
        "most similar failure of another strut or kind, in standard deviations; minimum over the "
        f"struts. alike: pairs with a distance below {told['alike_below']:g}; ?: of another kind.",
    )


def notes(summary: dict[str, Any]) -> list[str]:
    """What was simulated and what came of it, one sentence each."""
    lines = [headline(summary)] if summary["by_event"] or "beliefs" in summary else []
    sizes = "; ".join(
        f"{name}: " + ", ".join(f"{key} {value}" for key, value in own.items())
        for name, own in summary["mismatch"].items()
        if name in ("all", "other family")
    )
    lines.append(f"Plants differ from the model by {sizes}. {sizes_said(summary)}")
    for sense, dither in summary["dither"].items():
        what = "no dither" if dither is None else f"a dither of {dither['frequency_hz']:g} Hz"
        lines.append(f"Seen by {_SENSED[sense]}: {what}.")
    lines += [f"Not simulated: {each}." for each in summary["refused"]]
    for pairs in summary["pairs"]:
        both, handled = percent(pairs["all_right"]), percent(pairs["handled"])
        said = "identified or the task declared lost in"
        lines.append(f"Two failures in a run: both identified in {both}; {said} {handled}.")
    if "beliefs" in summary:
        cost, beliefs = summary["dither_cost"], summary["beliefs"]
        change, seed = (max(map(abs, cost[key])) for key in ("change", "reseeded"))
        lines += [
            f"Without failures the dither changes the RMS error on the exact model by {change:.1e} "
            f"sizes of the path, another seed by {seed:.1e}; on a plant with all mismatches it "
            f"moves the pointing by {cost['moved']:.2g}.",
            f"Of {beliefs['pairs_of_truth_and_belief']} pairs of true and diagnosed fault, "
            f"{beliefs['unstable']} give an unstable loop; the peak sensitivity is at most "
            f"{beliefs['sensitivity_peak_worst']:.2f}, without failures "
            f"{beliefs['sensitivity_peak_nothing_failed']:.2f}.",
        ]
    if (other := summary.get("controller")) is not None:
        failed = "".join(f" It failed: {each}." for each in other["failures"][:1])
        lines.append(
            f"With {other['name']} the RMS error after recovery is "
            f"{other['after_over_informed']:.4g} times that of the controller informed at once; it "
            f"is told of no failure, and takes no posture and no dither.{failed}"
        )
    harm = (each["event"] for each in summary["by_event"] if each["harmed"] or each["ended"])
    lines += [f"Harm in {name}: {EVENTS[name].sentence}." for name in harm]
    return lines + session_rate(summary)
