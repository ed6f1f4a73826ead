"""Events by name: what can happen to a machine during a run besides a sudden failure.

    rig.fly(controller, path, events=[Event("hard_over", 1.3, "strut1"), Event("bump", 0.5)])

`effects` declares each event on the function of its effect, and `hooks` makes of the events of a
run what :class:`sim.Bench` calls.
"""

from fjh.rig.events.effects import EVENTS as EVENTS
from fjh.rig.events.effects import Event as Event
from fjh.rig.events.effects import Kind as Kind
