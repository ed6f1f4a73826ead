"""Results of all robots: docs/data/robots.csv, and the totals on docs/refused.md."""

import csv
import io
import re
from collections import Counter
from collections.abc import Sequence
from math import hypot
from typing import Any

from fjh.rig.units import ROWS
from tools.public_robots.registry import PACKAGES

AGREES = 0.2
"""Relative error up to which an RMS agrees with the prediction."""
START = "<!-- totals of `make robots` -->\n"
END = "<!-- end -->"
COLUMNS = (
    *("package", "version", "robot", "actuators", "major_rows", "outcome"),
    *("rms_percent_of_radius", "measured_over_predicted", "after_lock_measured_over_predicted"),
    *("identified_after_ms", "false_diagnoses", "message"),
)
"""Columns of the CSV file; cells are empty where a robot has no result or prediction."""
RUNS = ("healthy", "lock")
Record = dict[str, Any]


def page(before: str, records: Sequence[Record], conditions: str) -> str:
    """Return the page with new totals.

    Args:
        before: Former page; only the text between :data:`START` and :data:`END` changes.
        records: Records of all robots.
        conditions: Date, versions and machine, one sentence.
    """
    head, _, tail = before.partition(START)
    tail = tail.partition(END)[2]
    totals = "\n".join(f"- {line}" for line in _counts(records))
    return f"{head}{START}{conditions}\n\n{totals}\n{END}{tail}"


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


def _counts(records: Sequence[Record]) -> list[str]:
    """Return the totals, one sentence a line."""
    kinds = Counter(map(outcome, records))
    healthy, lock = ([each for each in records if run in each] for run in RUNS)
    close, without = [], []
    for run, finished in zip(RUNS, (healthy, lock), strict=True):
        ratios = [_ratio(each[run]) for each in finished]
        known = [each for each in ratios if each is not None]
        close.append(f"{sum(abs(each - 1.0) <= AGREES for each in known)} of {len(known)}")
        without.append(str(len(ratios) - len(known)))
    silent = sum(any(_is_off(each, run) for run in RUNS) for each in healthy)
    identified = sum(each["lock"]["named_after_ms"] is not None for each in lock)
    wrong = sum(bool(each["healthy"]["wrong"]) for each in healthy)
    worst = []
    for stage in ("jacobians", "power"):
        errors = [each[stage]["error"] for each in records if stage in each]
        largest = max(errors, default=0.0)
        worst.append(f"{len(errors)} models, largest relative error {largest:.1e}")
    return [
        f"{len(records)} models: {kinds['completed']} completed both runs, {kinds['refused']} were "
        f"refused, {kinds['timeout_s']} exceeded the time limit, {kinds['traceback']} crashed.",
        f"Jacobians: {worst[0]}. Power: {worst[1]}.",
        f"RMS error within 20 % of the prediction: {close[0]} runs without failure and "
        f"{close[1]} after the lock; {without[0]} and {without[1]} have no prediction. "
        f"Beyond 20 % without a warning that says why: {silent}.",
        f"The lock was identified in {identified} of {len(lock)} runs. Something was diagnosed in "
        f"{wrong} of {len(healthy)} runs without failure.",
    ]


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
