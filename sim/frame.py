"""Frames of a model: sites and bodies, their motion and their pose."""

from dataclasses import dataclass

import mujoco
import numpy as np

import argument_checks as check
from sim.array import Array
from sim.model import element_id


@dataclass(frozen=True)
class Body:
    """The frame of a body, where the model has no site there.

    Attributes:
        name: Of the body.
    """

    name: str


def check_frame(model: mujoco.MjModel, argument: str, frame: str | Body) -> None:
    """Refuse what is no frame of the model; `argument` is where it was given."""
    if isinstance(frame, Body):
        element_id(model, "body", check.instance(argument, frame.name, str))
    else:
        element_id(model, "site", check.instance(argument, frame, str))


def frame_jacobian(model: mujoco.MjModel, data: mujoco.MjData, frame: str | Body) -> Array:
    """Twist [angular; linear] of a frame's origin in world axes per qvel, shape (6, nv)."""
    rows = np.zeros((6, model.nv))
    if isinstance(frame, Body):
        mujoco.mj_jacBody(model, data, rows[3:], rows[:3], model.body(frame.name).id)
    else:
        mujoco.mj_jacSite(model, data, rows[3:], rows[:3], model.site(frame).id)
    return rows


def frame_pose(data: mujoco.MjData, frame: str | Body) -> tuple[Array, Array]:
    """Rotation (3, 3) and position (3,) of a frame in the world."""
    seen = data.body(frame.name) if isinstance(frame, Body) else data.site(frame)
    return seen.xmat.reshape(3, 3).copy(), seen.xpos.copy()


def rotation_vector(rotation: Array) -> Array:
    """The vector (3,) of a rotation (3, 3), its angle within 0..pi."""
    quat_wxyz, vector = np.empty(4), np.empty(3)
    mujoco.mju_mat2Quat(quat_wxyz, np.ascontiguousarray(rotation).reshape(9))
    mujoco.mju_quat2Vel(vector, quat_wxyz, 1.0)
    return vector
