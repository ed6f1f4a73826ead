"""A tracked run as numbers, a verdict in words, tables and files."""

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from experiments.rig.checks import closure_check
from experiments.rig.dither import dither_entry
from experiments.rig.events import EVENTS
from experiments.rig.limiting import limiting
from experiments.rig.reach import AGREES, beyond_linear_range
from experiments.rig.run import Diagnosed
from experiments.rig.units import (
    ROWS,
    by_unit,
    largest_by_unit,
    loops_said,
    norms_said,
    said,
    sizes_said,
)
from experiments.study.controllers import controller_label
from experiments.study.provenance import versions
from experiments.study.results import Check, Results
from experiments.study.tables import Column, Table, tabulate
from experiments.track.figure import pictures
from experiments.track.happened import event_tables, happened
from experiments.track.recording import record
from experiments.track.runs import Tracked
from ftc.fdi.dither_design import DitherDesign
from sim import CLOSURE_TOLERANCE, Array
from sim.plant.friction import dry_friction

_OF_ROWS = (
    *("path_size", "sensor_noise", "rms_before", "rms_after"),
    *("predicted_rms_before", "predicted_rms_after", "predicted_rms_after_when_named"),
    "rms_after_without_diagnosis",
)
"""Numbers in the units of the major rows; each has an entry of its own in each of these units."""


def results(tracked: Tracked) -> Results:
    """Everything that `fjh track` publishes."""
    summary = summarize(tracked)
    arrays = tracked.run.arrays
    if tracked.other is not None:
        arrays |= {f"other_{key}": value for key, value in tracked.other.run.arrays.items()}
    return Results(
        summary,
        tables=tables(tracked, summary),
        notes=notes(tracked, summary),
        checks=checks(summary),
        pictures=pictures(tracked, summary),
        arrays={"track.npz": arrays},
        records=[partial(record, tracked, summary, checks(summary))],
        caveat=tracked.run.lost,
    )


def checks(summary: dict[str, Any]) -> list[Check]:
    """Loops stay closed, errors are as predicted, another controller does nothing wrong."""
    gap_m = summary["closure_residual_max_m"]
    found = [closure_check(summary["robot"], gap_m, CLOSURE_TOLERANCE)]
    for when in ("before", "after"):
        if (off := summary[f"prediction_off_{when}"]) is not None:
            what = f"relative error of the predicted RMS, {when} the first failure,"
            found.append(Check(what, summary["robot"], off, AGREES))
    for one in summary.get("controllers", ()):
        if one["failure"] is not None:
            found.append(Check(f"a failure, {one['failure']},", one["name"], 1.0, 1.0))
    return found


def summarize(tracked: Tracked) -> dict[str, Any]:
    """All numbers, ready for JSON."""
    rig, run, failures = tracked.rig, tracked.run, tracked.run.failures
    error = run.desired - run.true
    cut, without = first_tick(tracked), tracked.undiagnosed
    before, after = tracked.predicted.rms_before, tracked.predicted.rms_after
    when_named = tracked.comparable.rms_after
    is_predicted = bool(failures) and not tracked.events
    after_too = None if tracked.uncompared else _ratio(error[cut:], when_named)
    ratios, beyond = (_ratio(error[:cut], before), after_too), None
    if off := [each for each in ratios if each is not None and abs(each - 1.0) >= AGREES]:
        noise = np.nan_to_num(run.measured - run.true)
        beyond = beyond_linear_range(rig, run.desired, noise, max(off))
    summary: dict[str, Any] = {
        "experiment": "track",
        "seed": tracked.seed,
        "versions": versions(),
        "model_sha256": tracked.model_sha256,
        "robot": rig.title,
        "actuators": list(rig.actuators),
        "bodies": list(rig.bodies),
        "major": list(rig.major),
        "units": list(rig.row_units),
        "duration_s": float(run.time_s[-1] + rig.period_s),
        "control_period_s": rig.period_s,
        "path_size": rig.size,
        "feedforward": rig.feedforward,
        "sensor_noise": rig.noise,
        "encoder_noise": rig.encoder_noise,
        "loops": [
            {
                "row": row,
                "crossover_hz": each.crossover_hz,
                "gain_margin_db": each.gain_margin_db if np.isfinite(each.gain_margin_db) else None,
                "phase_margin_deg": each.phase_margin_deg,
            }
            for row, each in zip(rig.major, rig.margins, strict=True)
        ],
        "failures": [
            {
                "actuator": rig.actuators[each.number],
                "kind": each.kind,
                "time_s": each.time_s,
            }
            for each in failures
        ],
        "events": [
            {
                "name": each.name,
                "actuator": None if each.actuator is None else rig.actuators[int(each.actuator)],
                "time_s": each.time_s,
            }
            for each in tracked.events
        ],
        "rms_before": _rms(error[:cut]),
        "rms_after": _rms(error[cut:]),
        "rms_after_without_diagnosis": without and _rms((without.desired - without.true)[cut:]),
        "predicted_rms_before": _listed(before),
        "predicted_rms_after": _listed(after) if is_predicted else None,
        "predicted_rms_after_when_named": _listed(when_named) if is_predicted else None,
        **_agreement("before", ratios[0], beyond),
        **_agreement("after", ratios[1], beyond),
        "status": run.status,
        "warnings": list(rig.warnings),
        "left_out": list(rig.left_out),
        "dry_friction": list(dry_friction(rig.model)),
        "met": [*tracked.met, *([beyond] if beyond is not None else ())],
        "possible_after": list(tracked.possible[1:]),
        "dither": dither_entry(tracked.dither, rig),
        "diagnoses": diagnoses(tracked),
        "advice": list(tracked.advice),
        "task_lost": tracked.run.task_lost,
        "closure_residual_max_m": float(run.closure_m.max()),
        "lost": run.lost,
        "limited_by": None if tracked.events or run.lost else limiting(rig, run, failures),
    }
    if (other := tracked.other) is not None:
        theirs = other.run.desired - other.run.true
        summary["controllers"] = [
            {
                "name": other.name,
                "rms_before": _rms(theirs[:cut]),
                "rms_after": _rms(theirs[cut:]),
                **by_unit("rms_before", _rms(theirs[:cut]), rig.row_units),
                **by_unit("rms_after", _rms(theirs[cut:]), rig.row_units),
                "failure": other.failure,
            }
        ]
    for key in _OF_ROWS:
        summary |= by_unit(key, summary[key], rig.row_units)
    summary |= by_unit("encoder_noise", rig.encoder_noise, rig.units)
    first = "" if run.lost is None else f"{run.lost} "
    return summary | {"verdict": first + verdict(tracked, summary) + _unlike(tracked, summary)}


def first_tick(tracked: Tracked) -> int:
    """Tick of the first failure or event; of the end where there is none."""
    times = [each.time_s for each in (*tracked.run.failures, *tracked.events)]
    return int(np.searchsorted(tracked.run.time_s, min(times, default=np.inf) - 1e-9))


def _rms(error: Array) -> list[float] | None:
    """RMS of each row; None of no ticks."""
    return _listed(np.sqrt((error**2).mean(axis=0))) if len(error) else None


def _ratio(error: Array, predicted: Array) -> float | None:
    """RMS error over the predicted; None of no ticks."""
    if not len(error) or not np.isfinite(predicted).all():
        return None
    return float(np.sqrt((error**2).sum(axis=1).mean() / (predicted**2).sum()))


def _agreement(when: str, ratio: float | None, beyond: str | None) -> dict[str, float | None]:
    """Measured over predicted error, and by how much it is not one, in the model's range."""
    off = None if ratio is None or beyond is not None else abs(ratio - 1.0)
    return {f"measured_over_predicted_{when}": ratio, f"prediction_off_{when}": off}


def _listed(values: Array) -> list[float] | None:
    return values.tolist() if np.isfinite(values).all() else None


def diagnoses(tracked: Tracked) -> list[dict[str, Any]]:
    """Each actuator and kind as it was first named; of a false alarm the delay is None."""
    named: dict[tuple[str, str], Diagnosed] = {}
    for found in tracked.run.diagnoses:
        named.setdefault((found.actuator, found.kind), found)
    rig = tracked.rig
    struck = {
        rig.actuators[int(one.actuator)]: one.time_s
        for one in (*tracked.events, *tracked.run.failures)
        if one.actuator is not None
    }
    entries = []
    for found in named.values():
        delay_s = found.time_s - struck.get(found.actuator, np.inf)
        entry = {"actuator": found.actuator, "kind": found.kind, "time_s": found.time_s}
        delay_s = delay_s if delay_s >= 0 else None
        entries.append(entry | {"delay_s": delay_s, "acted_s": found.acted_s})
    return entries


def verdict(tracked: Tracked, summary: dict[str, Any]) -> str:
    """What the failures cost, beside what was predicted, in one sentence."""
    before = _with_units(summary["rms_before"], summary["units"])
    if not (tracked.run.failures or tracked.events):
        predicted = _with_units(summary["predicted_rms_before"], summary["units"])
        return (
            f"Without a failure the RMS error of row{_plural(tracked.rig.major)} "
            f"{_rows(tracked.rig.major)} is {before}, and {predicted} by the linear model."
        )
    after = _with_units(summary["rms_after"], summary["units"])
    says = _says(tracked, summary)
    can = "can" if tracked.possible[-1] else "cannot"
    return (
        f"After {happened(summary)} the RMS error of row{_plural(tracked.rig.major)} "
        f"{_rows(tracked.rig.major)} is {after} ({before} before it); {says}, and the "
        f"classification says that the remaining actuators {can} do the major task; "
        f"{_found(tracked, summary)}."
    )


def _says(tracked: Tracked, summary: dict[str, Any]) -> str:
    """What the linear model predicts after the failures."""
    if tracked.events:
        return f"the linear model predicts nothing, as {tracked.uncompared}"
    if (leaves := tracked.predicted.leaves) is not None:
        return f"there is no prediction, because in the linear model {leaves} leaves its range"
    at_once, then = (
        _with_units(summary[key], summary["units"])
        for key in ("predicted_rms_after", "predicted_rms_after_when_named")
    )
    if not tracked.told:
        return f"the linear model with a controller that is never told predicts {at_once}"
    informed = f"{at_once} with a controller that is informed at once"
    if tracked.uncompared is not None:
        return f"the linear model predicts {informed}; it is not compared, as {tracked.uncompared}"
    learns = "learns of it when this one did" if summary["diagnoses"] else "learns of nothing, too"
    return f"the linear model predicts {then} with a controller that {learns}, {informed}"


def _unlike(tracked: Tracked, summary: dict[str, Any]) -> str:
    """By what factor errors are not as predicted, and what the linear model leaves out."""
    factors = [
        f"{ratio:.3g} times the predicted one {when} the first failure"
        for when in ("before", "after")
        if (ratio := summary[f"measured_over_predicted_{when}"]) is not None
        and abs(ratio - 1.0) >= AGREES
    ]
    if not factors:
        return ""
    causes = "; ".join((*tracked.rig.warnings, *summary["met"])) or "nothing that file or run names"
    return f" The RMS error is {' and '.join(factors)}. Not in the linear model: {causes}."


def _found(tracked: Tracked, summary: dict[str, Any]) -> str:
    right = {(each["actuator"], each["kind"]) for each in summary["failures"]}
    for each in summary["events"]:
        right |= {(each["actuator"], kind) for kind in EVENTS[each["name"]].named_as}
    named = summary["diagnoses"]
    parts = [
        f"{each['actuator']} was named {each['kind']} after {1e3 * each['delay_s']:.0f} ms"
        for each in named
        if (each["actuator"], each["kind"]) in right and each["delay_s"] is not None
    ]
    wrong = sum((each["actuator"], each["kind"]) not in right for each in named)
    if wrong:
        parts.append(f"{wrong} wrong diagnos{'is' if wrong == 1 else 'es'} came besides")
    if tracked.run.task_lost:
        parts.append("the controller gave the task up")
    parts += tracked.advice
    if not parts and tracked.run.undiagnosed is not None:
        return f"nothing was diagnosed, as {tracked.run.undiagnosed}"
    return "; ".join(parts) or "nothing was diagnosed"


def _with_units(values: Sequence[float] | None, unit: Sequence[str]) -> str:
    if values is None:
        return "unknown"
    return ", ".join(said(value, each) for value, each in zip(values, unit, strict=True))


def _rows(major: Sequence[int]) -> str:
    return ", ".join(ROWS[row] for row in major)


def _plural(major: Sequence[int]) -> str:
    return "s" if len(major) > 1 else ""


def tables(tracked: Tracked, summary: dict[str, Any]) -> list[Table]:
    """Errors by major row, and what was diagnosed."""
    columns: tuple[Column, ...] = (
        Column("row", "row"),
        Column("before", "rms_before"),
        Column("pred.", "predicted_rms_before"),
        Column("after", "rms_after"),
        Column("pred.", "predicted_rms_after_when_named"),
    )
    if tracked.told:
        columns += (Column("pred.,\nat once", "predicted_rms_after"),)
    if tracked.undiagnosed is not None:
        columns += (Column("without\ndiagnosis", "rms_after_without_diagnosis"),)
    values = {name: summary[name] for name in _OF_ROWS if name.count("rms")}
    for one in summary.get("controllers", ()):
        values |= {f"{key}_other": one[f"rms_{key}"] for key in ("before", "after")}
    entries = [
        {"row": ROWS[row]}
        | {key: each and said(each[k], summary["units"][k]) for key, each in values.items()}
        for k, row in enumerate(tracked.rig.major)
    ]
    if (other := tracked.other) is not None:
        label = controller_label(other.name)
        columns += (
            Column(f"{label},\nbefore", "before_other"),
            Column(f"{label},\nafter", "after_other"),
        )
    title = f"{tracked.rig.title}: RMS of desired minus true"
    learns = "is never told"
    if tracked.told:
        learns = "learns of each failure when this one did; at once: that is informed at once"
    legend = (
        "Before and after the first failure or event. pred.: by the linear model with the noise "
        f"that the sensors had, with a controller that {learns}."
    )
    named = summary["diagnoses"]
    missing = "Without a delay: a false alarm; without a change: the commands went on as they were."
    found = (
        Column("actuator", "actuator"),
        Column("named", "kind"),
        Column("at, s", "time_s", ".3f"),
        Column("after, s", "delay_s", ".3f"),
        Column("commands\nchange, s", "acted_s", ".3f"),
    )
    return [
        tabulate(title, columns, entries, legend),
        *event_tables(summary),
        tabulate("Diagnoses", found, named, missing if named else ""),
    ]


def notes(tracked: Tracked, summary: dict[str, Any]) -> list[str]:
    """The verdict first, then what is assumed."""
    rig = tracked.rig
    found = [summary["verdict"], *_without_diagnosis(tracked, summary)]
    if summary["limited_by"] is not None:
        found.append(summary["limited_by"])
    if tracked.other is not None and tracked.other.failure is not None:
        found.append(f"{tracked.other.failure}; its last inputs were held from then on.")
    if tracked.dither is not None:
        found.append(_dither_said(tracked.dither, summary, rig.units))
    found += loops_said(rig.major, rig.margins)
    demanded = "is" if rig.feedforward else "is not"
    assumed = (*rig.warnings, *summary["met"])
    found += [f"{sentence[0].upper()}{sentence[1:]}." for sentence in assumed]
    exact = "" if assumed else "exact "
    found.append(
        f"The path {demanded} demanded through the inverse of the linear model. "
        f"{sizes_said(summary)} Diagnosis and controller have the {exact}model of the robot."
    )
    for failure, text in zip(tracked.run.failures, tracked.verdicts[1:], strict=True):
        found.append(f"After {rig.actuators[failure.number]} {failure.kind}: {text}")
    return found


def _without_diagnosis(tracked: Tracked, summary: dict[str, Any]) -> list[str]:
    """What the same run costs without diagnosis, where something happens in it."""
    if not tracked.told or not (tracked.run.failures or tracked.events):
        return []
    if (without := summary["rms_after_without_diagnosis"]) is None:
        return ["The same run without diagnosis leaves the finite numbers."]
    theirs, own = (norms_said(each, summary["units"]) for each in (without, summary["rms_after"]))
    return [
        f"The same run without diagnosis has an RMS error of {theirs} after {happened(summary)}, "
        f"the major rows together; with it {own}."
    ]


def _dither_said(design: DitherDesign, summary: dict[str, Any], units: Sequence[str]) -> str:
    """What it is for, and what it costs."""
    entry = summary["dither"]
    cost = _with_units(entry["task_motion"], summary["units"])
    return (
        f"Dither of {entry['frequency_hz']:g} Hz, no actuator further than "
        f"{largest_by_unit(entry['displacement'], units)}: by the linear model "
        f"{len(entry['isolable'])} of {len(design.separations.faults)} failures can be told from "
        "those of other actuators "
        f"in half a second; it moves the major rows with amplitudes of {cost} while nothing has "
        "failed."
    )
