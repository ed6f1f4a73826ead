"""Targets of hostile arguments: kinematics of any mechanism, on an arm and a closed loop."""

from typing import Any

import mujoco
import numpy as np

from sim import (
    MODELS,
    Body,
    CenterOfMass,
    Distances,
    JacobianReader,
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
READER |= {"closure_tolerance": 1e-3, "active": []}
CLOSED: dict[str, Any] = {"model": PLATFORM, "data": ON_PLATFORM, "held": [0], "pinned": []}
CLOSED |= {"geometry_accuracy": 1e-9}
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


def kept_apart(**given: Any) -> Any:
    distances = Distances(**given)
    return distances.at(SWUNG)


SWING = mujoco.MjModel.from_xml_string(
    """<mujoco><worldbody><geom name="floor" type="plane" size="1 1 1"/>
      <body name="swing" pos="0 0 0.2">
        <joint axis="1 0 0"/><geom type="box" size="0.1 0.1 0.19"/>
      </body></worldbody></mujoco>"""
)
SWUNG = mujoco.MjData(SWING)
APART: dict[str, Any] = {"model": SWING, "pairs": [(["floor"], [1, Body("swing")])]}
APART |= {"margin_m": 0.005, "detection_m": 1.0, "gain": 0.5}
DISTANCES = Distances(**APART)
POSTURE = {"posture": MECHANISM.nominal}

TARGETS = {
    "advance": Target(
        advanced,
        CLOSED
        | {"velocity": np.zeros(PLATFORM.nv), "duration_s": 1.0}
        | {"warn_of_misses": True, "into": mujoco.MjData(PLATFORM)},
    ),
    "assemble": Target(reached, CLOSED),
    "Pin": Target(
        lambda **a: reached(model=ARM, pinned=[Pin(**a)]), {"frame": "base", "weld": True}
    ),
    "Body": Target(lambda **a: pose_of(ARM, AT_REST, Body(**a)), {"name": 3}),
    "CenterOfMass": Target(lambda **a: pose_of(ARM, AT_REST, CenterOfMass(**a)), {"body": None}),
    "Distances": Target(kept_apart, APART),
    "Distances.at": Target(lambda **a: DISTANCES.at(**a), {"data": SWUNG, "within_m": 0.1}),
    "Distances.safe_fraction": Target(
        lambda **a: DISTANCES.safe_fraction(**a),
        {"data": SWUNG, "qvel": np.ones(SWING.nv), "dt": 0.01},
    ),
    "Relative": Target(
        lambda **a: pose_of(ARM, AT_REST, Relative(**a)), {"frame": "payload", "root": "base"}
    ),
    "Mechanism": Target(
        known,
        HERE | {"site": "payload", "axes": "base", "springs": True},
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
    "JacobianReader.fields_at": Target(
        lambda **a: JacobianReader(ARM, "payload").fields_at(**a)["J_T"], {"data": AT_REST}
    ),
    "JacobianReader.read": Target(
        lambda **a: numbers(JacobianReader(ARM, "payload").read(**a)), {"data": AT_REST}
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
    "pose_error of a matrix": Target(pose_error, HERE | {"site": "payload", "target": np.eye(4)}),
    "pose_error of a quaternion": Target(
        lambda quaternion, **a: pose_error(**a, target=(np.ones(3), quaternion)),
        HERE | {"site": "payload", "quaternion": np.array([0.6, 0.0, 0.8, 0.0])},
    ),
    "ranges": Target(lambda model: {"force_gap": ranges(model).force}, {"model": ARM}),
}
