"""Fault-tolerant control of redundant mechanisms in MuJoCo: the names that scripts need most.

import fjh

rig = fjh.Rig.of_mjcf("arm.xml", site="tool", major=[3, 4, 5])
run = rig.fly(rig.supervisor(), rig.path("circle", duration_s=4.0),
              failures=[fjh.Failure("joint4", "locked", 2.0)])
print(run.status)

All other names are in the subpackages `fjh.prioritized` (mappings), `fjh.ftc` (control, diagnosis),
`fjh.sim` (MuJoCo) and `fjh.experiments` (the paper).
"""

import ast
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import experiments as experiments
    import ftc as ftc
    import prioritized as prioritized
    import sim as sim
    from argument_checks import __version__ as __version__
    from fjh.comparison import compare as compare
    from fjh.ik import Ik as Ik
    from fjh.ik import Limits as Limits
    from fjh.recording.record import record as record
    from fjh.result_frames import results as results
    from fjh.rig import Mismatch as Mismatch
    from fjh.rig import Prediction as Prediction
    from fjh.rig import Rig as Rig
    from fjh.rig import Run as Run
    from fjh.rig.events import Event as Event
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

if not (Path(__file__).parent / "prioritized").is_dir():  # a checkout
    from fjh._checkout import alias_folders

    alias_folders(Path(__file__).parents[1])

_PLACES = {
    name.asname: (node.module, name.name) if isinstance(node, ast.ImportFrom) else (name.name, "")
    for node in ast.walk(ast.parse(Path(__file__).read_text(encoding="utf-8")))
    if isinstance(node, ast.Import | ast.ImportFrom)
    for name in node.names
    if name.asname
}
"""Module and attribute of each name, imported on first use: mappings do not need MuJoCo."""

__all__ = [name for name in _PLACES if not name.startswith("_")]  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module_name, attribute = _PLACES[name]
    module = import_module(str(module_name))
    return getattr(module, attribute) if attribute else module


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
