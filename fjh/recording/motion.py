"""Poses of all bodies of a robot over time, magnified to make small motions visible."""

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
"""Bodies moved by each strut of the hexapod."""
_TURN_RAD, _SHIFT_M = 0.12, 0.03
"""Largest rotation [rad] and translation [m] of magnified motion: 7 degrees and 30 mm."""


@dataclass(frozen=True)
class Motion:
    """Poses of B bodies at T times in MuJoCo's world: (T, B, 3, 3) and (T, B, 3)."""

    names: tuple[str, ...]
    rotation: Array
    position_m: Array


Mover = Callable[[Array, Array, float], Motion]
"""Function from task displacements (T, 6), joint positions (T, nq) and a factor to a motion."""


def motion_of(model: mujoco.MjModel, qpos: Array) -> Motion:
    """Return the poses of all bodies at joint positions (T, nq)."""
    data = mujoco.MjData(model)
    names = tuple(body_name(model, k) for k in range(model.nbody))
    rotation = np.empty((len(qpos), model.nbody, 3, 3))
    position_m = np.empty((len(qpos), model.nbody, 3))
    for k, data.qpos[:] in enumerate(qpos):
        mujoco.mj_kinematics(model, data)
        rotation[k], position_m[k] = data.xmat.reshape(-1, 3, 3), data.xpos
    return Motion(names, rotation, position_m)


def displacement(motion: Motion, nominal: Motion) -> tuple[Array, Array]:
    """Return rotation vectors [rad] and translations [m] from nominal poses, (T, B, 3) each."""
    turn = motion.rotation @ nominal.rotation.swapaxes(-1, -2)
    vector = Rotation.from_matrix(turn.reshape(-1, 3, 3)).as_rotvec()
    return vector.reshape(motion.position_m.shape), motion.position_m - nominal.position_m


def magnified(motion: Motion, nominal: Motion, factor: float) -> Motion:
    """Multiply every body's displacement from its nominal pose by a factor.

    Rotation vectors and translations of the bodies' origins are multiplied: to first order loops
    stay closed.
    """
    vector, shift = displacement(motion, nominal)
    turn = Rotation.from_rotvec(factor * vector.reshape(-1, 3)).as_matrix()
    larger = turn.reshape(motion.rotation.shape) @ nominal.rotation
    return Motion(motion.names, larger, nominal.position_m + factor * shift)


def magnification(angles_rad: Array, distances_m: Array) -> int:
    """Return a round factor (1, 2, 5, 10, ...) that makes these displacements visible."""
    largest = (max(float(np.abs(values).max()), 1e-12) for values in (angles_rad, distances_m))
    most = min(seen / size for seen, size in zip((_TURN_RAD, _SHIFT_M), largest, strict=True))
    return int(round_down(np.clip(most, 1.0, 5e9)))


def mover(model: mujoco.MjModel, is_hexapod: bool, start: Array) -> Mover:
    """Return a function that magnifies a robot's motion about its start, positions (nq,).

    The function uses payload displacements for the hexapod, joint positions for other robots.
    """
    if is_hexapod:
        moved = hexapod_mover(model)
        return lambda task, _, factor: moved(NOMINAL.moved(factor * task))
    nominal = motion_of(model, start[None])
    return lambda _, qpos, factor: magnified(motion_of(model, qpos), nominal, factor)


def hexapod_mover(model: mujoco.MjModel) -> Callable[[Pose], Motion]:
    """Return a function from payload poses (T,) to the motion of all bodies of the hexapod.

    Struts point at their top nodes, so that loops are closed for any magnification.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    to_world = data.site("base").xmat.reshape(3, 3)
    origin = data.site("payload").xpos
    nominal = motion_of(model, model.qpos0[None])
    at = {name: (k, nominal.position_m[0, k]) for k, name in enumerate(nominal.names)}

    def moved(pose: Pose) -> Motion:
        turn = to_world @ pose.rotation @ to_world.T
        shift = pose.translation_m @ to_world.T

        def transformed(point: Array) -> Array:
            return origin + shift + turn @ (point - origin)

        places = {"payload": (turn, transformed(at["payload"][1]))}
        for k in range(1, 7):
            bottom, top = at[f"housing{k}"][1], at[f"tip{k}"][1]
            tilt = _smallest_turn(top - bottom, transformed(top) - bottom)
            places[f"housing{k}"] = tilt, np.broadcast_to(bottom, shift.shape)
            for upper in (f"stem{k}", f"tip{k}"):
                places[upper] = tilt, transformed(top) + tilt @ (at[upper][1] - top)
        rotation = np.repeat(nominal.rotation, len(shift), axis=0)
        position_m = np.repeat(nominal.position_m, len(shift), axis=0)
        for name, (tilt, place) in places.items():
            number = at[name][0]
            rotation[:, number], position_m[:, number] = tilt @ rotation[:, number], place
        return Motion(nominal.names, rotation, position_m)

    return moved


def _smallest_turn(before: Array, after: Array) -> Array:
    """Return the smallest rotations (T, 3, 3) of one direction (3,) into others (T, 3)."""
    axis = np.cross(before, after)
    sine = np.linalg.norm(axis, axis=-1, keepdims=True)
    angle = np.arctan2(sine, (after @ before)[:, None])
    unit = np.divide(axis, sine, out=np.zeros_like(axis), where=sine > 0)
    return Rotation.from_rotvec(angle * unit).as_matrix()
