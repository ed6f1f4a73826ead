"""All numbers of the study, ready for JSON, from the rows of its flights."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from argument_checks.ties import greatest
from experiments.recover.comparison import controller_summary
from experiments.recover.curves import groups, over_oracle, sizes
from experiments.recover.flight import DITHER
from experiments.recover.pointing import WHEN, pointing_error_urad
from experiments.recover.predictions import ALIKE, EVIDENCE_S
from experiments.recover.rates import per_hour, quantiles, rate
from experiments.recover.recovery import RECOVERED_S, Identification
from experiments.recover.row import CONTROLLERS
from experiments.recover.runs import Recover
from experiments.rig.hexapod.fault_tolerance import fault_entry
from experiments.rig.hexapod.mismatch import ALL_SIZES
from experiments.rig.hexapod.simulation import Trajectory
from experiments.rig.hexapod.testbed import TestbedConfig
from experiments.study.campaign import Row
from experiments.study.resumable import origin
from ftc.fdi.diagnosis import DEFAULT_CONFIG
from ftc.fdi.fault_model import KINDS

ISOLABLE = 10.0
"""Fixed beforehand: a failure counts in the isolation rate if the linear model puts half a second
of its outputs this far from every other explanation: odds of e^50 on average."""

_CONFIG_KEYS = {"effectiveness_step": "strength_step"}


def read_rows(outcome: Recover) -> list[Row]:
    """All rows, in the order of their numbers, with another controller's columns where it flew."""
    other = {columns["case"]: columns for columns in outcome.others}
    return [row | other.get(row["case"], {}) for row in outcome.done.dataset.rows()]


def summarize(outcome: Recover, rows: Sequence[Row]) -> dict[str, Any]:
    """All numbers; units are in the names."""
    config = {_CONFIG_KEYS.get(key, key): value for key, value in asdict(DEFAULT_CONFIG).items()}
    flown = [row for row in rows if row["status"] == "flown"]
    failures = [row for row in flown if row["sort"] == "failure"]
    main = {name: [r for r in failures if r["mismatch"] == name] for name in ("exact", "all")}
    mixed = main["all"]
    # Against the size of a mismatch flights go on to where the loops themselves are unstable.
    residuals_m = [row["closure_residual_max_m"] for row in flown if row["sort"] != "size"]
    residuals_m += [found.closure_residual_max_m for _, found in outcome.shown.values()]
    return (
        origin("recover", outcome.done)
        | {
            "jacobian": "constant",
            "bench": asdict(TestbedConfig()) | outcome.plant,
            "rules": config,
            "mismatch": ALL_SIZES,
            "dither": {
                "amplitude_m": DITHER.amplitude,
                "frequency_hz": DITHER.frequency_hz,
                "direction": list(DITHER.direction),
                "rest_m": np.broadcast_to(DITHER.offset, 6).tolist(),
            },
            "recovered_from_s": RECOVERED_S,
            "flights": dict(Counter(row["sort"] for row in rows)),
            "diverged": len(rows) - len(flown),
            "failures": groups(failures),
            "sizes": sizes(flown),
            "isolation": {name: _isolation(own) for name, own in main.items()},
            "delay_ms": {kind: _delays_ms(mixed, kind) for kind in KINDS},
            "errors_urad": {kind: _errors_urad(mixed, kind) for kind in KINDS},
            "after_over_oracle": {name: over_oracle(own) for name, own in main.items()},
            "sound": _sound([row for row in flown if row["sort"] == "sound"]),
            "second_failure": _pairs([row for row in flown if row["sort"] == "pair"]),
            "dither_design": outcome.dither_design,
            "dither_cost": outcome.dither_cost,
            "ambiguity": {
                "alike_below": ALIKE,
                "evidence_s": EVIDENCE_S,
                "failures": outcome.lookalikes,
            },
            "beliefs": _beliefs(outcome.beliefs),
            "told": outcome.informed,
            "shown": {name: _shown(*each) for name, each in outcome.shown.items()},
            "closure_residual_max_m": max(residuals_m),
        }
        | controller_summary(outcome, mixed)
    )


def _isolation(rows: Sequence[Row]) -> dict[str, Any]:
    """Of the failures that the exact linear model tells apart."""
    others = [row["separation_from_others"] for row in rows]
    kinds = [row["separation_from_kinds"] for row in rows]
    cases = list(zip(rows, others, kinds, strict=True))
    return {
        "separation_required": ISOLABLE,
        "strut_as_first_named": rate([r["strut_right"] for r, far, _ in cases if far >= ISOLABLE]),
        "strut_and_kind_in_the_end": rate(
            [r["all_right"] for r, *far in cases if min(far) >= ISOLABLE]
        ),
        "smallest_separation_from_others": min(others),
        "smallest_separation_from_kinds": min(kinds),
    }


def _delays_ms(rows: Sequence[Row], kind: str) -> dict[str, Any]:
    """From failure to alarm and to the naming, of the struts that were rightly named."""
    named = [row for row in rows if row["kind"] == kind and row["strut_right"]]
    return {
        what: quantiles([row[f"{what}_ms"] for row in named if row[f"{what}_ms"] is not None])
        for what in ("alarm", "named")
    }


def _errors_urad(rows: Sequence[Row], kind: str) -> dict[str, Any] | None:
    """Root of the mean square over the flights, and the largest peak: before, during, after."""
    cases = [row for row in rows if row["kind"] == kind]
    if not cases:
        return None
    flown = [name for name in (*CONTROLLERS, "other") if f"rms_{name}_after_urad" in cases[0]]

    def pooled(name: str, when: str) -> dict[str, float]:
        rms = [row[f"rms_{name}_{when}_urad"] for row in cases]
        peaks = [row[f"peak_{name}_{when}_urad"] for row in cases]
        return {"rms": float(np.sqrt(np.mean(np.square(rms)))), "peak": max(peaks)}

    return {name: {when: pooled(name, when) for when in WHEN} for name in flown}


def _sound(rows: Sequence[Row]) -> dict[str, Any]:
    """Long flights without failures: what was flown, and what happened in it."""
    hours = sum(row["duration_s"] for row in rows) / 3600
    watched_hours = hours - len(rows) * DEFAULT_CONFIG.learning_s / 3600
    return {
        "flights": len(rows),
        **per_hour(sum(row["alarms"] for row in rows), watched_hours),
        "hours": hours,
        "watched_hours": watched_hours,
        "sound_named": sum(row["sound_named"] for row in rows),
        "named_per_hour": per_hour(sum(row["sound_named"] for row in rows), watched_hours),
        "commands_changed": sum(row["commands_changed"] for row in rows),
        "unexplained": sum(row["unexplained"] for row in rows),
    }


def _pairs(rows: Sequence[Row]) -> dict[str, Any]:
    return {
        "all_right": rate([row["all_right"] for row in rows]),
        "sound_named": sum(row["sound_named"] for row in rows),
        "task_lost": sum(row["task_lost"] for row in rows),
        "handled_or_declared": rate([row["all_right"] or row["task_lost"] for row in rows]),
        "gave_up": sum(row["unexplained"] for row in rows),
    }


def _beliefs(beliefs: Sequence[dict[str, Any]]) -> dict[str, Any]:
    worst = beliefs[greatest([each["sensitivity_peak"] for each in beliefs])]
    return {
        "pairs_of_truth_and_belief": len(beliefs),
        "unstable": sum(each["largest_pole"] >= 1 for each in beliefs),
        "largest_pole": max(each["largest_pole"] for each in beliefs),
        "sensitivity_peak_nothing_failed": beliefs[0]["sensitivity_peak"],
        "sensitivity_peak_worst": worst["sensitivity_peak"],
        "worst_truth": worst["truth"],
        "worst_belief": worst["believed"],
    }


def _shown(run: Trajectory, found: Identification) -> dict[str, Any]:
    error_urad = pointing_error_urad(run.desired_rad, run.true_rad)
    last_second = round(1 / TestbedConfig().control_period_s)
    happened = [
        {"strut": each.number + 1, "kind": each.kind, "time_s": each.time_s}
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
