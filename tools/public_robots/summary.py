"""Results of all robots: a table with a row for each, and totals."""

import csv
import io
import re
from collections import Counter
from collections.abc import Sequence
from math import hypot
from typing import Any

import pandas as pd

from experiments.recover.tables import share
from fjh.rig.units import ROWS
from tools.public_robots.registry import PACKAGES

AGREES = 0.2
"""Relative error up to which an RMS agrees with the prediction."""
COLUMNS = (
    *("package", "version", "robot", "actuators", "major_rows", "outcome"),
    *("rms_percent_of_radius", "measured_over_predicted", "after_lock_measured_over_predicted"),
    *("identified_after_ms", "false_diagnoses", "message"),
)
"""Columns of the CSV file; cells are empty where a robot has no result or prediction."""
RUNS = ("healthy", "lock")
Record = dict[str, Any]


def table(records: Sequence[Record]) -> str:
    """Return the CSV file, one line for each robot, packages in the order of :data:`PACKAGES`."""
    text = io.StringIO()
    lines = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    lines.writeheader()
    for package in PACKAGES:
        lines.writerows(_cells(record) for record in records if record["package"] == package)
    return text.getvalue()


def outcome(record: Record) -> str:
    """Return one of completed, refused, traceback and timeout_s."""
    if record.get("stage", "load") is None:
        return "completed"
    return next(key for key in ("traceback", "refused", "timeout_s") if key in record)


def _ratio(numbers: Record) -> float | None:
    """Return measured over predicted RMS of a run, all rows together; None without a prediction."""
    if numbers["predicted"] is None or numbers["uncompared"] is not None:
        return None
    predicted = hypot(*numbers["predicted"])
    return hypot(*numbers["measured"]) / predicted if predicted else None


def _is_off(record: Record, run: str) -> bool:
    """Return True if a prediction is off by more than 20 % without a warning of the rig."""
    value = _ratio(record[run]) if run in record else None
    return value is not None and abs(value - 1.0) > AGREES and not record["rig"]["warnings"]


def totals(records: Sequence[Record]) -> dict[str, Any]:
    """Return the totals: outcomes, errors, agreement with predictions, and diagnoses.

    Shares have the 95 % interval of Clopper and Pearson.
    """
    result: dict[str, Any] = {"models": len(records)} | Counter(map(outcome, records))
    for stage in ("jacobians", "power"):
        errors = [record[stage]["error"] for record in records if stage in record]
        result |= {f"{stage}_models": len(errors), f"{stage}_largest_error": max(errors, default=0)}
    for run in RUNS:
        finished = [record for record in records if run in record]
        ratios = [_ratio(record[run]) for record in finished]
        known = [ratio for ratio in ratios if ratio is not None]
        result |= share(f"{run}_close", pd.Series([abs(ratio - 1) <= AGREES for ratio in known]))
        result[f"{run}_without_prediction"] = len(ratios) - len(known)
        result[f"{run}_off_without_warning"] = sum(_is_off(record, run) for record in finished)
        wrong = pd.Series([bool(record[run]["wrong"]) for record in finished])
        result |= share(f"{run}_wrong", wrong)
    locked = [record["lock"] for record in records if "lock" in record]
    named = pd.Series([run["named_after_ms"] is not None for run in locked])
    return result | share("lock_named", named)


def _cells(record: Record) -> dict[str, object]:
    """Return the cells of a robot by column."""
    kind = outcome(record)
    cells: dict[str, object] = {
        "package": record["package"],
        "version": PACKAGES[record["package"]],
        "robot": record["name"],
        "outcome": "out of time" if kind == "timeout_s" else kind,
        "message": message(record),
    }
    if "load" in record:
        cells["actuators"] = record["load"]["actuators"]
    if "rig" in record:
        cells["major_rows"] = ", ".join(ROWS[k] for k in record["rig"]["rows"])
    if "healthy" in record:
        cells["rms_percent_of_radius"] = f"{100 * record['healthy']['of_path']:.3g}"
        wrong = [record[run]["wrong"] for run in RUNS if run in record]
        cells["false_diagnoses"] = sum(map(len, wrong))
    if "lock" in record:
        delay_ms = record["lock"]["named_after_ms"]
        cells["identified_after_ms"] = "never" if delay_ms is None else delay_ms
    for run, column in zip(RUNS, COLUMNS[7:9], strict=True):
        if run in record and (ratio := _ratio(record[run])) is not None:
            cells[column] = f"{ratio:.2f}"
    return cells


def message(record: Record) -> str:
    """Return the reason for which a robot is refused, or its warnings."""
    kind = outcome(record)
    if kind == "completed":
        leaving = {record[run]["leaves"] for run in RUNS} - {None}
        beyond = [f"{name} leaves its range in the linear model" for name in sorted(leaving)]
        return "; ".join(dict.fromkeys([*beyond, *map(_kind, record["rig"]["warnings"])]))
    if kind == "timeout_s":
        return f"{record['stage']}: not done after {record[kind]:g} s"
    return f"{record['stage']}: {'traceback, ' * (kind == 'traceback')}{record[kind]}"


def _kind(sentence: str) -> str:
    """Remove names and numbers from a sentence, so that sentences of one kind are equal."""
    plain = re.sub(r'"[^"]*"|\'[^\']*\'', '"..."', sentence)
    plain = re.sub(r'(?:"...", )+', "", plain)
    plain = re.sub(r"dry friction of \S+", "dry friction of ...", plain)
    return re.sub(r"\d[\d.e+-]*", "#", plain)
