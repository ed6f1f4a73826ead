"""Poses of all bodies of a robot over time, magnified so that they are seen to move."""

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from fjh.recording import Array
from fjh.recording.file import round_down
from fjh.rig.bodies import body_name
from sim import NOMINAL, Pose

BODIES = tuple((f"housing{k}", f"stem{k}") for k in range(1, 7))
"""Bodies that each strut of the hexapod moves."""
_TURN_RAD, _SHIFT_M = 0.12, 0.03
"""No magnified motion is larger: 7 degrees and 30 mm."""


@dataclass(frozen=True)
class Motion:
    """Poses of B bodies at T times in MuJoCo's world: (T, B, 3, 3) and (T, B, 3)."""

    names: tuple[str, ...]
    rotation: Array
    position_m: Array


Mover = Callable[[Array, Array, float], Motion]
"""Magnified motion, of task displacements (T, 6), joint positions (T, nq) and a factor."""


def motion_of(model: mujoco.MjModel, qpos: Array) -> Motion:
    """Poses of all bodies at joint positions (T, nq)."""
    data = mujoco.MjData(model)
    names = tuple(body_name(model, k) for k in range(model.nbody))
    rotation = np.empty((len(qpos), model.nbody, 3, 3))
    position_m = np.empty((len(qpos), model.nbody, 3))
    for k, data.qpos[:] in enumerate(qpos):
        mujoco.mj_kinematics(model, data)
        rotation[k], position_m[k] = data.xmat.reshape(-1, 3, 3), data.xpos
    return Motion(names, rotation, position_m)


def displacement(motion: Motion, nominal: Motion) -> tuple[Array, Array]:
    """Rotation vectors and translations of all bodies from their nominal poses, (T, B, 3) each."""
    turn = motion.rotation @ nominal.rotation.swapaxes(-1, -2)
    vector = Rotation.from_matrix(turn.reshape(-1, 3, 3)).as_rotvec()
    return vector.reshape(motion.position_m.shape), motion.position_m - nominal.position_m


def magnified(motion: Motion, nominal: Motion, factor: float) -> Motion:
    """The motion with every body's displacement from its nominal pose multiplied by a factor.

    Rotation vectors and translations of the bodies' origins are multiplied: to first order loops
    stay closed.
    """
    vector, shift = displacement(motion, nominal)
    turn = Rotation.from_rotvec(factor * vector.reshape(-1, 3)).as_matrix()
    larger = turn.reshape(motion.rotation.shape) @ nominal.rotation
    return Motion(motion.names, larger, nominal.position_m + factor * shift)


def magnification(angles_rad: Array, distances_m: Array) -> int:
    """A round factor (1, 2, 5, 10, ...) that makes these displacements visible."""
    largest = (max(float(np.abs(each).max()), 1e-12) for each in (angles_rad, distances_m))
    most = min(seen / size for seen, size in zip((_TURN_RAD, _SHIFT_M), largest, strict=True))
    return int(round_down(np.clip(most, 1.0, 5e9)))


def mover(model: mujoco.MjModel, is_hexapod: bool, start: Array) -> Mover:
    """The magnified motion of a robot that starts at joint positions (nq,).

    The hexapod's follows from its payload's displacements, that of other robots from their joints.
    """
    if is_hexapod:
        moved = hexapod_mover(model)
        return lambda task, _, factor: moved(NOMINAL.moved(factor * task))
    nominal = motion_of(model, start[None])
    return lambda _, qpos, factor: magnified(motion_of(model, qpos), nominal, factor)


def hexapod_mover(model: mujoco.MjModel) -> Callable[[Pose], Motion]:
    """All bodies of the hexapod with its payload at poses (T,), struts pointing at their top nodes.

    However large the motion, its loops are closed.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    to_world = data.site("base").xmat.reshape(3, 3)
    origin = data.site("payload").xpos
    standing = motion_of(model, model.qpos0[None])
    at = {name: (k, standing.position_m[0, k]) for k, name in enumerate(standing.names)}

    def moved(pose: Pose) -> Motion:
        turn = to_world @ pose.rotation @ to_world.T
        shift = pose.translation_m @ to_world.T

        def carried(point: Array) -> Array:
            return origin + shift + turn @ (point - origin)

        places = {"payload": (turn, carried(at["payload"][1]))}
        for k in range(1, 7):
            bottom, top = at[f"housing{k}"][1], at[f"tip{k}"][1]
            swing = _smallest_turn(top - bottom, carried(top) - bottom)
            places[f"housing{k}"] = swing, np.broadcast_to(bottom, shift.shape)
            for upper in (f"stem{k}", f"tip{k}"):
                places[upper] = swing, carried(top) + swing @ (at[upper][1] - top)
        rotation = np.repeat(standing.rotation, len(shift), axis=0)
        position_m = np.repeat(standing.position_m, len(shift), axis=0)
        for name, (swing, place) in places.items():
            number = at[name][0]
            rotation[:, number], position_m[:, number] = swing @ rotation[:, number], place
        return Motion(standing.names, rotation, position_m)

    return moved


def _smallest_turn(before: Array, after: Array) -> Array:
    """Rotations (T, 3, 3) that turn one direction (3,) into others (T, 3)."""
    axis = np.cross(before, after)
    sine = np.linalg.norm(axis, axis=-1, keepdims=True)
    angle = np.arctan2(sine, (after @ before)[:, None])
    unit = np.divide(axis, sine, out=np.zeros_like(axis), where=sine > 0)
    return Rotation.from_rotvec(angle * unit).as_matrix()
