"""Named events of a machine during a run, in addition to sudden failures.

rig.fly(controller, path, events=[Event("hard_over", 1.3, "strut1"), Event("bump", 0.5)])
"""

from fjh.rig.events.effects import EVENTS as EVENTS
from fjh.rig.events.effects import Event as Event
from fjh.rig.events.effects import Kind as Kind
