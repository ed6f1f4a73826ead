"""Frames of a model: sites and bodies, their motion and their pose."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from difflib import get_close_matches
from typing import NamedTuple

import mujoco
import numpy as np

import argument_checks as check
from argument_checks.ties import ACCURACY
from sim.array import Array
from sim.errors import ModelError
from sim.mjcf.model import element_id, listed, names_of_kind

_HALF_TURN = np.pi * (1 - ACCURACY)


@dataclass(frozen=True)
class Body:
    """The frame of a body, by its name or number, where the model has no site there."""

    name: str | int

    def __post_init__(self) -> None:
        if not isinstance(self.name, str):
            check.integer("name", self.name)


class Located(NamedTuple):
    """A frame by the number of its site or body, and the body that it belongs to."""

    id: int
    body: int
    is_site: bool

    def rotation(self, data: mujoco.MjData) -> Array:
        """Its axes in the world as columns, (3, 3): a view."""
        return (data.site_xmat if self.is_site else data.xmat)[self.id].reshape(3, 3)

    def position_m(self, data: mujoco.MjData) -> Array:
        """Its origin in the world, (3,): a view."""
        return (data.site_xpos if self.is_site else data.xpos)[self.id]

    def jacobian(self, model: mujoco.MjModel, data: mujoco.MjData) -> Array:
        """Twist [angular; linear] of its origin in world axes per qvel, shape (6, nv)."""
        self.write_jacobian(model, data, rows := np.empty((6, model.nv)))
        return rows

    def write_jacobian(self, model: mujoco.MjModel, data: mujoco.MjData, out: Array) -> None:
        """Overwrite an array (6, nv) by it, or one (3, nv) by its linear rows."""
        of_frame = mujoco.mj_jacSite if self.is_site else mujoco.mj_jacBody
        of_frame(model, data, out[-3:], out[:3] if len(out) > 3 else None, self.id)


def own_length(model: mujoco.MjModel, frames: Iterable[Located]) -> float:
    """Length [m] of a mechanism: its longest chain from a joint to a frame, else the model's."""
    return max((_reach(model, frame) for frame in frames), default=0.0) or model.stat.extent


def _reach(model: mujoco.MjModel, frame: Located) -> float:
    total = math.hypot(*model.site_pos[frame.id].tolist()) if frame.is_site else 0.0
    body = frame.body if model.body_weldid[frame.body] else 0
    while body:
        first, parent = model.body_jntadr[body], model.body_parentid[body]
        for joint in range(first, first + model.body_jntnum[body]):
            total += math.hypot(*model.jnt_pos[joint].tolist())
        if not model.body_weldid[parent]:  # what stands on the ground may stand anywhere
            break
        total += math.hypot(*model.body_pos[body].tolist())
        body = parent
    return total


def located(model: mujoco.MjModel, argument: str, frame: str | Body) -> Located:
    """The frame that an argument names: a site if there is one of this name, else a body.

    Raises:
        ModelError: There is no such site or body.
    """
    if not isinstance(frame, Body):
        check.instance("model", model, mujoco.MjModel)
        check.instance(argument, frame, str)
        if _is(model, "site", frame) or not _is(model, "body", frame):
            site = element_id(model, "site", frame)
            return Located(site, int(model.site_bodyid[site]), is_site=True)
        frame = Body(frame)
    body = element_id(model, "body", frame.name) if isinstance(frame.name, str) else frame.name
    if body >= model.nbody:
        raise ModelError(f"the model has bodies 0 to {model.nbody - 1}, got {body}")
    return Located(body, body, is_site=False)


def frame_named(model: mujoco.MjModel, argument: str, frame: str | Body) -> str | Body:
    """A frame by a name that may be a site's, else a body's, else the number of a body.

    Raises:
        ModelError: There is none; the message has the argument and the nearest names.
    """
    if isinstance(frame, Body) or _is(model, "site", check.instance(argument, frame, str)):
        return frame
    if _is(model, "body", frame):
        return Body(frame)
    if frame.isdecimal() and len(frame) < 10:
        return Body(int(frame))
    names = [*names_of_kind(model, "site"), *names_of_kind(model, "body")]
    near = " or ".join(f'"{each}"' for each in get_close_matches(frame, names))
    hint = f"did you mean {near}?" if near else f"it has {listed(names)}"
    raise ModelError(f'{argument}: the model has no site or body "{frame:.80}"; {hint}')


def _is(model: mujoco.MjModel, kind: str, name: str) -> bool:
    """Whether a name is that of an element of a kind."""
    return name in names_of_kind(model, kind)  # MuJoCo's own look-up cuts a name at a null byte


def rotation_vector(rotation: Array) -> Array:
    """The vector (3,) of a rotation (3, 3), its angle within 0..pi."""
    quat_wxyz, vector = np.empty(4), np.empty(3)
    mujoco.mju_mat2Quat(quat_wxyz, rotation.ravel())
    mujoco.mju_quat2Vel(vector, quat_wxyz, 1.0)
    return one_half_turn(vector)


def one_half_turn(vector: Array) -> Array:
    """Choose between the two rotation vectors (..., 3) of a half turn; others stay as they are.

    It is the one with a positive first component: else the last bits of a rotation would decide.
    """
    if vector.ndim == 1 and vector.dot(vector) < 9.8:  # less than pi^2: at every tick
        return vector
    angle = np.linalg.norm(vector, axis=-1, keepdims=True)
    if angle.max(initial=0.0) < _HALF_TURN:
        return vector
    clear = np.abs(vector) > np.pi * ACCURACY
    index = np.argmax(clear, axis=-1)[..., None]  # noqa: TID251 - truth values
    first = np.take_along_axis(vector, index, axis=-1)
    return np.where((angle >= _HALF_TURN) & (first < 0.0), -vector, vector)
