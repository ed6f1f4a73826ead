"""The generated part of docs/robots.md, from the results of all trials."""

import re
from collections import Counter
from collections.abc import Callable, Sequence
from math import hypot
from typing import Any

from fjh.rig.units import ROWS
from tools.public_robots.registry import PACKAGES

AGREES = 0.2
"""Relative error up to which an RMS is as predicted."""
GENERATED = "<!-- From here on written by `make robots`. -->"
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
    parts = [text, GENERATED, "## Results", conditions, _counts(records)]
    for package, version in PACKAGES.items():
        rows = [_row(each) for each in records if each["package"] == package]
        if rows:
            header = [_line(_COLUMNS), _line(["---"] * len(_COLUMNS))]
            parts += [f"### {package} {version}", "\n".join([*header, *rows])]
    parts += ["## What refused them", _refusals(records)]
    return "\n\n".join(parts) + "\n"


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


_COLUMNS = (
    *("robot", "actuators", "rows", "rms", "measured / predicted", "after the lock"),
    *("named", "wrong", "refused, or warned"),
)


def outcome(record: Record) -> str:
    """One of flies, refused, traceback and timeout."""
    if record.get("stage", "load") is None:
        return "flies"
    return next(key for key in ("traceback", "refused", "timeout_s") if key in record)


def ratio(flight: Record | None) -> float | None:
    """Measured over predicted RMS, all rows together; None where nothing is predicted of it."""
    if flight is None or flight["predicted"] is None or flight["uncompared"] is not None:
        return None
    measured, predicted = (hypot(*flight[key]) for key in ("measured", "predicted"))
    return measured / predicted if predicted else None


def silently_wrong(record: Record) -> bool:
    """Whether a prediction is off by more than 20 %, and no warning says what it leaves out."""
    found = [ratio(record.get(flight)) for flight in ("sound", "lock")]
    off = any(each is not None and not _is_close(each) for each in found)
    return off and not record["rig"]["warnings"]


def _is_close(value: float) -> bool:
    return abs(value - 1.0) <= AGREES


def _counts(records: Sequence[Record]) -> str:
    """Headlines, each with what it is of."""
    kinds = Counter(map(outcome, records))
    flights = [each for each in records if "sound" in each]
    close = [r for each in flights if (r := ratio(each["sound"])) is not None]
    locks = [each for each in records if "lock" in each]
    after = [r for each in locks if (r := ratio(each["lock"])) is not None]
    named = [each for each in locks if each["lock"]["named_after_ms"] is not None]
    lines = [
        f"models tried: {len(records)}; both flights: {kinds['flies']}; refused: "
        f"{kinds['refused']}; tracebacks: {kinds['traceback']}; "
        f"not done after the time limit: {kinds['timeout_s']}",
        f"Jacobians: {_worst(records, 'jacobians')}; power: {_worst(records, 'power')}",
        f"RMS as predicted within 20 % without a failure: {_of(close)}; after the lock: "
        f"{_of(after)}; off without a warning in either: {sum(map(silently_wrong, flights))}; "
        f"without a prediction: {len(flights) - len(close)} and {len(locks) - len(after)}",
        f"lock named: {len(named)} of {len(locks)}; flights without a failure in which something "
        f"was named: {sum(bool(each['sound']['wrong']) for each in flights)} of {len(flights)}",
    ]
    return "\n".join(f"* {line}" for line in lines)


def _of(ratios: Sequence[float]) -> str:
    return f"{sum(map(_is_close, ratios))} of {len(ratios)}"


def _worst(records: Sequence[Record], stage: str) -> str:
    errors = [each[stage]["error"] for each in records if stage in each]
    return f"{len(errors)} models, largest relative error {max(errors, default=0.0):.1e}"


def _row(record: Record) -> str:
    sound, lock = record.get("sound"), record.get("lock")
    cells = [
        f"`{record['name']}`",
        _cell(record.get("load"), lambda load: str(load["actuators"])),
        _cell(record.get("rig"), lambda rig: ", ".join(ROWS[k] for k in rig["rows"])),
        _cell(sound, lambda flight: f"{100 * flight['of_path']:.3g} %"),
        _compared(sound, record),
        _compared(lock, record),
        _cell(lock, _when_named),
        _cell(sound, lambda flight: str(len(flight["wrong"]) + len(lock["wrong"] if lock else ()))),
        _said(record),
    ]
    return _line(cells)


def _cell(part: Record | None, say: Callable[[Record], str]) -> str:
    return "" if part is None else say(part)


def _compared(flight: Record | None, record: Record) -> str:
    value = ratio(flight)
    if flight is None or value is None:
        return "" if flight is None else "not comparable"
    bold = "**" if not _is_close(value) and not record["rig"]["warnings"] else ""
    return f"{bold}{value:.2f}{bold}"


def _when_named(lock: Record) -> str:
    return "never" if lock["named_after_ms"] is None else f"{lock['named_after_ms']} ms"


def _said(record: Record) -> str:
    kind = outcome(record)
    if kind == "flies":
        leaves = {record[flight]["leaves"] for flight in ("sound", "lock")} - {None}
        beyond = [f"{name} leaves its range in the linear model" for name in sorted(leaves)]
        return _short("; ".join(dict.fromkeys([*beyond, *map(_kind, record["rig"]["warnings"])])))
    if kind == "timeout_s":
        return f"{record['stage']}: not done after {record[kind]:g} s"
    return _short(f"{record['stage']}: {'traceback, ' * (kind == 'traceback')}{record[kind]}")


def _short(sentence: str) -> str:
    plain = re.sub(r"[|`<>*_$\\\[\]]", lambda found: f"\\{found[0]}", sentence)
    return plain if len(plain) <= _WIDEST else f"{plain[:_WIDEST].rstrip(chr(92))} ..."


def _kind(sentence: str) -> str:
    """A sentence without the names and numbers in it: those of one kind are equal."""
    plain = re.sub(r'"[^"]*"|\'[^\']*\'', '"..."', sentence)
    plain = re.sub(r'(?:"...", )+', "", plain)
    plain = re.sub(r"dry friction of \S+", "dry friction of ...", plain)
    return re.sub(r"\d[\d.e+-]*", "#", plain)


def _refusals(records: Sequence[Record]) -> str:
    """Sentences with their counts, the most frequent first."""
    counted = Counter(
        f"{each['stage']}: {'traceback, ' * (kind == 'traceback')}{_kind(each[kind])}"
        for each in records
        if (kind := outcome(each)) in ("refused", "traceback")
    )
    lines = [f"* {count} at {_short(sentence)}" for sentence, count in counted.most_common()]
    return "\n".join(lines) or "Nothing."
