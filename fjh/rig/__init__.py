"""Robots with control loops, ready to simulate: the testbed's hexapod, or any MJCF robot.

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
    from fjh.rig.run import DiagnosedFailure as DiagnosedFailure
    from fjh.rig.run import Run as Run

_OF = {
    "Mismatch": "fjh.rig.mismatch",
    "DiagnosedFailure": "fjh.rig.run",
    "Prediction": "fjh.rig.prediction",
    "Rig": "fjh.rig.rig",
    "Run": "fjh.rig.run",
}
"""Module of each name, imported on first use: the command line's help does not need MuJoCo."""


def __getattr__(name: str) -> Any:
    if name not in _OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_OF[name]), name)
