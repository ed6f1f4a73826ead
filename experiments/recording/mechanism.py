"""A mechanism in 3D, drawn as its MJCF says, its bodies moving; and in several conditions."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun_loader_mjcf import MJCFLogger, MJCFLogPaths
from scipy.spatial.transform import Rotation

from experiments.recording import Array
from experiments.recording import views as beside
from experiments.recording.file import (
    TIMELINE,
    RecordingInfo,
    at_most,
    recording_file,
    rgb,
    round_down,
    screen,
    time_column,
)
from experiments.recording.marks import Mark, log_mark
from experiments.rig.bodies import body_name
from experiments.study.palette import YELLOW

_COLUMNS = 3
_MARK = 0.03
"""Radius of the mark at a failing joint, in extents of the machine."""
_PICTURES_HZ = 25
_DISTANCE = 1.6
"""Of the eye, in extents of the machine: all of it is seen."""


@dataclass(frozen=True)
class Motion:
    """B bodies of a machine at T times, in MuJoCo's world: (T, B, 3, 3) and (T, B, 3)."""

    names: tuple[str, ...]
    rotation: Array
    position_m: Array


def motion_of(model: mujoco.MjModel, qpos: Array) -> Motion:
    """All bodies at positions (T, nq)."""
    data = mujoco.MjData(model)
    names = tuple(body_name(model, k) for k in range(model.nbody))
    rotation = np.empty((len(qpos), model.nbody, 3, 3))
    position_m = np.empty((len(qpos), model.nbody, 3))
    for k, data.qpos[:] in enumerate(qpos):
        mujoco.mj_kinematics(model, data)
        rotation[k], position_m[k] = data.xmat.reshape(-1, 3, 3), data.xpos
    return Motion(names, rotation, position_m)


def exaggerated(motion: Motion, nominal: Motion, factor: float) -> Motion:
    """The motion with every body's displacement from its nominal pose multiplied by a factor.

    Rotation vectors and translations of the bodies' origins are multiplied: to first order loops
    stay closed.
    """
    vector, shift = _displacement(motion, nominal)
    turn = Rotation.from_rotvec(factor * vector.reshape(-1, 3)).as_matrix()
    larger = turn.reshape(motion.rotation.shape) @ nominal.rotation
    return Motion(motion.names, larger, nominal.position_m + factor * shift)


def _displacement(motion: Motion, nominal: Motion) -> tuple[Array, Array]:
    """Rotation vectors and translations from the nominal poses, shape (T, B, 3) each."""
    turn = motion.rotation @ nominal.rotation.swapaxes(-1, -2)
    vector = Rotation.from_matrix(turn.reshape(-1, 3, 3)).as_rotvec()
    return vector.reshape(motion.position_m.shape), motion.position_m - nominal.position_m


def exaggeration_of(motion: Motion, nominal: Motion) -> int:
    """A round factor that makes the motion of all bodies visible."""
    vector, shift = _displacement(motion, nominal)
    return exaggeration(float(np.abs(vector).max()), float(np.abs(shift).max()))


def exaggeration(angle_rad: float, distance_m: float) -> int:
    """A round factor (1, 2, 5, 10, ...) that makes a motion visible: up to 7 degrees and 30 mm."""
    most = min(0.12 / max(angle_rad, 1e-12), 0.03 / max(distance_m, 1e-12))
    return int(round_down(np.clip(most, 1.0, 5e9)))


def stills(time_s: Array) -> slice:
    """The samples that are drawn in 3D, of evenly spaced ones."""
    return at_most(_PICTURES_HZ, time_s)


def log_machine(
    recording: rr.RecordingStream, entity: str, model: mujoco.MjModel, motion: Motion, time_s: Array
) -> None:
    """Log the geoms of an MJCF below an entity, and their motion at times (T,)."""
    time = time_column(time_s)
    recording.set_time(TIMELINE, duration=float(time_s[0]))
    MJCFLogger(model, entity_path_prefix=entity, log_collision=True).log_model(recording)
    recording.reset_time()
    for k, name in enumerate(motion.names):
        columns = rr.Transform3D.columns(
            translation=motion.position_m[:, k],
            quaternion=Rotation.from_matrix(motion.rotation[:, k]).as_quat(),
        )
        recording.send_columns(body_entity(entity, name), [time], columns)


def body_entity(entity: str, body: str) -> str:
    """The entity of a body's pose; what is logged below it moves with the body."""
    return MJCFLogPaths(entity).body_path(body)


def log_body_colors(
    recording: rr.RecordingStream,
    entity: str,
    model: mujoco.MjModel,
    bodies: Iterable[str],
    time: rr.TimeColumn,
    colors: Array,
) -> None:
    """Colour the cylinders of some bodies over time, shape (T, 3) in 0..255."""
    for name in bodies:
        body = model.body(name)
        for k in range(body.geomadr[0], body.geomadr[0] + body.geomnum[0]):
            if model.geom_type[k] == mujoco.mjtGeom.mjGEOM_CYLINDER:
                geom = model.geom(k).name or f"geom_{k}"
                columns = rr.Cylinders3D.columns(colors=colors)
                path = f"{MJCFLogPaths(entity).visual_root}/{name}/{geom}"
                recording.send_columns(path, [time], columns)


def sizes(factor: int) -> tuple[int, ...]:
    """The exaggerations that a recording shows: this factor, and none."""
    return tuple(dict.fromkeys((factor, 1)))


def sized_entity(entity: str, size: int) -> str:
    """The entity of a machine whose motion is exaggerated by so much."""
    return f"{entity}_x{size}"


def machine_tabs(entity: str, name: str, model: mujoco.MjModel, factor: int) -> rrb.Tabs:
    """Two tabs: a mechanism with its motion exaggerated, and as it is, seen as its MJCF says."""
    azimuth, elevation = np.deg2rad([model.vis.global_.azimuth, model.vis.global_.elevation])
    level = np.cos(elevation)
    ahead = np.array([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)])
    eye = rrb.EyeControls3D(
        kind=rrb.Eye3DKind.Orbital,
        position=model.stat.center - _DISTANCE * model.stat.extent * ahead,
        look_target=model.stat.center,
        eye_up=[0, 0, 1],
    )
    titles = {size: f"x{size} {name}" if size > 1 else "True size (x1)" for size in sizes(factor)}
    views = (
        rrb.Spatial3DView(
            origin=sized_entity(entity, size), name=title, eye_controls=eye, line_grid=False
        )
        for size, title in titles.items()
    )
    return rrb.Tabs(*views, active_tab=0)


@dataclass(frozen=True)
class Driven:
    """A mechanism in one condition, at evenly spaced times (N,).

    `qpos` are the positions of all its joints, (N, nq); the task, if any, is drawn in a plane.
    `nominal` is the pose (nq,) that motion is exaggerated about; None is `qpos0`. Each
    mark is at the body that its actuator moves.
    """

    time_s: Array
    qpos: Array
    plots: Sequence[beside.Plot]
    task: beside.Task | None = None
    nominal: Array | None = None
    marks: Sequence[tuple[str, Mark]] = ()


def write_mechanism(
    path: Path, about: RecordingInfo, model: mujoco.MjModel, conditions: Mapping[str, Driven]
) -> None:
    """Write one mechanism in several conditions as an `.rrd` file.

    Motions too small to be seen are exaggerated, by a factor that the title of the view states.
    """
    nominal = {
        name: motion_of(model, (model.qpos0 if one.nominal is None else one.nominal)[None])
        for name, one in conditions.items()
    }
    motions = {
        name: motion_of(model, one.qpos[stills(one.time_s)]) for name, one in conditions.items()
    }
    factors = {name: exaggeration_of(motion, nominal[name]) for name, motion in motions.items()}
    each = list(enumerate(conditions.items()))
    cells = [_cell(k, name, model, one, factors[name]) for k, (name, one) in each]
    grid = rrb.Grid(*cells, grid_columns=min(_COLUMNS, len(cells)))
    views = rrb.Horizontal(beside.notes_view(), grid, column_shares=[1, 4])
    radius = _MARK * float(model.stat.extent)
    with recording_file(path, about, screen(views)) as recording:
        for k, (name, one) in each:
            for size in sizes(factors[name]):
                entity = sized_entity(f"{_entity(k)}/machine", size)
                larger = exaggerated(motions[name], nominal[name], size)
                log_machine(recording, entity, model, larger, one.time_s[stills(one.time_s)])
                for body, mark in one.marks:
                    ball = rr.Points3D([[0.0] * 3], radii=[radius], colors=[rgb(YELLOW)])
                    log_mark(recording, body_entity(entity, body), mark, ball)
            beside.log_plots(recording, one.plots, f"{_entity(k)}/")
            if one.task:
                entity = f"{_entity(k)}/task"
                beside.log_plane(recording, entity, one.time_s, one.task, one.task.square)


def _entity(k: int) -> str:
    return f"condition_{k}"


def _cell(k: int, name: str, model: mujoco.MjModel, one: Driven, factor: int) -> rrb.Vertical:
    pictures: list[rrb.View | rrb.Container] = [
        machine_tabs(f"{_entity(k)}/machine", name, model, factor)
    ]
    if task := one.task:
        title = f"{task.names[1]} over {task.names[0]} [{task.unit}]"
        pictures.append(beside.plane_view(f"{_entity(k)}/task", title, task.square))
    return rrb.Vertical(
        rrb.Horizontal(*pictures, column_shares=[3, 2][: len(pictures)]),
        *beside.plot_views(one.plots, f"{_entity(k)}/"),
        row_shares=[2] + [1] * len(one.plots),
    )
