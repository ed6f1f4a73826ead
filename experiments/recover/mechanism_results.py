"""Recovery of any robot as numbers, tables and sentences."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from experiments.recover.mechanism_tables import MISSED, counted, notes, tables
from experiments.recover.mechanisms import Mechanisms
from experiments.rig.checks import closure_check
from experiments.rig.dither import dither_entry
from experiments.rig.rig import Rig
from experiments.rig.units import by_unit
from experiments.study.campaign import Row
from experiments.study.results import Check, Results
from experiments.study.resumable import origin
from ftc.fdi.fault_model import KINDS


def results(outcome: Mechanisms) -> Results:
    """Everything that `fjh recover --model` publishes."""
    summary = origin("recover", outcome.done) | summarize(outcome, outcome.done.dataset.rows())
    return replace(
        described(summary),
        records=[lambda folder: outcome.done.dataset.merge(folder / summary["dataset"])],
    )


def described(summary: dict[str, Any]) -> Results:
    """Tables, sentences and checks, from `recover.json` alone."""
    return Results(summary, tables(summary), notes(summary), checks(summary))


def checks(summary: dict[str, Any]) -> list[Check]:
    """Whether the robot's loops stayed closed, in flights that stayed finite."""
    what = "number of flights that diverged"
    return [closure_check(summary), Check(what, summary["robot"], summary["diverged"], 1)]


def summarize(outcome: Mechanisms, rows: Sequence[Row]) -> dict[str, Any]:
    """All numbers of its rows, ready for JSON."""
    rig = next(iter(outcome.rigs.values()))
    flown = [row for row in rows if row["status"] == "flown"]
    return {
        "model_sha256": outcome.model_sha256,
        **machine(rig),
        "dither": {
            sense: dither_entry(outcome.dithers[sense], each)
            for sense, each in outcome.rigs.items()
        },
        "sensed": [
            counted(sense, kind, flown) for sense in outcome.rigs for kind in (*KINDS, "none")
        ],
        "missed": [
            {key: row[key] for key in MISSED}
            for row in flown
            if row["kind"] != "none" and not row["right"]
        ],
        "diverged": len(rows) - len(flown),
        "closure_residual_max_m": max(
            (row["closure_residual_max_m"] for row in flown), default=0.0
        ),
    }


def machine(rig: Rig) -> dict[str, Any]:
    """What the robot is, how large its path and how good its sensors are."""
    return {
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
    }
