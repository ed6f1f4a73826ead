"""Recovery from unannounced failures as numbers, checks, tables and files."""

from collections.abc import Sequence
from dataclasses import asdict
from functools import partial
from math import nan
from pathlib import Path
from typing import Any

import numpy as np

from experiments.hexapod.fault_tolerance import fault_entry
from experiments.hexapod.metrics import closure_check, recording_properties
from experiments.hexapod.recording.keep import record_run
from experiments.hexapod.recording.shown import Shown
from experiments.hexapod.simulation import Trajectory
from experiments.hexapod.testbed import TestbedConfig
from experiments.output.provenance import versions
from experiments.output.results import Check, Results
from experiments.output.tables import Column, Table, tabulate
from experiments.recover.comparison import (
    controller_case,
    controller_checks,
    controller_notes,
    controller_summary,
    record_compared,
)
from experiments.recover.figure import pictures
from experiments.recover.predictions import ALIKE, EVIDENCE_S
from experiments.recover.recovery import (
    DITHER,
    RECOVERED_S,
    STRUCK,
    Identification,
    Recovery,
    pointing_error_urad,
)
from experiments.recover.robustness import rate, rates
from experiments.recover.runs import MAIN, Recover, marks
from ftc.fdi.diagnosis import DEFAULT_CONFIG
from ftc.fdi.fault_model import KINDS
from sim import load_model, model_sha256

ISOLABLE = 10.0
"""Fixed beforehand: a failure counts in the isolation rate if the linear model puts half a second
of its outputs this far from every other explanation: odds of e^50 on average."""

NOT_ISOLATED, OVER_ORACLE, FALSE_ALARMS_PER_HOUR = 0.01, 1.10, 0.1
"""Goals: the share of failures that may stay unidentified, the RMS over an informed controller's,
and the rate of false alarms."""

ENOUGH_H = 30.0
"""Fewer hours could not show the rate of false alarms even without any alarm."""

_CONFIG_KEYS = {"effectiveness_step": "strength_step", "least_p_value": "misfit"}
_WHEN = ("before", "during", "after")


def results(outcome: Recover) -> Results:
    """Everything that `fjh recover` publishes."""
    summary = summarize(outcome)
    return Results(
        summary,
        tables=(recovery(summary), ambiguity(summary)),
        notes=notes(summary),
        checks=checks(summary),
        pictures=pictures(outcome, summary),
        records=[
            *(partial(_record, outcome, summary, name) for name in outcome.shown),
            *(partial(record_compared, outcome, summary, name) for name in outcome.compared),
        ],
    )


def summarize(outcome: Recover) -> dict[str, Any]:
    """All numbers, ready for JSON; units are in the names."""
    recoveries, shown = outcome.recoveries, outcome.shown
    config = {_CONFIG_KEYS.get(key, key): value for key, value in asdict(DEFAULT_CONFIG).items()}
    ambiguity = {"alike_below": ALIKE, "evidence_s": EVIDENCE_S}
    identified = [each.found for each in recoveries]
    successions = [found for _, found in (*outcome.pairs, *shown.values())]
    return {
        "experiment": "recover",
        "seed": outcome.seed,
        "versions": versions(),
        "model_sha256": model_sha256(),
        "jacobian": "constant",
        "bench": asdict(TestbedConfig()) | outcome.plant,
        "rules": config,
        "dither": {
            "amplitude_m": DITHER.amplitude,
            "frequency_hz": DITHER.frequency_hz,
            "direction": list(DITHER.direction),
            "rest_m": np.broadcast_to(DITHER.offset, 6).tolist(),
        },
        "recovered_from_s": RECOVERED_S,
        "isolation": _isolation(recoveries, outcome.predicted),
        "settings": [
            {"name": name, "named": sum(each.first is not None for each in found)} | rates(found)
            for name, found in ({MAIN.name: identified} | outcome.others).items()
        ],
        "delay_ms": {kind: _delays_ms(recoveries, kind) for kind in KINDS},
        "errors_urad": {kind: _errors_urad(recoveries, kind) for kind in KINDS},
        "after_over_oracle": _over_oracle(recoveries),
        "false_alarms": {
            "flown": outcome.fault_free.entry,
            "with_fresh_noise": outcome.redrawn.entry,
            "model_error_max_urad": outcome.model_error_urad,
        },
        "dither_design": outcome.dither_design,
        "dither_cost": outcome.dither_cost,
        "ambiguity": ambiguity | {"failures": outcome.lookalikes},
        "beliefs": _beliefs(outcome.beliefs),
        "told": outcome.informed,
        "gave_up": sum(each.unexplained for each in identified),
        "second_failure": {
            "all_right": rate([found.all_right for _, found in outcome.pairs]),
            "gave_up": sum(found.unexplained for _, found in outcome.pairs),
            "flights": [_succession(*each) for each in outcome.pairs],
        },
        "mismatch": outcome.mismatches,
        "shown": {name: _succession(*each) for name, each in shown.items()},
        "closure_residual_max_m": max(e.closure_residual_max_m for e in identified + successions),
        "cases": [_case(*each) for each in zip(recoveries, outcome.predicted, strict=True)],
    } | controller_summary(outcome)


def checks(summary: dict[str, Any]) -> list[Check]:
    """Checks: closure residuals, stability, identification, recovery, false alarms."""
    beliefs, alarms = summary["beliefs"], summary["false_alarms"]
    worst = f"{beliefs['worst_truth']}, {beliefs['worst_belief']} diagnosed"
    found = [
        closure_check("all runs", summary["closure_residual_max_m"]),
        Check(
            "number of unstable pairs of true and diagnosed fault", worst, beliefs["unstable"], 1
        ),
    ]
    isolation = {key.replace("_", " "): counted for key, counted in summary["isolation"].items()}
    for which in ("strut as first named", "strut and kind in the end"):
        found.append(_isolated(which, isolation[which]["rate"]))
    for which, ratio in summary["after_over_oracle"].items():
        what = "RMS after recovery divided by that of a controller informed at once"
        found.append(Check(what, which.replace("_", " "), ratio, OVER_ORACLE))
    found.append(_isolated("two failures in a run", summary["second_failure"]["all_right"]["rate"]))
    for name, happened in summary["shown"].items():
        what = "wrong diagnosis of the failures or of the task (0 no, 1 yes),"
        found.append(Check(what, f"run {name}", float(not happened["right"]), 0.5))
    for which in ("flown", "with_fresh_noise"):
        bound = "high_per_hour_95" if alarms[which]["hours"] >= ENOUGH_H else "low_per_hour_95"
        what = "95 % bound of the false alarms per hour"
        where = which.replace("_", " ").replace("flown", "as simulated")
        found.append(Check(what, where, alarms[which][bound], FALSE_ALARMS_PER_HOUR))
    return found + controller_checks(summary)


def _isolated(where: str, right: float | None) -> Check:
    what = "share of the isolable failures that is not identified"
    return Check(what, where, nan if right is None else 1 - right, NOT_ISOLATED)


def recovery(summary: dict[str, Any]) -> Table:
    """Delays and pointing errors by kind of failure."""

    def delay(what: str, kind: str) -> str:
        counted = summary["delay_ms"][kind][what]
        return "" if counted is None else "/".join(f"{ms:.0f}" for ms in counted.values())

    def error(controller: str, when: str, kind: str) -> str:
        pooled = summary["errors_urad"][kind]
        return "" if pooled is None else "{rms:.2f}/{peak:.1f}".format(**pooled[controller][when])

    controllers = {"supervised": "supervised"}
    controllers |= {"informed": "informed at once", "uncorrected": "fault-unaware"}
    if "controller" in summary:
        controllers["other"] = summary["controller"]["name"]
    cells = {
        "alarm, ms: median/95 %/largest": partial(delay, "alarm"),
        "identified, ms: median/95 %/largest": partial(delay, "named"),
        "before, urad: RMS/peak": partial(error, "supervised", "before"),
    }
    for when in ("during", "after"):
        cells |= {f"{when}: {said}": partial(error, key, when) for key, said in controllers.items()}
    rows = [{"": label} | {kind: cell(kind) for kind in KINDS} for label, cell in cells.items()]
    return tabulate(
        "Unannounced actuator failures: detection, isolation and recovery",
        [Column(heading, heading) for heading in ("", *KINDS)],
        rows,
        "The controller has an exact model of the simulated plant. Delays are from the failure on; "
        "pointing errors are before the failure, from it until recovery (during), and after. weak: "
        "the coil has lost part of its force. supervised: the controller diagnoses the failure. "
        "informed: it is given the failure at once. fault-unaware: it does not change.",
    )


def ambiguity(summary: dict[str, Any]) -> Table:
    """Smallest distances between failures over the struts, and the pairs that look alike."""
    groups: dict[tuple[str, str, str], list[dict[str, Any]]] = {}
    for seen in summary["ambiguity"]["failures"]:
        key = (seen["failure"]["kind"], seen["where"], seen["setting"])
        groups.setdefault(key, []).append(seen)
    headings, entries = ("failure", "where", "setting", "other strut", "other kind", "alike"), []
    for (kind, where, setting), seen in sorted(groups.items()):
        strut = min(each["from_other_struts"] for each in seen)
        other = min(seen, key=lambda each: each["from_other_kinds"])
        nearest = f"{other['from_other_kinds']:.1f} ({other['nearest_other_kind']})"
        alike = " ".join(
            f"{each['failure']['strut']}={twin['strut']}{'' if twin['kind'] == kind else ' ?'}"
            for each in seen
            for twin in each["alike"]
        )
        cells = kind, where, setting, f"{strut:.1f}", nearest, alike
        entries.append(dict(zip(headings, cells, strict=True)))
    below, evidence = summary["ambiguity"]["alike_below"], summary["ambiguity"]["evidence_s"]
    return tabulate(
        "Isolability: distances between failures",
        [Column(heading, heading) for heading in headings],
        entries,
        f"Distance between the outputs of a failure over {evidence:g} s and those of the most "
        f"similar failure of another strut or kind, in standard deviations; minimum over the six "
        f"struts. alike: pairs of struts with a distance below {below:g}; ?: of another kind.",
    )


def notes(summary: dict[str, Any]) -> list[str]:
    """The results, one sentence each."""
    isolation, alarms = summary["isolation"], summary["false_alarms"]
    beliefs, second = summary["beliefs"], summary["second_failure"]
    over, cost = summary["after_over_oracle"], summary["dither_cost"]
    change, reseeded = (max(map(abs, cost[f"{key}_urad"])) for key in ("change", "reseeded"))
    lines = [
        f"Of the failures with a distance of at least {isolation['separation_required']:g} in the "
        f"linear model, the first diagnosis had the right strut in "
        f"{_rate(isolation['strut_as_first_named'])}, the last one the right strut and kind in "
        f"{_rate(isolation['strut_and_kind_in_the_end'])}.",
        *(
            f"Diagnosed from {each['name']}: strut identified in {_rate(each['strut'])}, strut and "
            f"kind in {_rate(each['strut_and_kind'])}."
            for each in summary["settings"]
        ),
        f"After recovery the RMS error is {over['pooled']:.4f} times that of a controller informed "
        f"at once; {over['worst_case']:.4f} times in the worst case.",
        f"False alarms: {_alarms(alarms['flown'])} in simulation, "
        f"{_alarms(alarms['with_fresh_noise'])} in the same runs with new samples of the noise.",
        f"The dither changes the RMS error without failures by {change:.1e} urad, another seed by "
        f"{reseeded:.1e} urad.",
        f"Of {beliefs['pairs_of_truth_and_belief']} pairs of true and diagnosed fault, "
        f"{beliefs['unstable']} give an unstable loop; the peak sensitivity is "
        f"{beliefs['sensitivity_peak_worst']:.2f} at most, "
        f"{beliefs['sensitivity_peak_nothing_failed']:.2f} without failures.",
        f"Both failures were identified in {_rate(second['all_right'])} runs with two failures.",
    ]
    if cascade := summary["shown"].get("cascade"):
        ends = "is impossible" if cascade["task_lost"] else "is still possible"
        lines.append(
            f"After {len(cascade['happened'])} failures the pointing task {ends}, as diagnosed."
        )
    for each in summary["mismatch"]:
        how = "calibrated in a commissioning run" if each["calibrated"] else "uncalibrated"
        alarm = "false alarm" if each["healthy_alarm"] else "no alarm"
        right = each["strut_and_kind"]
        lines.append(
            f"Coil gains wrong by {100 * each['coil_gain_error']:g} %, {how}: {alarm} without "
            f"failures, {right['right']} of {right['cases']} failures identified."
        )
    return lines + controller_notes(summary)


def _rate(rate: dict[str, Any]) -> str:
    if rate["rate"] is None:
        return "no case"
    low, high = 100 * rate["low"], 100 * rate["high"]
    return f"{rate['right']} of {rate['cases']} ({low:.1f} to {high:.1f} %)"


def _alarms(counted: dict[str, Any]) -> str:
    return (
        f"{counted['alarms']} in {counted['hours']:.3g} h (below "
        f"{counted['high_per_hour_95']:.2g} per hour at 95 %)"
    )


def _isolation(
    recoveries: Sequence[Recovery], predicted: Sequence[tuple[float, float]]
) -> dict[str, Any]:
    cases = [(each.found, *far) for each, far in zip(recoveries, predicted, strict=True)]
    struts = [found for found, from_others, _ in cases if from_others >= ISOLABLE]
    both = [found for found, *far in cases if min(far) >= ISOLABLE]
    return {
        "separation_required": ISOLABLE,
        "strut_as_first_named": rate([each.strut_right for each in struts]),
        "strut_and_kind_in_the_end": rate([each.right for each in both]),
        "all_cases_strut": rate([each.found.strut_right for each in recoveries]),
        "all_cases_strut_and_kind": rate([each.found.right for each in recoveries]),
        "smallest_separation_from_others": min(from_others for from_others, _ in predicted),
        "smallest_separation_from_kinds": min(from_kinds for _, from_kinds in predicted),
    }


def _delays_ms(recoveries: Sequence[Recovery], kind: str) -> dict[str, Any]:
    """From failure to alarm and to the first naming, of cases identified."""
    found = [each.found.first for each in recoveries if each.scenario.fault.kind == kind]
    first = [each for each in found if each is not None]
    return {
        "alarm": _quantiles_ms([each.alarm_tick - STRUCK for each in first]),
        "named": _quantiles_ms([each.tick - STRUCK for each in first]),
    }


def _quantiles_ms(ticks: Sequence[int]) -> dict[str, float] | None:
    if not ticks:
        return None
    levels = 1e3 * TestbedConfig().control_period_s * np.quantile(ticks, (0.5, 0.95, 1.0))
    return dict(zip(("median", "percentile_95", "largest"), levels.tolist(), strict=True))


def _errors_urad(recoveries: Sequence[Recovery], kind: str) -> dict[str, Any] | None:
    """Root of the mean square over the cases, and the largest peak: before, during, after."""
    cases = [each for each in recoveries if each.scenario.fault.kind == kind]
    if not cases:
        return None
    pooled = {}
    controllers = ["supervised", "informed", "uncorrected"]
    if cases[0].other is not None:
        controllers.append("other")
    for controller in controllers:
        errors = [getattr(each, controller) for each in cases]
        rms = np.sqrt(np.mean([np.square(each.rms_urad) for each in errors], axis=0))
        peak = np.max([each.peak_urad for each in errors], axis=0)
        pooled[controller] = {
            when: {"rms": float(rms[k]), "peak": float(peak[k])} for k, when in enumerate(_WHEN)
        }
    return pooled


def _over_oracle(recoveries: Sequence[Recovery]) -> dict[str, float]:
    """RMS after recovery, over the informed controller's: all cases together, and the worst."""
    after = np.array([[e.rms_urad[2] for e in (r.supervised, r.informed)] for r in recoveries])
    pooled = np.sqrt((after**2).mean(axis=0))
    return {
        "pooled": float(pooled[0] / pooled[1]),
        "worst_case": float((after[:, 0] / after[:, 1]).max()),
    }


def _beliefs(beliefs: Sequence[dict[str, Any]]) -> dict[str, Any]:
    worst = max(beliefs, key=lambda each: each["sensitivity_peak"])
    return {
        "pairs_of_truth_and_belief": len(beliefs),
        "unstable": sum(each["largest_pole"] >= 1 for each in beliefs),
        "largest_pole": max(each["largest_pole"] for each in beliefs),
        "sensitivity_peak_nothing_failed": beliefs[0]["sensitivity_peak"],
        "sensitivity_peak_worst": worst["sensitivity_peak"],
        "worst_truth": worst["truth"],
        "worst_belief": worst["believed"],
    }


def _succession(run: Trajectory, found: Identification) -> dict[str, Any]:
    error_urad, last_second = pointing_error_urad(run), round(1 / TestbedConfig().control_period_s)
    happened = [
        {"strut": each.actuator + 1, "kind": each.kind, "time_s": each.time_s}
        for each in found.failures
    ]
    return {
        "happened": happened,
        "found": [fault_entry(each.fault) for each in found.standing],
        "right": found.all_right,
        "task_lost": found.task_lost,
        "unexplained": found.unexplained,
        "rms_in_the_end_urad": float(np.sqrt((error_urad[-last_second:] ** 2).mean())),
        "peak_urad": float(error_urad[run.time_s >= found.failures[0].time_s].max()),
    }


def _case(recovery: Recovery, far: tuple[float, float]) -> dict[str, Any]:
    found, scenario, first = recovery.found, recovery.scenario, recovery.found.first
    last = found.standing[-1] if found.standing else None
    return {
        "truth": fault_entry(scenario.fault),
        "time_s": scenario.time_s,
        "seed": scenario.seed,
        "separation_from_others": far[0],
        "separation_from_kinds": far[1],
        "first": first and fault_entry(first.fault),
        "first_strut_confidence": first and first.actuator_confidence,
        "alarm_ms": first and first.alarm_tick - STRUCK,
        "named_ms": first and first.tick - STRUCK,
        "last": last and fault_entry(last.fault),
        "kind_confidence": last and last.kind_confidence,
        "false_alarm": found.false_alarm,
        "rms_after_urad": recovery.supervised.rms_urad[2],
        "rms_after_oracle_urad": recovery.informed.rms_urad[2],
        "rms_after_uncorrected_urad": recovery.uncorrected.rms_urad[2],
    } | controller_case(recovery)


def _record(outcome: Recover, summary: dict[str, Any], name: str, folder: Path) -> None:
    run, found = outcome.shown[name]
    entry, seed = summary["shown"][name], summary["seed"]
    ends = f"In the last second the pointing error is {entry['rms_in_the_end_urad']:.2f} urad RMS."
    if entry["task_lost"]:
        ends = (
            "The remaining struts cannot point: the task is diagnosed as impossible, and the "
            "commands stay constant."
        )
    said = [
        f"Seed {seed}, constant Jacobian, W_a; the failures are unannounced.",
        "",
        "Failures:",
        *(f"- strut {e['strut']} {e['kind']} at {e['time_s']:g} s" for e in entry["happened"]),
        "",
        "Identified from the pointing angles, the commands and a dither:",
        *(f"- strut {each['strut']} {each['kind']}" for each in entry["found"]),
        "",
        ends,
    ]
    record_run(
        folder,
        name,
        f"recover-{name}-seed{seed}",
        load_model(),
        Shown(run, marks(run, found)),
        said=said,
        beside={},
        properties=recording_properties(summary),
    )
