"""Results in docs/data, by study, table and row; and values in sentences of the pages."""

import json
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any

import pandas as pd

from experiments.recover.tables import share

DOCS = Path(__file__).parents[1]
ANGLES = ("alpha", "beta")
GAINED, HARMED = 0.97, 1.1
"""Median and largest ratio of errors beyond which docs/recover.md shows an event."""


@cache
def study(name: str) -> dict[str, Any]:
    """Return a result at full length: of a study, or of a further one, as "events" of `recover`."""
    [file] = [*(DOCS / "data").glob(f"{name}.json"), *(DOCS / "data").glob(f"{name}/*.json")]
    return json.loads(file.read_text(encoding="utf-8"))


def rows(name: str, table: str, /, **where: Any) -> list[dict[str, Any]]:
    """Return the rows of a study's table with these values."""
    return [row for row in study(name)[table] if where.items() <= row.items()]


def row(name: str, table: str, /, **where: Any) -> dict[str, Any]:
    """Return the only row of a study's table with these values."""
    [one] = rows(name, table, **where)
    return one


def count(group: dict[str, Any], key: str) -> str:
    """Return a share as "306 of 306"."""
    return f"{group[f'{key}_count']} of {group[f'{key}_cases']}"


def interval(group: dict[str, Any], key: str) -> str:
    """Return the 95 % interval of a share, as "98.8 to 100 %"."""
    low, high = (100 * group[f"{key}_{side}"] for side in ("low", "high"))
    return f"{low:.3g} to {high:.3g} %"


def pooled(groups: Iterable[dict[str, Any]], key: str) -> dict[str, Any]:
    """Return the share of some groups together, with its 95 % interval."""
    groups = list(groups)
    ones, cases = (sum(group[f"{key}_{part}"] for group in groups) for part in ("count", "cases"))
    return share(key, pd.Series([True] * ones + [False] * (cases - ones)))


def duration(*names: str) -> str:
    """Return the measured time of these results together, as "60 s" or from 100 s on as "6 min"."""
    seconds = round(sum(study("origin")[name]["wall_time_s"] for name in names))
    return f"{seconds} s" if seconds < 100 else f"{seconds / 60:.0f} min"


def is_shown(event: str) -> bool:
    """Return whether diagnosis reduces errors in this event, or increases those of the hand."""
    of_hand = row("hand_events", "by_event", event=event)["counted_worst"]
    of_hexapod = row("events", "by_event", event=event)["over_unaware_since_median"]
    return of_hexapod < GAINED or of_hand > HARMED
