"""A robot with its loops, ready to fly: the testbed's hexapod, or any robot of an MJCF file.

from fjh.rig import Rig
from sim import Failure

rig = Rig.of_mjcf("arm.xml", site="tool", major=[3, 4, 5])
run = rig.fly(rig.supervisor(), rig.path("circle", duration_s=4.0),
              failures=[Failure("joint4", "locked", 2.0)])
print(run.status)
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fjh.rig.mismatch import Mismatch as Mismatch
    from fjh.rig.prediction import Prediction as Prediction
    from fjh.rig.rig import Rig as Rig
    from fjh.rig.run import Diagnosed as Diagnosed
    from fjh.rig.run import Run as Run

_OF = {
    "Mismatch": "fjh.rig.mismatch",
    "Diagnosed": "fjh.rig.run",
    "Prediction": "fjh.rig.prediction",
    "Rig": "fjh.rig.rig",
    "Run": "fjh.rig.run",
}
"""Read when asked for: the command line has its choices from here, and its help is not to wait."""


def __getattr__(name: str) -> Any:
    if name not in _OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_OF[name]), name)
