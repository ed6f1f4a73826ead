"""The hexapod in 3D, its struts coloured by their current, and the marks of struts that fail."""

from collections.abc import Sequence
from dataclasses import dataclass

import matplotlib
import mujoco
import numpy as np
import rerun as rr
from scipy.spatial.transform import Rotation

from experiments.recording.file import rgb, time_column
from experiments.recording.marks import Mark, log_mark
from experiments.recording.mechanism import Motion, body_entity, log_body_colors, log_machine
from experiments.rig.hexapod.simulation import Trajectory
from experiments.study.palette import VERMILION, YELLOW
from sim import Array, Pose

_WHITE, _GREY, _LABEL, _YELLOW = [255] * 3, [190] * 3, [240] * 3, rgb(YELLOW)
_MARK_WIDTH = 3.0


@dataclass(frozen=True)
class Picture:
    """The hexapod at times (T,), as it is drawn: T poses of its payload, exaggeration included.

    The loads (T, 6) colour the struts, the full load most deeply.
    """

    time_s: Array
    pose: Pose
    load: Array
    full_load: float
    marks: Sequence[Mark] = ()


def hexapod_motion(model: mujoco.MjModel, pose: Pose) -> Motion:
    """Bodies of the hexapod with its payload at poses (T,), each strut pointing at its top node.

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
    """Rotations (T, 3, 3) that turn one direction (3,) into others (T, 3)."""
    axis = np.cross(before, after)
    sine = np.linalg.norm(axis, axis=-1, keepdims=True)
    angle = np.arctan2(sine, (after @ before)[:, None])
    unit = np.divide(axis, sine, out=np.zeros_like(axis), where=sine > 0)
    return Rotation.from_rotvec(angle * unit).as_matrix()


def load_colors(load: Array, full_load: float) -> Array:
    """Blue for negative, grey for no, red for positive load (T,), shape (T, 3), 0..255."""
    share = 0.5 + 0.5 * load / full_load
    return matplotlib.colormaps["coolwarm"](share, bytes=True)[:, :3]


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
            [[0, 0, 0.21]], radii=[0.001], colors=[_LABEL], labels=[f"{k + 1}"], show_labels=True
        )
        recording.log(f"{body_entity(entity, f'housing{k + 1}')}/number", label, static=True)
    # The pointing axis: the payload's z axis, upwards. The laser is in the MJCF, and stands still.
    beam = rr.LineStrips3D([[[0, 0, 0.17], [0, 0, 0.55]]], colors=[rgb(VERMILION)], radii=[0.002])
    recording.log(f"{body_entity(entity, 'payload')}/beam", beam, static=True)
    for mark in picture.marks:
        _log_collar(recording, entity, mark)


def _log_collar(recording: rr.RecordingStream, entity: str, mark: Mark) -> None:
    """Log a yellow collar around a strut from its failure on."""
    collar = rr.Cylinders3D(
        lengths=[0.05],
        radii=[0.032],
        centers=[[0, 0, 0.05]],
        colors=[_YELLOW],
        fill_mode=rr.components.FillMode.Solid,
    )
    log_mark(recording, body_entity(entity, f"housing{mark.actuator + 1}"), mark, collar)


def log_marks(recording: rr.RecordingStream, marks: Sequence[Mark], run: Trajectory) -> None:
    """Log for each failing strut of a run: its state, the events as text, its input in colour."""
    begin_s, end_s = float(run.time_s[0]), float(run.time_s[-1])
    style = rr.StateConfiguration(
        values=["sound", "failed", "diagnosed"], colors=[_GREY, _YELLOW, _WHITE]
    )
    for mark in marks:
        strut, found_s = mark.actuator + 1, min(mark.diagnosed_s, end_s)
        changes = [(begin_s, "sound")] if mark.failed_s > begin_s else []
        changes.append((mark.failed_s, "failed"))
        _log_input(recording, run, mark, "failed", _YELLOW, (mark.failed_s, found_s))
        _log_text(recording, mark.failed_s, mark.failure)
        if mark.is_found:
            changes.append((mark.diagnosed_s, "diagnosed"))
            _log_input(recording, run, mark, "diagnosed", _WHITE, (found_s, end_s))
            _log_text(recording, mark.diagnosed_s, mark.diagnosis)
        times, states = zip(*changes, strict=True)
        columns = rr.StateChange.columns(state=states)
        recording.log(f"state/strut_{strut}", style, static=True)
        recording.send_columns(f"state/strut_{strut}", [time_column(np.array(times))], columns)


def _log_input(
    recording: rr.RecordingStream,
    run: Trajectory,
    mark: Mark,
    state: str,
    color: list[int],
    span_s: tuple[float, float],
) -> None:
    """Log the input of a marked strut while it is in a state, as a thick line."""
    entity = f"strut/input/strut_{mark.actuator + 1}_{state}"
    name = f"strut {mark.actuator + 1} {state} [%]"
    style = rr.SeriesLines(names=[name], colors=[color], widths=[_MARK_WIDTH])
    recording.log(entity, style, static=True)
    within = (run.time_s >= span_s[0]) & (run.time_s <= span_s[1])
    columns = rr.Scalars.columns(scalars=run.strut_input_percent[within, mark.actuator])
    recording.send_columns(entity, [time_column(run.time_s[within])], columns)


def _log_text(recording: rr.RecordingStream, when_s: float, text: str) -> None:
    columns = rr.TextLog.columns(text=[text])
    recording.send_columns("events", [time_column(np.array([when_s]))], columns)
