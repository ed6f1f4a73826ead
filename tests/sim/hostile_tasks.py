"""Targets of hostile arguments: task functions, on an arm."""

from typing import Any

import mujoco
import numpy as np

from sim import (
    MODELS,
    CenterOfMassTask,
    DampingTask,
    FrameTask,
    JointCouplingTask,
    LookAtTask,
    Pose,
    PostureTask,
    RelativeFrameTask,
    TaskFunction,
    load_model,
)
from sim.tasks import LocatedRates
from tests.hostile import Target

ARM = load_model(MODELS / "arm.xml")
AT_REST = mujoco.MjData(ARM)
mujoco.mj_forward(ARM, AT_REST)
SHARED: dict[str, Any] = {"gain": 0.5, "weight": 2.0, "damping": 0.1}
POSE = Pose(np.eye(3), np.array([0.1, 0.2, 0.3]))


def done(task: TaskFunction) -> Any:
    """What a task gives in a model."""
    located = task.on(ARM)
    return task.gain, task.damping, located.error(ARM, AT_REST), located.jacobian(ARM, AT_REST)


def placed(**target: Any) -> Any:
    return FrameTask("payload").checked(**target)


MADE: dict[str, tuple[type[TaskFunction], dict[str, Any]]] = {
    "FrameTask": (FrameTask, {"frame": "payload", "axes": "base", "rows": [3, 1], "target": POSE}),
    "FrameTask at a position": (FrameTask, {"frame": "payload", "target": np.ones(3)}),
    "RelativeFrameTask": (
        RelativeFrameTask,
        {"frame": "payload", "root": "base", "rows": [3, 1], "target": POSE},
    ),
    "CenterOfMassTask": (CenterOfMassTask, {"body": "link4", "rows": [1], "target": np.ones(3)}),
    "LookAtTask": (LookAtTask, {"frame": "payload", "axis": np.ones(3), "target": 2 * np.ones(3)}),
    "PostureTask": (PostureTask, {"joints": ["joint2"], "target": np.ones(ARM.nq)}),
    "DampingTask": (DampingTask, {"joints": ["joint2"], "target": None}),
    "JointCouplingTask": (
        JointCouplingTask,
        {"coefficients": {"joint1": 1.0, "joint2": -2.0}, "target": 0.5},
    ),
}


def _made(name: str) -> Target:
    kind, own = MADE[name]
    return Target(lambda **a: done(kind(**a)), SHARED | own)


TARGETS = {name: _made(name) for name in MADE}
TARGETS |= {
    f"{kind.__name__}.on": Target(
        lambda model, kind=kind, own=own: done_in(kind(**own), model), {"model": ARM}
    )
    for kind, own in MADE.values()
}


def done_in(task: TaskFunction, model: Any) -> Any:
    located = task.on(model)
    return located.velocities if isinstance(located, LocatedRates) else located.angular


TARGETS |= {
    "DampingTask.checked": Target(lambda target: DampingTask(target=target).gain, {"target": None}),
    "CenterOfMassTask.checked": Target(CenterOfMassTask().checked, {"target": np.ones(3)}),
    "LookAtTask.checked": Target(LookAtTask("payload", [1, 0, 0]).checked, {"target": np.ones(3)}),
    "PostureTask.checked": Target(PostureTask().checked, {"target": np.ones(ARM.nq)}),
    "JointCouplingTask.checked": Target(
        JointCouplingTask({"joint1": 1.0}).checked, {"target": 0.5}
    ),
}
