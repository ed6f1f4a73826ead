"""Fault-tolerant control of redundant mechanisms in MuJoCo: what a user needs, under one name.

import fjh

rig = fjh.Rig.of_mjcf("arm.xml", site="tool", major=[3, 4, 5])
run = rig.fly(rig.supervisor(), rig.path("circle", duration_s=4.0),
              failures=[fjh.Failure("joint4", "locked", 2.0)])
print(run.status)

Whatever is not among these names is behind them, in `fjh.prioritized` (mappings), `fjh.ftc`
(control, diagnosis), `fjh.sim` (MuJoCo) and `fjh.experiments` (rigs, recordings, studies).
"""

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import experiments as experiments
    import ftc as ftc
    import prioritized as prioritized
    import sim as sim
    from argument_checks import __version__ as __version__
    from experiments.comparison import compare as compare
    from experiments.ik import Ik as Ik
    from experiments.ik import Limits as Limits
    from experiments.recording.record import record as record
    from experiments.results import fly_again as fly_again
    from experiments.results import results as results
    from experiments.rig import Mismatch as Mismatch
    from experiments.rig import Prediction as Prediction
    from experiments.rig import Rig as Rig
    from experiments.rig import Run as Run
    from experiments.rig.events import Event as Event
    from ftc import PrioritizedController as PrioritizedController
    from ftc import Supervisor as Supervisor
    from prioritized import ConstrainedSystem as ConstrainedSystem
    from prioritized import Task as Task
    from prioritized import failure_atlas as failure_atlas
    from prioritized import force_mapping as force_mapping
    from prioritized import velocity_mapping as velocity_mapping
    from sim import MODELS as MODELS
    from sim import Body as Body
    from sim import CenterOfMassTask as CenterOfMassTask
    from sim import DampingTask as DampingTask
    from sim import Distances as Distances
    from sim import Failure as Failure
    from sim import FrameTask as FrameTask
    from sim import JointCouplingTask as JointCouplingTask
    from sim import LookAtTask as LookAtTask
    from sim import Plant as Plant
    from sim import Pose as Pose
    from sim import PostureTask as PostureTask
    from sim import RelativeFrameTask as RelativeFrameTask
    from sim import advance as advance
    from sim import assemble as assemble
    from sim import jacobians as jacobians
    from sim import load_model as load_model
    from sim import pose_of as pose_of

_NAMES = {
    "fjh.argument_checks": ("__version__",),
    "fjh.experiments.comparison": ("compare",),
    "fjh.experiments.ik": ("Ik", "Limits"),
    "fjh.experiments.recording.record": ("record",),
    "fjh.experiments.results": ("fly_again", "results"),
    "fjh.experiments.rig.events": ("Event",),
    "fjh.experiments.rig": ("Mismatch", "Prediction", "Rig", "Run"),
    "fjh.ftc": ("PrioritizedController", "Supervisor"),
    "fjh.prioritized": (
        *("ConstrainedSystem", "Task"),
        *("failure_atlas", "force_mapping", "velocity_mapping"),
    ),
    "fjh.sim": (
        *("MODELS", "Body", "Distances", "Failure", "Plant", "Pose"),
        *("CenterOfMassTask", "DampingTask", "FrameTask", "JointCouplingTask", "LookAtTask"),
        *("PostureTask", "RelativeFrameTask"),
        *("advance", "assemble", "jacobians", "load_model", "pose_of"),
    ),
}
_PACKAGES = ("experiments", "ftc", "prioritized", "sim")
_MODULES = {name: module for module, names in _NAMES.items() for name in names}
"""Read when asked for: `import fjh` waits for nothing, and without MuJoCo the mappings work."""

__all__ = [name for name in (*_PACKAGES, *_MODULES) if not name.startswith("_")]  # pyright: ignore[reportUnsupportedDunderAll]

if not (Path(__file__).parent / "prioritized").is_dir():  # a checkout
    from fjh._checkout import find_beside

    find_beside(Path(__file__).parents[1])


def __getattr__(name: str) -> Any:
    if name in _PACKAGES:
        return import_module(f"fjh.{name}")
    if name in _MODULES:
        return getattr(import_module(_MODULES[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
