"""Events by name: what else can happen to a machine in flight than a sudden failure.

    rig.fly(pilot, path, events=[Event("hard_over", 1.3, "strut1"), Event("bump", 0.5)])

`kinds` has their names and what they mean, `actuator`, `machine` and `sensor` what they do, and
`hooks` makes of those of a flight what :class:`sim.Bench` calls.
"""

from typing import Any

from experiments.rig.events.kinds import EVENTS as EVENTS
from experiments.rig.events.kinds import Event as Event
from experiments.rig.events.kinds import Kind as Kind


def __getattr__(name: str) -> Any:
    if name != "events_of":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from experiments.rig.events.hooks import events_of  # physics, which a command's check spares

    return events_of
