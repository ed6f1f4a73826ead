"""Frames of a model (sites and bodies): look-up, pose and Jacobian."""

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
    """Frame of a body, given by its name or number, where the model has no site."""

    name: str | int

    def __post_init__(self) -> None:
        if not isinstance(self.name, str):
            check.integer("name", self.name)


class Located(NamedTuple):
    """Frame given by the number of its site or body, with the body that it belongs to."""

    id: int
    body: int
    is_site: bool

    def rotation(self, data: mujoco.MjData) -> Array:
        """Return the frame's axes in the world as columns, (3, 3); a view of `data`."""
        return (data.site_xmat if self.is_site else data.xmat)[self.id].reshape(3, 3)

    def position_m(self, data: mujoco.MjData) -> Array:
        """Return the frame's origin in the world [m], (3,); a view of `data`."""
        return (data.site_xpos if self.is_site else data.xpos)[self.id]

    def jacobian(self, model: mujoco.MjModel, data: mujoco.MjData) -> Array:
        """Return the Jacobian (6, nv) of the frame's twist [angular; linear] in world axes."""
        self.write_jacobian(model, data, rows := np.empty((6, model.nv)))
        return rows

    def write_jacobian(self, model: mujoco.MjModel, data: mujoco.MjData, out: Array) -> None:
        """Write the frame's Jacobian to an array (6, nv), or its linear rows to one (3, nv)."""
        of_frame = mujoco.mj_jacSite if self.is_site else mujoco.mj_jacBody
        of_frame(model, data, out[-3:], out[:3] if len(out) > 3 else None, self.id)


def own_length(model: mujoco.MjModel, frames: Iterable[Located]) -> float:
    """Return the length [m] of the longest chain from a joint to a frame, or the model's extent."""
    return max((_chain_length(model, frame) for frame in frames), default=0.0) or model.stat.extent


def _chain_length(model: mujoco.MjModel, frame: Located) -> float:
    total = math.hypot(*model.site_pos[frame.id].tolist()) if frame.is_site else 0.0
    body = frame.body if model.body_weldid[frame.body] else 0
    while body:
        first, parent = model.body_jntadr[body], model.body_parentid[body]
        for joint in range(first, first + model.body_jntnum[body]):
            total += math.hypot(*model.jnt_pos[joint].tolist())
        if not model.body_weldid[parent]:  # the place of a robot on the ground does not count
            break
        total += math.hypot(*model.body_pos[body].tolist())
        body = parent
    return total


def located(model: mujoco.MjModel, argument: str, frame: str | Body) -> Located:
    """Look up the frame that an argument names: a site if one has this name, else a body.

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
        raise ModelError(f"{argument}: the model has bodies 0 to {model.nbody - 1}, got {body}")
    return Located(body, body, is_site=False)


def find_frame(model: mujoco.MjModel, argument: str, frame: str | Body) -> str | Body:
    """Find a frame by the name of a site, else that of a body, else the number of a body.

    Raises:
        ModelError: There is none; the message names the argument and the nearest names.
    """
    if isinstance(frame, Body) or _is(model, "site", check.instance(argument, frame, str)):
        return frame
    if _is(model, "body", frame):
        return Body(frame)
    if frame.isdecimal() and len(frame) < 10:
        return Body(int(frame))
    names = [*names_of_kind(model, "site"), *names_of_kind(model, "body")]
    near = " or ".join(f'"{match}"' for match in get_close_matches(frame, names))
    hint = f"did you mean {near}?" if near else f"it has {listed(names)}"
    raise ModelError(f'{argument}: the model has no site or body "{frame:.80}"; {hint}')


def _is(model: mujoco.MjModel, kind: str, name: str) -> bool:
    """Return whether an element of this kind has this name."""
    return name in names_of_kind(model, kind)  # MuJoCo's own look-up cuts a name at a null byte


def rotation_vector(rotation: Array) -> Array:
    """Return the rotation vector (3,) of a rotation (3, 3), its angle in 0..pi."""
    quat_wxyz, vector = np.empty(4), np.empty(3)
    mujoco.mju_mat2Quat(quat_wxyz, rotation.ravel())
    mujoco.mju_quat2Vel(vector, quat_wxyz, 1.0)
    return one_half_turn(vector)


def one_half_turn(vector: Array) -> Array:
    """Make rotation vectors (..., 3) of half a turn unique; return others unchanged.

    Of the two vectors the one with a positive first non-zero component is taken: otherwise
    round-off would decide.
    """
    if vector.ndim == 1 and vector.dot(vector) < 9.8:  # less than pi^2: at every tick
        return vector
    angle = np.linalg.norm(vector, axis=-1, keepdims=True)
    if angle.max(initial=0.0) < _HALF_TURN:
        return vector
    nonzero = np.abs(vector) > np.pi * ACCURACY
    index = np.argmax(nonzero, axis=-1)[..., None]  # noqa: TID251 - truth values
    first = np.take_along_axis(vector, index, axis=-1)
    return np.where((angle >= _HALF_TURN) & (first < 0.0), -vector, vector)
