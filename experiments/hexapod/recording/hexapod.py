"""The hexapod in 3D: its payload moves, its struts follow and show their current."""

from collections.abc import Sequence
from dataclasses import dataclass

import matplotlib
import mujoco
import numpy as np
import rerun as rr
from scipy.spatial.transform import Rotation

from experiments.output.palette import VERMILION, YELLOW
from experiments.output.recording.file import TIMELINE, rgb, time_column
from experiments.output.recording.machine import (
    Motion,
    body_entity,
    log_body_colors,
    log_machine,
)
from experiments.output.recording.marks import Mark
from sim import Array, Pose

_WHITE = [240, 240, 240]


def hexapod_motion(model: mujoco.MjModel, pose: Pose) -> Motion:
    """Bodies of the hexapod when its payload stands at poses (T,): struts reach for its top nodes.

    However large the motion, its loops are closed.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    to_world = data.site("base").xmat.reshape(3, 3)
    origin = data.site("payload").xpos
    turn = to_world @ pose.rotation @ to_world.T
    shift = pose.translation_m @ to_world.T

    def carried(point: Array) -> Array:
        return origin + shift + turn @ (point - origin)

    places = {"payload": (turn, carried(data.body("payload").xpos))}
    for k in range(1, 7):
        bottom, top = data.body(f"housing{k}").xpos, data.body(f"tip{k}").xpos
        swing = _smallest_turn(top - bottom, carried(top) - bottom)
        places[f"housing{k}"] = swing, np.broadcast_to(bottom, shift.shape)
        for upper in (f"stem{k}", f"tip{k}"):
            places[upper] = swing, carried(top) + swing @ (data.body(upper).xpos - top)
    standing = [data.body(name).xmat.reshape(3, 3) for name in places]
    turns, positions = zip(*places.values(), strict=True)
    return Motion(tuple(places), np.stack(turns, axis=1) @ standing, np.stack(positions, axis=1))


def _smallest_turn(before: Array, after: Array) -> Array:
    """Rotations (T, 3, 3) that lay one direction (3,) along others (T, 3)."""
    axis = np.cross(before, after)
    sine = np.linalg.norm(axis, axis=-1, keepdims=True)
    angle = np.arctan2(sine, (after @ before)[:, None])
    unit = np.divide(axis, sine, out=np.zeros_like(axis), where=sine > 0)
    return Rotation.from_rotvec(angle * unit).as_matrix()


@dataclass(frozen=True)
class Picture:
    """The hexapod over time, as it is drawn.

    Attributes:
        time_s: Shape (T,).
        pose: Of the payload, T of them, as far from nominal as is to be seen.
        load: Of the struts, shape (T, 6); it colours them.
        full_load: That of the deepest colours.
        marks: Struts that fail.
    """

    time_s: Array
    pose: Pose
    load: Array
    full_load: float
    marks: Sequence[Mark] = ()


def log_hexapod(
    recording: rr.RecordingStream, entity: str, model: mujoco.MjModel, picture: Picture
) -> None:
    """Log the hexapod, as its MJCF draws it, below an entity."""
    time = time_column(picture.time_s)
    motion = hexapod_motion(model, picture.pose)
    log_machine(recording, entity, model, motion, picture.time_s)
    for k in range(6):
        colors = load_colors(picture.load[:, k], picture.full_load)
        log_body_colors(recording, entity, model, (f"housing{k + 1}", f"stem{k + 1}"), time, colors)
        label = rr.Points3D(
            [[0, 0, 0.21]], radii=[0.001], colors=[_WHITE], labels=[f"{k + 1}"], show_labels=True
        )
        recording.log(f"{body_entity(entity, f'housing{k + 1}')}/number", label, static=True)
    # The pointing axis: the payload's z axis, upwards. The laser is in the MJCF, and stands still.
    beam = rr.LineStrips3D([[[0, 0, 0.17], [0, 0, 0.55]]], colors=[rgb(VERMILION)], radii=[0.002])
    recording.log(f"{body_entity(entity, 'payload')}/beam", beam, static=True)
    for mark in picture.marks:
        _log_collar(recording, entity, mark)


def load_colors(load: Array, full_load: float) -> Array:
    """Blue for negative, grey for no, red for positive load (T,), shape (T, 3), 0..255."""
    share = 0.5 + 0.5 * load / full_load
    return matplotlib.colormaps["coolwarm"](share, bytes=True)[:, :3]


def _log_collar(recording: rr.RecordingStream, entity: str, mark: Mark) -> None:
    """A yellow collar around a strut from when it fails, and what is known of it."""
    path = f"{body_entity(entity, f'housing{mark.strut + 1}')}/failed"
    told = [(mark.failed_s, mark.failure)]
    if mark.is_found:
        told.append((mark.diagnosed_s, mark.diagnosis))
    times, labels = zip(*told, strict=True)
    shape = rr.Cylinders3D(
        lengths=[0.05],
        radii=[0.032],
        centers=[[0, 0, 0.05]],
        colors=[rgb(YELLOW)],
        fill_mode=rr.components.FillMode.Solid,
    )
    recording.set_time(TIMELINE, duration=mark.failed_s)
    recording.log(path, shape)
    recording.reset_time()
    columns = rr.Cylinders3D.columns(labels=labels, show_labels=[True] * len(labels))
    recording.send_columns(path, [time_column(np.array(times))], columns)
