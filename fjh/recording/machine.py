"""View of a machine in 3D from its MJCF, with moving bodies and failed actuators in colour."""

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import matplotlib
import mujoco
import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun_loader_mjcf import MJCFLogger, MJCFLogPaths
from scipy.spatial.transform import Rotation

from fjh.recording import Array
from fjh.recording.file import TIMELINE, at_most, rgb, time_column
from fjh.recording.motion import Motion
from fjh.rig.bodies import body_name
from fjh.study.palette import FAILED, VERMILION

_PICTURES_HZ = 25
_DISTANCE = 1.6
"""Distance of the eye in extents of the machine, at which machine and labels are visible."""
_ASIDE, _ABOVE, _BELOW = 0.3, 0.55, 0.09
"""Position of labels beside and above the centre, and their spacing, in extents of the machine."""
_LABEL = [240] * 3

FIXTURES: Mapping[str, rr.AsComponents] = {
    f"housing{k}/number": rr.Points3D(
        [[0, 0, 0.21]], radii=[0.001], colors=[_LABEL], labels=[f"{k}"], show_labels=True
    )
    for k in range(1, 7)
} | {
    # The pointing axis: the payload's z axis, upwards. The laser in the MJCF is stationary.
    "payload/beam": rr.LineStrips3D(
        [[[0, 0, 0.17], [0, 0, 0.55]]], colors=[rgb(VERMILION)], radii=[0.002]
    )
}
"""Strut numbers and the pointing axis on bodies of the hexapod, by entities below the bodies."""

Failing = tuple[Sequence[str], Sequence[tuple[float, str]]]
"""Bodies of a failed actuator, and its labels, each with the time [s] from which it is shown."""


def stills(time_s: Array) -> slice:
    """Return the slice of samples that are logged in 3D, evenly spaced."""
    return at_most(_PICTURES_HZ, time_s)


def load_colors(load: Array, full_load: float) -> Array:
    """Return colours (T, 3) in 0..255 of loads (T,): blue negative, grey zero, red positive."""
    share = 0.5 + 0.5 * load / full_load
    return matplotlib.colormaps["coolwarm"](share, bytes=True)[:, :3]


@dataclass(frozen=True)
class Picture:
    """Motion of a machine in 3D over time, with failures.

    Attributes:
        model: Model with all geoms to draw.
        time_s: Times (T,).
        motion: Magnified motion of its bodies.
        factor: Factor of the magnification.
        failing: Failed actuators; those without bodies are not marked.
        colors: Colours of bodies over time, (T, 3) in 0..255, until they fail.
        fixtures: Further shapes that move with bodies, by entities below them.
        note: Addition to the title, such as the meaning of colours.
    """

    model: mujoco.MjModel
    time_s: Array
    motion: Motion
    factor: int
    failing: Sequence[Failing] = ()
    colors: Mapping[str, Array] = field(default_factory=dict)
    fixtures: Mapping[str, rr.AsComponents] = field(default_factory=dict)
    note: str = ""

    @property
    def title(self) -> str:
        """Title with the magnification of motion and the note."""
        size = f"motion x{self.factor}" if self.factor > 1 else ""
        return "; ".join(filter(None, (size, self.note)))


def log_machine(recording: rr.RecordingStream, entity: str, picture: Picture) -> None:
    """Log the geoms of a machine below an entity, with their motion and the marks of failures."""
    motion, time_s, start_s = picture.motion, picture.time_s, float(picture.time_s[0])
    model = copy.copy(picture.model)
    model.geom_contype[:] = model.geom_conaffinity[:] = 0  # colliding geoms are omitted or doubled
    logger = MJCFLogger(model, entity_path_prefix=entity)
    recording.set_time(TIMELINE, duration=start_s)
    logger.log_model(recording)
    for k, name in enumerate(motion.names):
        place, turn = motion.position_m[:, k], motion.rotation[:, k]
        moves = np.ptp(place, axis=0).any() or np.ptp(turn, axis=0).any()
        rows = slice(None if moves else 1)
        columns = rr.Transform3D.columns(
            translation=place[rows], quaternion=Rotation.from_matrix(turn[rows]).as_quat()
        )
        recording.send_columns(body_entity(entity, name), [time_column(time_s[rows])], columns)
    for below, archetype in picture.fixtures.items():
        recording.log(body_entity(entity, below), archetype, static=True)
    failed_s = {
        name: max(start_s, labels[0][0]) for names, labels in picture.failing for name in names
    }
    for name in picture.colors:
        _log_colors(recording, entity, picture, name, failed_s.get(name, np.inf))
    number = {body_name(model, k): k for k in range(model.nbody)}
    for name, when_s in failed_s.items():
        recording.set_time(TIMELINE, duration=when_s)
        logger.set_body_color(number[name], [*np.divide(rgb(FAILED), 255), 1.0], recording)
    recording.reset_time()
    for k, (names, _) in enumerate(picture.failing):
        if names:
            _log_label(recording, f"{entity}/labels/failure_{k}", picture, k)


def body_entity(entity: str, body: str) -> str:
    """Return the entity of a body's pose; entities below it move with the body."""
    return MJCFLogPaths(entity).body_path(body)


def _log_colors(
    recording: rr.RecordingStream, entity: str, picture: Picture, name: str, until_s: float
) -> None:
    """Log the colours of a body's cylinders over time, until a time [s]."""
    until, model = slice(int(np.searchsorted(picture.time_s, until_s))), picture.model
    time_s, colors, body = picture.time_s[until], picture.colors[name][until], model.body(name)
    for k in range(body.geomadr[0], body.geomadr[0] + body.geomnum[0]):
        if len(time_s) and model.geom_type[k] == mujoco.mjtGeom.mjGEOM_CYLINDER:
            geom = model.geom(k).name or f"geom_{k}"
            columns = rr.Cylinders3D.columns(colors=colors)
            path = f"{MJCFLogPaths(entity).visual_root}/{name}/{geom}"
            recording.send_columns(path, [time_column(time_s)], columns)


def _log_label(recording: rr.RecordingStream, path: str, picture: Picture, row: int) -> None:
    """Log the labels of a failure next to the machine, with a line to the failed bodies."""
    (bodies, labels), model = picture.failing[row], picture.model
    since = picture.time_s >= labels[0][0] - 1e-9
    if not since.any():
        return
    at = [picture.motion.names.index(name) for name in bodies]
    joint = picture.motion.position_m[since][:, at].mean(axis=1)
    extent, right = float(model.stat.extent), np.cross(ahead_of(model), [0, 0, 1])
    right /= np.linalg.norm(right)
    side = 1 if (joint[0] - model.stat.center) @ right >= 0 else -1
    up = (_ABOVE - _BELOW * row) * np.cross(right, ahead_of(model))
    place = model.stat.center + extent * (side * _ASIDE * right + up)
    color, lines = rgb(FAILED), np.stack([np.broadcast_to(place, joint.shape), joint], axis=1)
    style = rr.LineStrips3D.from_fields(colors=[color], radii=[-0.5])
    recording.log(f"{path}/line", style, static=True)
    columns = rr.LineStrips3D.columns(strips=lines)
    recording.send_columns(f"{path}/line", [time_column(picture.time_s[since])], columns)
    style = rr.Points3D.from_fields(
        positions=[place], colors=[color], radii=[-2.0], show_labels=True
    )
    recording.log(f"{path}/text", style, static=True)
    times, texts = zip(*labels, strict=True)
    columns = rr.Points3D.columns(labels=texts)
    recording.send_columns(f"{path}/text", [time_column(np.array(times))], columns)


def ahead_of(model: mujoco.MjModel) -> Array:
    """Return the viewing direction (3,) that the MJCF states."""
    azimuth, elevation = np.deg2rad([model.vis.global_.azimuth, model.vis.global_.elevation])
    level = np.cos(elevation)
    return np.array([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)])


def machine_view(entity: str, name: str, model: mujoco.MjModel) -> rrb.Spatial3DView:
    """Return a view of a mechanism from the direction that its MJCF states."""
    eye = rrb.EyeControls3D(
        kind=rrb.Eye3DKind.Orbital,
        position=model.stat.center - _DISTANCE * model.stat.extent * ahead_of(model),
        look_target=model.stat.center,
        eye_up=[0, 0, 1],
    )
    return rrb.Spatial3DView(origin=entity, name=name, eye_controls=eye, line_grid=False)
