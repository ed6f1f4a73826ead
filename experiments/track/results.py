"""A tracked run as numbers, tables, two sentences and files."""

from collections.abc import Mapping
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from argument_checks.ties import greatest
from experiments.recording.record import About, write_views
from experiments.recording.view import view_of
from experiments.rig.checks import closure_check
from experiments.rig.dither import dither_entry
from experiments.rig.events import EVENTS
from experiments.rig.reach import AGREES, beyond_linear_range
from experiments.rig.rig import Rig
from experiments.rig.run import Run, entry_of
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
from experiments.study.provenance import version_properties, versions
from experiments.study.results import Check, Picture, Results
from experiments.study.tables import Column, Table, tabulate
from experiments.track.figure import ALT, figure_track
from experiments.track.runs import Tracked
from ftc.tracking import deciding_sentence, is_possible
from sim import CLOSURE_TOLERANCE, Array
from sim.plant.friction import dry_friction

_OFTEN = 0.01
"""Part of the time in which an actuator that gives its largest force is said to saturate."""


def results(tracked: Tracked) -> Results:
    """Everything that `fjh track` publishes."""
    summary = summarize(tracked)
    arrays = tracked.run.arrays
    if tracked.other is not None:
        arrays |= {f"other_{key}": value for key, value in tracked.other.run.arrays.items()}
    draw = partial(figure_track, tracked, summary)
    return Results(
        summary,
        tables=tables(tracked, summary),
        notes=notes(tracked, summary),
        checks=checks(summary),
        pictures=[Picture("track", summary["verdict"], ALT, draw)],
        arrays={"track.npz": arrays},
        records=[partial(record, tracked, summary)],
        caveat=tracked.run.lost,
    )


def checks(summary: dict[str, Any]) -> list[Check]:
    """Checks that loops stay closed, errors are as predicted, another controller does no wrong."""
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
    rig, run = tracked.rig, tracked.run
    cut, predicted, told = first_tick(run), tracked.predicted, tracked.comparable
    after_too = None if tracked.uncompared else _ratio(run.error[cut:], told.rms_after)
    ratios = {"before": _ratio(run.error[:cut], predicted.rms_before), "after": after_too}
    beyond = None
    if beside := [each for each in ratios.values() if each and abs(each - 1.0) >= AGREES]:
        noise = np.nan_to_num(run.measured - run.true)
        beyond = beyond_linear_range(rig, run.desired, noise, max(beside))
    summary: dict[str, Any] = {
        "experiment": "track",
        "seed": tracked.seed,
        "versions": versions(),
        "model_sha256": rig.model_sha256,
        "robot": rig.title,
        "actuators": list(rig.actuators),
        "bodies": list(rig.bodies),
        "major": list(rig.major),
        "units": list(rig.row_units),
        "duration_s": float(run.time_s[-1] + rig.period_s),
        "control_period_s": rig.period_s,
        "feedforward": rig.feedforward,
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
        "failures": [entry_of(rig, each) for each in run.failures],
        "events": [entry_of(rig, each) for each in run.events],
        "status": run.status,
        "warnings": list(rig.warnings),
        "left_out": list(rig.left_out),
        "dry_friction": list(dry_friction(rig.model)),
        "met": [*tracked.met, *([] if beyond is None else [beyond])],
        "possible_after": [is_possible(report) for report in tracked.reports[1:]],
        "dither": dither_entry(tracked.dither, rig),
        "diagnoses": diagnoses(rig, run),
        "advice": list(tracked.advice),
        "task_lost": run.task_lost,
        "closure_residual_max_m": run.closure_max_m,
        "lost": run.lost,
        "limited_by": None if run.events or run.lost else limited_by(tracked),
    }
    for when, ratio in ratios.items():
        summary[f"measured_over_predicted_{when}"] = ratio
        off = None if ratio is None or beyond is not None else abs(ratio - 1.0)
        summary[f"prediction_off_{when}"] = off
    rows = _of_rows(tracked, cut)
    summary |= rows | by_unit("encoder_noise", rig.encoder_noise, rig.units)
    for key, value in rows.items():
        summary |= by_unit(key, value, rig.row_units)
    if (other := tracked.other) is not None:
        rms = {"rms_before": _rms(other.run.error[:cut]), "rms_after": _rms(other.run.error[cut:])}
        summary["controllers"] = [{"name": other.name, "failure": other.failure, **rms}]
        for key, value in rms.items():
            summary["controllers"][0] |= by_unit(key, value, rig.row_units)
    return summary | {"verdict": verdict(summary)}


def _of_rows(tracked: Tracked, cut: int) -> dict[str, Any]:
    """Numbers in the units of the major rows, which have an entry in each of these units besides.

    `cut` is the tick of the first failure or event.
    """
    rig, run, without = tracked.rig, tracked.run, tracked.undiagnosed
    is_predicted = bool(run.failures) and not run.events
    after = [tracked.predicted.rms_after, tracked.comparable.rms_after]
    at_once, when_told = (_finite(each) if is_predicted else None for each in after)
    return {
        "path_size": rig.size,
        "sensor_noise": rig.noise,
        "rms_before": _rms(run.error[:cut]),
        "rms_after": _rms(run.error[cut:]),
        "rms_after_without_diagnosis": without and _rms(without.error[cut:]),
        "predicted_rms_before": _finite(tracked.predicted.rms_before),
        "predicted_rms_after": at_once,
        "predicted_rms_after_when_named": when_told,
    }


def first_tick(run: Run) -> int:
    """Tick of the first failure or event; of the end where there is none."""
    times = [each.time_s for each in (*run.failures, *run.events)]
    return int(np.searchsorted(run.time_s, min(times, default=np.inf) - 1e-9))


def _rms(error: Array) -> list[float] | None:
    """RMS of each row; None of no ticks."""
    return _finite(np.sqrt((error**2).mean(axis=0))) if len(error) else None


def _ratio(error: Array, predicted: Array) -> float | None:
    """RMS error over the predicted, all rows together; None of no ticks."""
    if not len(error) or not np.isfinite(predicted).all():
        return None
    return float(np.sqrt((error**2).sum(axis=1).mean() / (predicted**2).sum()))


def _finite(values: Array) -> list[float] | None:
    return values.tolist() if np.isfinite(values).all() else None


def diagnoses(rig: Rig, run: Run) -> list[dict[str, Any]]:
    """All diagnoses of a run, ready for JSON; of a false alarm the delay is None."""
    since_s = {
        rig.actuators[int(each.actuator)]: each.time_s
        for each in (*run.events, *run.failures)
        if each.actuator is not None
    }
    delays_s = [each.time_s - since_s.get(each.actuator, np.inf) for each in run.diagnoses]
    return [
        asdict(each) | {"delay_s": delay_s if delay_s >= 0 else None}
        for each, delay_s in zip(run.diagnoses, delays_s, strict=True)
    ]


def limited_by(tracked: Tracked) -> str | None:
    """Name what most of the squared error comes from; None: nothing that is known here.

    Saturation is seen in the run, all else by comparison with the linear model without it.
    """
    rig, run, predicted, cut = tracked.rig, tracked.run, tracked.predicted, first_tick(tracked.run)
    often = run.saturated.mean(axis=0)
    often[[failure.number for failure in run.failures]] = 0.0
    if often.max() > _OFTEN:
        servo, percent = rig.actuators[greatest(often)], f"{100 * often.max():.0f} % of the time"
        return f"The servo of {servo} saturates: it gives its largest force for {percent}."

    def squared(error: Array) -> float:
        return float(((error / rig.nominal.noise) ** 2).sum(axis=-1).mean()) if len(error) else 0.0

    if run.failures and squared(predicted.rms_after) < squared(run.error[cut:]) / 2:
        return "After the failure most of the error is from the time until it was diagnosed."
    without = {"noise of the sensors, which the loops pass on": (rig, 0.0)}
    if rig.nominal.friction is not None:
        smooth = replace(rig.control, nominal=replace(rig.nominal, friction=None))
        without["dry friction in the joints"] = replace(rig, control=smooth), 1.0
    most = "Before the failure most" if run.failures else "Most"
    half, noise = squared(run.error[:cut]) / 2, run.measured - run.true
    for cause, (other, scale) in without.items():
        left = other.predict(run.desired, failures=run.failures, noise=scale * noise).rms_before
        if squared(left) < half < squared(predicted.rms_before):
            return f"{most} of the error is from {cause}."
    return None


def happened(summary: Mapping[str, Any]) -> str:
    """Failures and events in words, in the order of time; one that is both is there once."""
    entries = [(one["time_s"], f"{one['actuator']} {one['kind']}") for one in summary["failures"]]
    for one in summary["events"]:
        if EVENTS[one["name"]].failures != (one["name"],):
            of = "" if one["actuator"] is None else f" of {one['actuator']}"
            entries.append((one["time_s"], f"{one['name']}{of}"))
    entries.sort(key=lambda entry: entry[0])
    return ", ".join(f"{what} at {time_s:g} s" for time_s, what in entries)


def verdict(summary: Mapping[str, Any]) -> str:
    """What happened and what it cost; and what is left, as classified, with the diagnoses."""
    rms = {
        key: norms_said(summary[key], summary["units"]) if summary[key] else "unknown"
        for key in ("rms_before", "rms_after", "predicted_rms_before")
    }
    robot, what = summary["robot"], happened(summary)
    if not what:
        model = f"by the linear model {rms['predicted_rms_before']}"
        return f"{robot}: without a failure the RMS error is {rms['rms_before']}; {model}."
    earlier = f", {rms['rms_before']} before" if summary["rms_before"] else ""
    first = f"{robot}: after {what} the RMS error is {rms['rms_after']}{earlier}."
    if summary["lost"] is not None:
        return f"{first} {summary['lost']}"
    can = "cannot" if summary["possible_after"][-1:] == [False] else "can"
    found = [
        f"{each['actuator']} was diagnosed {each['kind']} "
        + ("wrongly" if each["delay_s"] is None else f"after {1e3 * each['delay_s']:.0f} ms")
        for each in summary["diagnoses"]
    ]
    diagnosed = ", ".join(found) or "nothing was diagnosed"
    return f"{first} The remaining actuators {can} do the major task; {diagnosed}."


def tables(tracked: Tracked, summary: dict[str, Any]) -> list[Table]:
    """Errors by major row, and what happened and was diagnosed."""
    named = {"before": "rms_before", "pred.": "predicted_rms_before", "after": "rms_after"}
    named |= {"pred. ": "predicted_rms_after_when_named"}
    if tracked.told:
        named |= {"pred.,\nat once": "predicted_rms_after"}
    if tracked.undiagnosed is not None:
        named |= {"without\ndiagnosis": "rms_after_without_diagnosis"}
    values = {heading: summary[key] for heading, key in named.items()}
    for one in summary.get("controllers", ()):
        label = controller_label(one["name"])
        values |= {f"{label},\n{when}": one[f"rms_{when}"] for when in ("before", "after")}
    rows = [
        {"row": ROWS[row]}
        | {heading: each and said(each[k], summary["units"][k]) for heading, each in values.items()}
        for k, row in enumerate(tracked.rig.major)
    ]
    learns = "is never informed"
    if tracked.told:
        learns = "learns of each failure when this one did; at once: that is informed at once"
    legend = (
        "Before and after the first failure or event. pred.: by the linear model with the noise "
        f"that the sensors had, with a controller that {learns}."
    )
    title = f"{tracked.rig.title}: RMS of desired minus true"
    errors = tabulate(
        title, [Column(each.strip(), each) for each in ("row", *values)], rows, legend
    )
    columns = Column("at, s", "time_s", ".3f"), Column("what", "what"), Column("", "meaning")
    log = tabulate("What happened", columns, _log(tracked, summary))
    return [errors, log] if log.rows else [errors]


def _log(tracked: Tracked, summary: dict[str, Any]) -> list[dict[str, Any]]:
    """Failures, as classified, events and diagnoses, in the order of time."""
    entries = [
        one
        | {"what": one["name"] if one["actuator"] is None else f"{one['actuator']} {one['name']}"}
        | {"meaning": EVENTS[one["name"]].sentence}
        for one in summary["events"]
    ]
    for one, report in zip(summary["failures"], tracked.reports[1:], strict=True):
        can = "possible" if is_possible(report) else "not possible"
        meaning = f"major task {can}: {deciding_sentence(report)}"
        entries.append(one | {"what": f"{one['actuator']} {one['kind']}", "meaning": meaning})
    for one in summary["diagnoses"]:
        meaning = "a false alarm" if one["delay_s"] is None else f"after {one['delay_s']:.3f} s"
        if one["acted_s"] is not None:
            meaning += f"; commands follow from {one['acted_s']:.3f} s on"
        if one["withdrawn_s"] is not None:
            meaning += f"; cleared at {one['withdrawn_s']:.3f} s"
        what = f"{one['actuator']} diagnosed {one['kind']}"
        entries.append(one | {"what": what, "meaning": meaning})
    entries.sort(key=lambda one: one["time_s"])
    return entries


def notes(tracked: Tracked, summary: dict[str, Any]) -> list[str]:
    """Sentences below the tables: the verdict first, then what is assumed."""
    rig = tracked.rig
    found = [summary["verdict"], *tracked.advice]
    if (leaves := tracked.predicted.leaves) is not None:
        found.append(f"Nothing is predicted: in the linear model {leaves} leaves its range.")
    elif tracked.uncompared is not None:
        found.append(f"The linear model is not compared after it, as {tracked.uncompared}.")
    for when in ("before", "after"):
        ratio = summary[f"measured_over_predicted_{when}"]
        if ratio is not None and abs(ratio - 1.0) >= AGREES:
            what = f"{ratio:.3g} times the predicted one {when} the first failure"
            found.append(f"The RMS error is {what}, by what is not in the linear model.")
    if summary["limited_by"] is not None:
        found.append(summary["limited_by"])
    if tracked.other is not None and tracked.other.failure is not None:
        found.append(f"{tracked.other.failure}; its last inputs were held from then on.")
    if (dither := summary["dither"]) is not None:
        moved = norms_said(dither["task_motion"], summary["units"])
        found.append(
            f"Dither of {dither['frequency_hz']:g} Hz, no actuator further than "
            f"{largest_by_unit(dither['displacement'], rig.units)}: by the linear model "
            f"{len(dither['isolable'])} failures can be told from those of other actuators in half "
            f"a second; it moves the major rows by {moved} while nothing has failed."
        )
    found += loops_said(rig.major, rig.margins)
    assumed = (*rig.warnings, *summary["met"])
    found += [f"{sentence[0].upper()}{sentence[1:]}." for sentence in assumed]
    demanded, exact = "is" if rig.feedforward else "is not", "" if assumed else "exact "
    found.append(
        f"The path {demanded} demanded through the inverse of the linear model. "
        f"{sizes_said(summary)} Diagnosis and controller have the {exact}model of the robot."
    )
    return found


def record(tracked: Tracked, summary: dict[str, Any], folder: Path) -> None:
    """Write `track.rrd`: the run, and beside it that of another controller."""
    rig = tracked.rig
    properties = {"seed": summary["seed"], "control_period_s": summary["control_period_s"]}
    properties |= {"path_size": rig.size, "sensor_noise": rig.noise} | version_properties(summary)
    about = About(
        study="track",
        identity=f"track-{rig.title}-seed{tracked.seed}",
        said=[f"- {each}" for each in (summary["verdict"], *loops_said(rig.major, rig.margins))],
        parameters=properties,
        predicted=(summary["predicted_rms_before"], summary["predicted_rms_after_when_named"]),
        checks=checks(summary),
        verdict=summary["verdict"],
    )
    runs = {rig.title: view_of(rig, tracked.run)}
    if (other := tracked.other) is not None:
        runs[controller_label(other.name)] = view_of(rig, other.run)
    write_views(folder / "track.rrd", about, runs)
