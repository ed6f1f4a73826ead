"""What happened in a tracked run, in words."""

from collections.abc import Mapping
from typing import Any

from experiments.rig.events import EVENTS
from experiments.study.tables import Column, Table, tabulate

_COLUMNS = (
    Column("event", "name"),
    Column("actuator", "actuator"),
    Column("at, s", "time_s", ".3f"),
    Column("what happens", "sentence"),
)


def happened(summary: Mapping[str, Any], named: Mapping[str, str] | None = None) -> str:
    """Failures and events in the order of time, none is empty; `named` says more of an actuator.

    An event that is a failure and nothing else is said once.
    """
    said = [
        (one["time_s"], one["actuator"], f"{one['actuator']} {one['kind']}")
        for one in summary["failures"]
    ]
    for one in summary["events"]:
        if EVENTS[one["name"]].failures != (one["name"],):
            of = f" of {one['actuator']}" if one["actuator"] is not None else ""
            said.append((one["time_s"], one["actuator"], f"{one['name']}{of}"))
    more = named or {}
    return ", ".join(
        f"{what} at {time_s:g} s" + (f" ({more[who]})" if who in more else "")
        for time_s, who, what in sorted(said, key=lambda each: each[0])
    )


def event_tables(summary: Mapping[str, Any]) -> list[Table]:
    """Events and what they are; none where there was none."""
    entries = [one | {"sentence": EVENTS[one["name"]].sentence} for one in summary["events"]]
    return [tabulate("Events", _COLUMNS, entries)] if entries else []
