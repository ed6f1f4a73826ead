"""Targets of hostile arguments: kinematics of any mechanism, on an arm and a closed loop."""

from typing import Any

import mujoco
import numpy as np

from sim import (
    MODELS,
    Body,
    CenterOfMass,
    JacobianReader,
    Machine,
    Mechanism,
    Pin,
    Pose,
    Relative,
    advance,
    assemble,
    jacobians,
    load_model,
    pose_error,
    pose_of,
    ranges,
)
from tests.hostile import Target

ARM = load_model(MODELS / "arm.xml")
AT_REST = mujoco.MjData(ARM)
PLATFORM = load_model(MODELS / "platform.xml")
ON_PLATFORM = mujoco.MjData(PLATFORM)
HERE: dict[str, Any] = {"model": ARM, "data": AT_REST}
READER = {"site": "payload", "axes": "base", "pinned": [], "stuck_at_limits": False}
READER |= {"closure_tolerance": 1e-3}
CLOSED: dict[str, Any] = {"model": PLATFORM, "data": ON_PLATFORM, "held": [0], "pinned": []}
CLOSED |= {"geometry_accuracy": 1e-9}
MACHINE: dict[str, Any] = {"model": ARM, "qpos": np.zeros(7), "pinned": (), "stuck": False}
MACHINE |= {"mocap": (np.zeros((0, 3)), np.zeros((0, 4)))}
MECHANISM = Mechanism(ARM, AT_REST)


def reached(**given: Any) -> Any:
    """Joint positions of a new state."""
    return assemble(**given).qpos


def advanced(**given: Any) -> Any:
    return advance(**given).qpos


def read(**given: Any) -> Any:
    return numbers(JacobianReader(**given).at(AT_REST))


def numbers(jac: Any) -> Any:
    return jac.J_T, jac.J_C, jac.closure_residual


def known(**given: Any) -> Any:
    mechanism = Mechanism(**given)
    return mechanism.task(mechanism.nominal), mechanism.displacements(mechanism.nominal)


def moved(**given: Any) -> Any:
    posture = MECHANISM.moved(**given)
    return posture.qpos, posture.displacements, posture.pose, posture.gaps


def seen(**given: Any) -> Any:
    machine = Machine(**given)
    return machine.stiffness, machine.names, machine.one_sided


POSTURE = {"posture": MECHANISM.nominal}

TARGETS = {
    "advance": Target(advanced, CLOSED | {"velocity": np.zeros(PLATFORM.nv), "duration_s": 1.0}),
    "assemble": Target(reached, CLOSED),
    "Pin": Target(
        lambda **a: reached(model=ARM, pinned=[Pin(**a)]), {"frame": "base", "weld": True}
    ),
    "Body": Target(lambda **a: pose_of(ARM, AT_REST, Body(**a)), {"name": 3}),
    "CenterOfMass": Target(lambda **a: pose_of(ARM, AT_REST, CenterOfMass(**a)), {"body": None}),
    "Relative": Target(
        lambda **a: pose_of(ARM, AT_REST, Relative(**a)), {"frame": "payload", "root": "base"}
    ),
    "Machine": Target(
        seen,
        MACHINE,
    ),
    "Mechanism": Target(
        known,
        HERE | {"site": "payload", "axes": "base", "pinned": [], "springs": True},
    ),
    "Mechanism.jacobians": Target(lambda **a: numbers(MECHANISM.jacobians(**a)), POSTURE),
    "Mechanism.displacements": Target(MECHANISM.displacements, POSTURE),
    "Mechanism.task": Target(MECHANISM.task, POSTURE),
    "Mechanism.moved": Target(
        moved, POSTURE | {"displacements": np.full(7, 1e-3), "held": np.arange(7)}
    ),
    "JacobianReader": Target(read, {"model": ARM} | READER),
    "JacobianReader.at": Target(
        lambda **a: numbers(JacobianReader(ARM, "payload").at(**a)), {"data": AT_REST}
    ),
    "jacobians": Target(lambda **a: numbers(jacobians(**a)), HERE | READER),
    "pose_of": Target(pose_of, HERE | {"site": "payload", "axes": "base"}),
    "pose_error": Target(
        pose_error,
        HERE | {"site": ["payload"], "axes": "base", "target": [Pose(np.eye(3), np.ones(3))]},
    ),
    "pose_error of a position": Target(
        pose_error, HERE | {"site": "payload", "target": np.ones(3)}
    ),
    "ranges": Target(lambda model: {"force_gap": ranges(model).force}, {"model": ARM}),
}
