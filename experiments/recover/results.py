"""Recovery from failures and events as numbers, checks, tables and sentences."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from functools import partial
from itertools import chain
from math import inf, nan
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from experiments.recover.figure import headline, pictures
from experiments.recover.plan import BENCH, exact_rig, sizes_of
from experiments.recover.predictions import ALIKE, EVIDENCE_S, ISOLABLE
from experiments.recover.recordings import record
from experiments.recover.statistics import WORST, frame_of, noise_of, statistics
from experiments.rig.checks import CLOSURE_LIMIT_M, closure_check
from experiments.rig.dither import dither_entry
from experiments.rig.events import EVENTS
from experiments.rig.hexapod.fault_tolerance import DITHER
from experiments.rig.hexapod.metrics import plant_constants
from experiments.rig.mismatch import EXACT
from experiments.rig.units import by_unit, sizes_said
from experiments.study.results import Check, Results
from experiments.study.resumable import origin
from experiments.study.resumable import rate as session_rate
from experiments.study.tables import Column, Table, tabulate
from ftc.fdi.diagnosis import DEFAULT_CONFIG
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
    summary, kept = summarize(outcome, frame), outcome.beside.get("kept", [])
    whole = [partial(record, summary, each, checks(summary)) for each in kept]
    return replace(
        described(summary),
        pictures=pictures(summary, frame),
        records=[lambda to: outcome.done.dataset.merge(to / summary["dataset"]), *whole],
    )


def described(summary: dict[str, Any]) -> Results:
    """Tables, sentences and checks, from `recover.json` alone."""
    return Results(summary, tables(summary), notes(summary), checks(summary))


def summarize(outcome: "Outcome", frame: pd.DataFrame) -> dict[str, Any]:
    """All numbers, ready for JSON: errors in sizes of the path, other units in the names."""
    rigs, designs = outcome.sensed
    rig, kept = next(iter(rigs.values())), outcome.beside.get("kept", [])
    summary, noise = origin("recover", outcome.done), noise_of(rig)
    if rig.file is not None:
        summary["model_sha256"] = summary["basis"]["robot_sha256"]
    beside_ended = frame[["informed_ended", "unaware_ended"]].notna().any(axis=1)
    ended, thrown = frame["status"].eq("ended"), frame["peak_supervised_since"] > THROWN
    # Against the size of a mismatch runs go on to where the loops themselves are unstable.
    places = {"near": ~thrown & frame["sort"].ne("size"), "thrown": thrown}
    gaps_m = frame["closure_residual_max_m"].fillna(0.0)
    closure_m = {name: float(gaps_m.where(at, 0.0).max()) for name, at in places.items()}
    for each in kept:
        closure_m["near"] = max(closure_m["near"], each.run.closure_max_m)
    differing = {name: asdict(sizes_of(rig, name)) for name in frame["mismatch"].unique()}
    return summary | {
        "robot": rig.title,
        "actuators": list(rig.actuators),
        "major": list(rig.major),
        "path_size": rig.size,
        **by_unit("path_size", rig.size, rig.row_units),
        **by_unit("sensor_noise", rig.noise, rig.row_units),
        **by_unit("encoder_noise", rig.encoder_noise, rig.units),
        "control_period_s": rig.period_s,
        "mismatch": {
            name: {key: size for key, size in sizes.items() if size != getattr(EXACT, key)}
            for name, sizes in differing.items()
        },
        "rules": asdict(DEFAULT_CONFIG),
        "dither": {name: dither_entry(own, rigs[name]) for name, own in designs.items()}
        or {"task": asdict(DITHER)},
        "recovered_from_s": max(each.recovered_s for each in outcome.done.campaign.runs),
        "noise": noise,
        "worst_allowed": WORST,
        "separation_required": ISOLABLE,
        "sorts": dict(Counter(frame["sort"])),
        "ended": int(((ended | beside_ended) & frame["sort"].ne("event")).sum()),
        "refused": sorted({*frame.loc[frame["status"].eq("refused"), "message"]}),
        "closure_m": closure_m,
        "closure_limit_m": CLOSURE_LIMIT_M if rig.file is None else CLOSURE_TOLERANCE,
        **statistics(frame, noise),
        "shown": {each.name: each.row for each in kept},
        **(_beside(outcome.beside) if outcome.beside else {}),
        **({} if outcome.controller is None else {"controller": _compared(outcome, frame)}),
    }


def _beside(beside: Mapping[str, list[Any]]) -> dict[str, Any]:
    """What is computed beside failures of the hexapod, and the constants of both."""
    lists = ("dither_design", "informed_late")
    alike = {"alike_below": ALIKE, "evidence_s": EVIDENCE_S}
    return {
        **{name: list(chain(*beside.get(name, []))) for name in lists},
        "ambiguity": alike | {"failures": list(chain(*beside["ambiguity"]))},
        "dither_cost": beside["dither_cost"][0],
        "beliefs": beside["beliefs"][0],
        "bench": asdict(BENCH) | plant_constants(exact_rig().model),
        "jacobian": "constant",
    }


def _compared(outcome: "Outcome", frame: pd.DataFrame) -> dict[str, Any]:
    """Somebody else's controller in the cases with all mismatches, and in the shown runs."""
    kept = (each.row for each in outcome.beside["kept"] if each.controller)
    rows = [*outcome.beside.get("others", []), *kept]
    failures = [row["controller_failure"] for row in rows]
    compared = frame[frame["rms_other_after"].notna()]
    square = [(compared[f"rms_{name}_after"] ** 2).mean() for name in ("other", "informed")]
    return {
        "name": outcome.controller,
        "after_over_informed": float(np.sqrt(square[0] / square[1])),
        "runs": len(rows),
        "failures": [each for each in failures if each is not None],
    }


# Checks.


def checks(summary: dict[str, Any]) -> list[Check]:
    """Closed loops, runs to their end, no event in which the diagnosis does harm; and the goals."""
    closure_m, limit_m = summary["closure_m"], summary["closure_limit_m"]
    events, near = summary["by_event"], "runs near the path, at the usual sizes"
    found = [
        closure_check(near, closure_m["near"], limit_m),
        closure_check("runs that an event throws far", closure_m["thrown"], 10 * limit_m),
        Check("number of runs that ended early", summary["robot"], summary["ended"], 1),
    ]
    what = "largest RMS error over that of a controller that does nothing"
    for each in events:
        worst = inf if each["ended"] else each["counted_worst"]
        found.append(Check(what, each["event"], worst, WORST))
    for each in summary["healthy"] if events or "beliefs" in summary else []:
        where, named = "runs without failures or events", each["healthy_named"]["count"]
        found.append(Check("number of runs in which an actuator was named", where, named, 1))
        what = "number of runs whose commands an alarm changed"
        found.append(Check(what, where, each["commands_changed"], 1))
    return found + list(_goals(summary) if "beliefs" in summary else [])


def _goals(summary: dict[str, Any]) -> Iterator[Check]:
    """The goals of the hexapod's failures, its shown runs, and somebody else's controller."""
    beliefs, [healthy], [pairs] = (summary[key] for key in ("beliefs", "healthy", "pairs"))
    where = f"{beliefs['worst_truth']}, {beliefs['worst_belief']} diagnosed"
    what = "number of unstable pairs of true and diagnosed fault"
    yield Check(what, where, beliefs["unstable"], 1)
    failures = {e["mismatch"]: e for e in summary["by_mismatch"] if e["factor"] == 1.0}
    isolated = "share of the isolable failures that is not identified"
    over = "RMS after recovery divided by that of a controller informed at once"
    for name, plant in {"exact": "exact plant", "all": "all mismatches"}.items():
        entry = failures[name]
        for key, which in {"right": "as first named", "all_right": "and kind in the end"}.items():
            missed = _missed(entry[f"isolable_{key}"])
            yield Check(isolated, f"{plant}, actuator {which}", missed, NOT_ISOLATED)
        yield Check(over, plant, entry["over_informed"]["after"]["pooled"], OVER_INFORMED)
    yield Check(isolated, "two failures in a run", _missed(pairs["handled"]), NOT_ISOLATED)
    median_s = (failures["all"]["named_s"] or {"median": nan})["median"]
    what = "median time until the failed actuator is named [s]"
    yield Check(what, "all mismatches", median_s, NAMED_S)
    named = sum(each["healthy_named"]["count"] for each in failures.values())
    what = "number of runs in which a healthy actuator was named"
    yield Check(what, "runs with a failure", named, 1)
    bound, side = ("high", "upper") if healthy["hours"] >= ENOUGH_H else ("low", "lower")
    what = f"{side} 95 % bound of the false alarms per hour"
    rate = healthy["alarms_per_hour"][f"{bound}_95"]
    yield Check(what, "runs without failures", nan if rate is None else rate, ALARMS_PER_HOUR)
    what = "wrong diagnosis of the failures or of the task (0 no, 1 yes),"
    for name, entry in summary["shown"].items():
        yield Check(what, f"run {name}", float(not entry.get("all_right", True)), 0.5)
    if (other := summary.get("controller")) is not None:
        what = f"number of runs in which it failed ({[*other['failures'], 'none'][0]})"
        yield Check(what, f"controller {other['name']}", len(other["failures"]), 0.5)


def _missed(rate: Mapping[str, Any]) -> float:
    return nan if rate["rate"] is None else 1 - rate["rate"]


# Tables and sentences.

_SHOWN = {
    "by_mismatch": "mismatch factor:g runs alarm_before.count detected.count right.count "
    "right.low:.3f healthy_named.count kind_right.count named_s.median:.3f "
    "named_s.percentile_95:.3f named_s.largest:.3f over_informed.after.pooled:.4f "
    "over_informed.after.worst:.3f over_unaware.since.median:.2f harmed",
    "by_kind": "sense kind runs detected.count right.count isolable_right.count "
    "isolable_right.cases kind_right.count healthy_named.count alarm_s.median:.3f "
    "named_s.median:.3f named_s.largest:.3f errors.supervised.before.rms:.3g "
    "errors.supervised.during.rms:.3g errors.informed.during.rms:.3g "
    "errors.supervised.after.rms:.3g errors.informed.after.rms:.3g errors.unaware.after.rms:.3g "
    "errors.other.after.rms:.3g over_informed.after.median:.3g over_informed.after.worst:.3g "
    "lost_and_given_up lost task_lost",
    "by_event": "event runs ended over_unaware.since.median:.2f over_unaware.since.worst:.2f "
    "over_unaware.after.worst:.2f harmed over_informed.since.median:.2f right.count right.cases "
    "healthy_named.count unexplained task_lost errors.supervised.since.peak:.1f "
    "errors.unaware.since.peak:.1f",
    "pairs": "mismatch runs all_right.count all_right.low:.3f handled.count handled.low:.3f",
    "healthy": "sense runs hours:.3g alarms alarms_per_hour.low_95:.2g "
    "alarms_per_hour.high_95:.2g healthy_named.count commands_changed",
    "isolability": "kind where setting from_other_actuators:.1f from_other_kinds:.1f alike",
}
"""Columns of the printed tables, by what they are of: keys of an entry in the JSON, and formats."""
_LEGEND = (
    "runs: their number, of which the other counts are. alarm_before: a false one, before the "
    "failure or event. detected: an alarm since. right: the first actuator named since is one that "
    "failed, or, where none did, the cause is named; low: bound of its share at 95 %. "
    "isolable_right: of the failures that the linear model separates. kind_right: of the right "
    "ones, right or not told apart. healthy_named: at any time. errors: of all major rows "
    "together, in {unit}, since the failure or event, during the first {s:.3g} s, and after these. "
    "over_informed, over_unaware: RMS error over that of a controller informed at once, or that "
    "does nothing. harmed: the latter is above {worst:g}, and the errors differ by more than the "
    "sensors' noise. lost_and_given_up: the task, of those lost. handled: all_right, or given up."
)


def tables(summary: dict[str, Any]) -> list[Table]:
    """One table for each grouping of the rows, and one of distances between failures."""
    units, size, unit = (
        [name for name in summary if name.startswith("path_size_")],
        1.0,
        "path sizes",
    )
    if len(units) == 1:
        size, unit = 1e6 * summary["path_size"], f"u{units[0].removeprefix('path_size_')}"
    of = summary | {"isolability": _isolability(summary)}
    made = [_table(f"{of['robot']}, {name}", name, of[name], size) for name in _SHOWN if of[name]]
    legend = _LEGEND.format(unit=unit, s=summary["recovered_from_s"], worst=WORST)
    return [replace(made[0], legend=legend), *made[1:]]


def _table(title: str, name: str, entries: Sequence[dict[str, Any]], size: float) -> Table:
    """The shown keys of entries but those that no entry has; errors times the size of the path."""

    def value(path: str, found: Any) -> Any:
        for key in path.split("."):
            found = None if found is None else found.get(key)
        return size * found if found is not None and path.startswith("errors") else found

    shown = (each.partition(":") for each in _SHOWN[name].split())
    columns = [
        Column(path.replace(".", " "), partial(value, path), spec)
        for path, _, spec in shown
        if any(value(path, entry) is not None for entry in entries)
    ]
    return tabulate(title.replace("_", " "), columns, entries)


def _isolability(summary: dict[str, Any]) -> list[dict[str, Any]]:
    """Least distances between failures over the struts, and how many look alike."""
    if "ambiguity" not in summary:
        return []
    frame = pd.DataFrame(summary["ambiguity"]["failures"])
    frame["alike"] = frame["alike"].map(len)
    groups = frame.groupby(["kind", "where", "setting"], as_index=False)
    how = {"from_other_actuators": "min", "from_other_kinds": "min", "alike": "sum"}
    return groups.agg(how).to_dict("records")


def notes(summary: dict[str, Any]) -> list[str]:
    """What was simulated and what came of it, one sentence each."""
    lines = [headline(summary)] if summary["by_event"] or "beliefs" in summary else []
    lines.append(sizes_said(summary))
    for sense, dither in summary["dither"].items():
        what = "none" if dither is None else f"{dither['frequency_hz']:g} Hz"
        lines.append(f"Dither of the diagnosis by {sense}: {what}.")
    lines += [f"Not simulated: {each}." for each in summary["refused"]]
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
            f"With {other['name']}, which is told of no failure and takes no posture and no "
            f"dither, the RMS error after recovery is {other['after_over_informed']:.4g} times "
            f"that of the controller informed at once.{failed}"
        )
    harm = (each["event"] for each in summary["by_event"] if each["harmed"] or each["ended"])
    return [*lines, *(f"Harm: {EVENTS[name].sentence}." for name in harm), *session_rate(summary)]
