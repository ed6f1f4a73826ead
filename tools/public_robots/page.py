"""The generated part of docs/robots.md, from the results of all trials."""

import re
from collections import Counter
from collections.abc import Sequence
from math import hypot
from typing import Any

from fjh.rig.units import ROWS
from tools.public_robots.registry import PACKAGES

AGREES = 0.2
"""Relative error up to which an RMS is as predicted."""
GENERATED = "<!-- From here on written by `make robots`. -->"
_COLUMNS = (
    *("robot", "actuators", "rows", "rms", "measured / predicted", "after the lock"),
    *("named", "wrong", "refused, or warned"),
)
_WIDEST = 110
FLIGHTS = ("sound", "lock")
Record = dict[str, Any]


def page(before: str, records: Sequence[Record], conditions: str) -> str:
    """The page: its text, then conditions, headlines, every robot, sentences that refused.

    Args:
        before: The page as it is; what stands above :data:`GENERATED` is kept.
        records: Of all robots.
        conditions: Date, versions and machine, one sentence.
    """
    text = before.partition(GENERATED)[0].rstrip()
    parts = [text, GENERATED, "## Results", conditions, _listed(_counts(records))]
    for package, version in PACKAGES.items():
        if rows := [_cells(each) for each in records if each["package"] == package]:
            lines = [f"| {' | '.join(c)} |" for c in (_COLUMNS, ["---"] * len(_COLUMNS), *rows)]
            parts += [f"### {package} {version}", "\n".join(lines)]
    refused = (each for each in records if outcome(each) in ("refused", "traceback"))
    counted = Counter(_kind(said(each)) for each in refused).most_common()
    refusals = [f"{count} at {_short(sentence)}" for sentence, count in counted]
    parts += ["## What refused them", _listed(refusals) or "Nothing."]
    return "\n\n".join(parts) + "\n"


def _listed(lines: Sequence[str]) -> str:
    return "\n".join(f"* {line}" for line in lines)


def outcome(record: Record) -> str:
    """One of flies, refused, traceback and timeout_s."""
    if record.get("stage", "load") is None:
        return "flies"
    return next(key for key in ("traceback", "refused", "timeout_s") if key in record)


def _ratio(numbers: Record) -> float | None:
    """Measured over predicted RMS of a flight, all rows together; None without a prediction."""
    if numbers["predicted"] is None or numbers["uncompared"] is not None:
        return None
    predicted = hypot(*numbers["predicted"])
    return hypot(*numbers["measured"]) / predicted if predicted else None


def _is_off(record: Record, flight: str) -> bool:
    """Whether a prediction is off by more than 20 %, and no warning says what it leaves out."""
    value = _ratio(record[flight]) if flight in record else None
    return value is not None and abs(value - 1.0) > AGREES and not record["rig"]["warnings"]


def _counts(records: Sequence[Record]) -> list[str]:
    """Headlines, each with what it is of."""
    kinds = Counter(map(outcome, records))
    sound, lock = ([each for each in records if flight in each] for flight in FLIGHTS)
    close, without = [], []
    for flight, flown in zip(FLIGHTS, (sound, lock), strict=True):
        ratios = [_ratio(each[flight]) for each in flown]
        known = [each for each in ratios if each is not None]
        close.append(f"{sum(abs(each - 1.0) <= AGREES for each in known)} of {len(known)}")
        without.append(str(len(ratios) - len(known)))
    silent = sum(any(_is_off(each, flight) for flight in FLIGHTS) for each in sound)
    named = sum(each["lock"]["named_after_ms"] is not None for each in lock)
    wrong = sum(bool(each["sound"]["wrong"]) for each in sound)
    worst = []
    for stage in ("jacobians", "power"):
        errors = [each[stage]["error"] for each in records if stage in each]
        largest = max(errors, default=0.0)
        worst.append(f"{len(errors)} models, largest relative error {largest:.1e}")
    return [
        f"models tried: {len(records)}; both flights: {kinds['flies']}; refused: "
        f"{kinds['refused']}; tracebacks: {kinds['traceback']}; "
        f"not done after the time limit: {kinds['timeout_s']}",
        f"Jacobians: {worst[0]}; power: {worst[1]}",
        f"RMS as predicted within 20 % without a failure: {close[0]}; after the lock: "
        f"{close[1]}; off without a warning in either: {silent}; "
        f"without a prediction: {' and '.join(without)}",
        f"lock named: {named} of {len(lock)}; flights without a failure in which "
        f"something was named: {wrong} of {len(sound)}",
    ]


def _cells(record: Record) -> list[str]:
    """Empty where a robot did not come that far."""
    cells = {"robot": f"`{record['name']}`", "refused, or warned": _short(said(record))}
    if "load" in record:
        cells["actuators"] = str(record["load"]["actuators"])
    if "rig" in record:
        cells["rows"] = ", ".join(ROWS[k] for k in record["rig"]["rows"])
    if "sound" in record:
        cells["rms"] = f"{100 * record['sound']['of_path']:.3g} %"
        wrong = [record[flight]["wrong"] for flight in FLIGHTS if flight in record]
        cells["wrong"] = str(sum(map(len, wrong)))
    if "lock" in record:
        delay_ms = record["lock"]["named_after_ms"]
        cells["named"] = "never" if delay_ms is None else f"{delay_ms} ms"
    for flight, column in zip(FLIGHTS, ("measured / predicted", "after the lock"), strict=True):
        if flight in record:
            value, bold = _ratio(record[flight]), "**" * _is_off(record, flight)
            cells[column] = "not comparable" if value is None else f"{bold}{value:.2f}{bold}"
    return [cells.get(column, "") for column in _COLUMNS]


def said(record: Record) -> str:
    """What a robot is refused for, or warned of."""
    kind = outcome(record)
    if kind == "flies":
        leaves = {record[flight]["leaves"] for flight in FLIGHTS} - {None}
        beyond = [f"{name} leaves its range in the linear model" for name in sorted(leaves)]
        return "; ".join(dict.fromkeys([*beyond, *map(_kind, record["rig"]["warnings"])]))
    if kind == "timeout_s":
        return f"{record['stage']}: not done after {record[kind]:g} s"
    return f"{record['stage']}: {'traceback, ' * (kind == 'traceback')}{record[kind]}"


def _short(sentence: str) -> str:
    plain = re.sub(r"[|`<>*_$\\\[\]]", lambda found: f"\\{found[0]}", sentence)
    return plain if len(plain) <= _WIDEST else f"{plain[:_WIDEST].rstrip(chr(92))} ..."


def _kind(sentence: str) -> str:
    """A sentence without the names and numbers in it: those of one kind are equal."""
    plain = re.sub(r'"[^"]*"|\'[^\']*\'', '"..."', sentence)
    plain = re.sub(r'(?:"...", )+', "", plain)
    plain = re.sub(r"dry friction of \S+", "dry friction of ...", plain)
    return re.sub(r"\d[\d.e+-]*", "#", plain)
