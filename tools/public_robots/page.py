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
        rows = [_cells(each) for each in records if each["package"] == package]
        if rows:
            table = [_COLUMNS, ["---"] * len(_COLUMNS), *rows]
            lines = [f"| {' | '.join(cells)} |" for cells in table]
            parts += [f"### {package} {version}", "\n".join(lines)]
    counted = Counter(_kind(said(each)) for each in records if outcome(each) not in _ENDED)
    refusals = [f"{count} at {_short(sentence)}" for sentence, count in counted.most_common()]
    parts += ["## What refused them", _listed(refusals) or "Nothing."]
    return "\n\n".join(parts) + "\n"


_ENDED = ("flies", "timeout_s")


def _listed(lines: Sequence[str]) -> str:
    return "\n".join(f"* {line}" for line in lines)


def outcome(record: Record) -> str:
    """One of flies, refused, traceback and timeout_s."""
    if record.get("stage", "load") is None:
        return "flies"
    return next(key for key in ("traceback", "refused", "timeout_s") if key in record)


def ratio(record: Record, flight: str) -> float | None:
    """Measured over predicted RMS, all rows together; None where nothing is predicted of it."""
    numbers = record[flight]
    if numbers["predicted"] is None or numbers["uncompared"] is not None:
        return None
    measured, predicted = (hypot(*numbers[key]) for key in ("measured", "predicted"))
    return measured / predicted if predicted else None


def silently_wrong(record: Record, *flights: str) -> bool:
    """Whether a prediction is off by more than 20 %, and no warning says what it leaves out."""
    found = [ratio(record, flight) for flight in flights if flight in record]
    off = any(each is not None and not _is_close(each) for each in found)
    return off and not record["rig"]["warnings"]


def _is_close(value: float) -> bool:
    return abs(value - 1.0) <= AGREES


def _counts(records: Sequence[Record]) -> list[str]:
    """Headlines, each with what it is of."""
    kinds = Counter(map(outcome, records))
    flown = {of: [each for each in records if of in each] for of in ("sound", "lock")}
    found = {of: [ratio(each, of) for each in some] for of, some in flown.items()}
    ratios = {of: [each for each in some if each is not None] for of, some in found.items()}
    close = {of: f"{sum(map(_is_close, some))} of {len(some)}" for of, some in ratios.items()}
    without = [str(len(found[of]) - len(ratios[of])) for of in found]
    silent = sum(silently_wrong(each, "sound", "lock") for each in flown["sound"])
    named = sum(each["lock"]["named_after_ms"] is not None for each in flown["lock"])
    wrong = sum(bool(each["sound"]["wrong"]) for each in flown["sound"])
    return [
        f"models tried: {len(records)}; both flights: {kinds['flies']}; refused: "
        f"{kinds['refused']}; tracebacks: {kinds['traceback']}; "
        f"not done after the time limit: {kinds['timeout_s']}",
        f"Jacobians: {_worst(records, 'jacobians')}; power: {_worst(records, 'power')}",
        f"RMS as predicted within 20 % without a failure: {close['sound']}; after the lock: "
        f"{close['lock']}; off without a warning in either: {silent}; "
        f"without a prediction: {' and '.join(without)}",
        f"lock named: {named} of {len(flown['lock'])}; flights without a failure in which "
        f"something was named: {wrong} of {len(flown['sound'])}",
    ]


def _worst(records: Sequence[Record], stage: str) -> str:
    errors = [each[stage]["error"] for each in records if stage in each]
    return f"{len(errors)} models, largest relative error {max(errors, default=0.0):.1e}"


def _cells(record: Record) -> list[str]:
    """Empty where a robot did not come that far."""
    cells = {"robot": f"`{record['name']}`", "refused, or warned": _short(said(record))}
    if "load" in record:
        cells["actuators"] = str(record["load"]["actuators"])
    if "rig" in record:
        cells["rows"] = ", ".join(ROWS[k] for k in record["rig"]["rows"])
    if "sound" in record:
        cells["rms"] = f"{100 * record['sound']['of_path']:.3g} %"
        cells["measured / predicted"] = _compared(record, "sound")
        wrong = [record[flight]["wrong"] for flight in ("sound", "lock") if flight in record]
        cells["wrong"] = str(sum(map(len, wrong)))
    if "lock" in record:
        delay_ms = record["lock"]["named_after_ms"]
        cells["named"] = "never" if delay_ms is None else f"{delay_ms} ms"
        cells["after the lock"] = _compared(record, "lock")
    return [cells.get(column, "") for column in _COLUMNS]


def _compared(record: Record, flight: str) -> str:
    value = ratio(record, flight)
    if value is None:
        return "not comparable"
    bold = "**" * silently_wrong(record, flight)
    return f"{bold}{value:.2f}{bold}"


def said(record: Record) -> str:
    """What a robot is refused for, or warned of."""
    kind = outcome(record)
    if kind == "flies":
        leaves = {record[flight]["leaves"] for flight in ("sound", "lock")} - {None}
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
