"""Scene in a browser: machines side by side, with magnified motion and failures in colour."""

from collections.abc import Sequence
from functools import partial

import mujoco
import numpy as np
import viser
from mjviser.conversions import merge_geoms
from scipy.spatial.transform import Rotation

from fjh.live.session import Session
from fjh.recording.file import rgb, round_down
from fjh.recording.machine import ahead_of
from fjh.recording.motion import Motion, mover
from fjh.recording.view import stated_of
from fjh.rig import Rig
from fjh.rig.bodies import body_name
from fjh.rig.run import HEALTHY
from fjh.study.palette import BLUE, FAILED, VERMILION
from sim import Array

NAMES = ("supervised", "not supervised")
COLORS = (BLUE, VERMILION)
_SPACING, _DISTANCE, _HIGHER, _POINTER = 1.2, 1.75, 0.1, 0.6
"""Spacing of machines, distance and height of the eye, length of the pointer, in extents."""
_TURN_RAD, _SHIFT = 0.2, 0.06
"""Radius of a magnified path: [rad], or extents of the machine."""
_DOWN = -0.95, -0.5
_TRAIL = 100
_GREY = "#777777"
FRAME_S = 0.04
_VISIBLE_GROUPS = 3
"""Number of groups of geoms that MuJoCo's viewer shows by default."""


class Stage:
    """Scene of both machines of a session, each with its path.

    Attributes:
        factor: Magnification factor of all motion.
    """

    def __init__(self, server: viser.ViserServer, session: Session) -> None:
        """Draw both machines at rest, next to each other in the viewing direction of the MJCF."""
        self._session, rig, run = session, session.rig, session.runs[0]
        model, extent = rig.model, float(rig.model.stat.extent)
        visible = _TURN_RAD if "rad" in rig.row_units else _SHIFT * extent
        self.factor = int(round_down(max(1.0, visible / rig.size)))
        ahead = _from_above(ahead_of(model))
        right = np.cross(ahead, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        self._pointer = Pointer(rig, *run.frame)
        self._actors = [
            Actor(server.scene, rig, name, side * _SPACING / 2 * extent * right, color)
            for name, side, color in zip(NAMES, (-1, 1), COLORS, strict=True)
        ]
        self._moves = mover(model, rig.file is None, run.motion(slice(0, 1))[1][0])
        centre = model.stat.center + np.array([0.0, 0.0, _HIGHER * extent])
        camera = server.initial_camera
        camera.look_at, camera.up = centre, np.array([0.0, 0.0, 1.0])
        camera.position = centre - _DISTANCE * extent * ahead

        @server.on_client_connect
        def _(client: viser.ClientHandle) -> None:
            # An upright screen shows less of the width.
            if (aspect := client.camera.aspect) < 1.0:
                client.camera.position = centre - _DISTANCE / aspect * extent * ahead
                client.camera.look_at = centre  # it moves with the position

    def show(self) -> None:
        """Update poses, failures and trails."""
        session = self._session
        every = max(1, round(FRAME_S / session.rig.period_s))
        path = self._pointer.at(session.reference.outline, self.factor)
        for actor, run in zip(self._actors, session.runs, strict=True):
            last = run.tick - 1
            task, qpos, _ = run.motion(slice(last, last + 1))
            actor.move(self._moves(task, qpos, self.factor))
            trail = slice(last - every * min(_TRAIL, last // every), last + 1, every)
            actor.trail(self._pointer.at(run.motion(trail)[2], self.factor), path)
            actor.color(session.states)


def _from_above(ahead: Array) -> Array:
    """Return the viewing direction, tilted so that a circle on the ground is visible from above."""
    level = np.array([ahead[0], ahead[1], 0.0])
    down = np.clip(ahead[2], *_DOWN)
    return level * (np.sqrt(1.0 - down**2) / np.linalg.norm(level)) + [0.0, 0.0, down]


class Pointer:
    """Point that visualizes the major rows: the tip of a pointer, or the task frame's origin."""

    def __init__(self, rig: Rig, origin: Array, axes: Array) -> None:
        """Take the task frame in the world: origin (3,) [m] and axes (3, 3) of the task rows."""
        turned = [row for row in rig.major if row < 3]
        self._rows, self._origin, self._axes = list(rig.major), origin, axes
        self._lever = np.zeros(3)
        if len(turned) == len(rig.major):  # rotations move only points off the origin
            free = [axis for axis in (2, 0, 1) if axis not in turned] or [2]
            along = axes[:, free[0]]
            self._lever = _POINTER * rig.model.stat.extent * along * (-1 if along[2] < 0 else 1)

    def at(self, rows: Array, factor: float) -> Array:
        """Return positions (N, 3) [m] of magnified displacements (N, m1) of the major rows."""
        moved = np.zeros((len(rows), 6))
        moved[:, self._rows] = factor * rows
        turn = Rotation.from_rotvec(moved[:, :3] @ self._axes.T)
        return self._origin + moved[:, 3:] @ self._axes.T + turn.apply(self._lever)


class Actor:
    """Machine in a scene."""

    def __init__(
        self, scene: viser.SceneApi, rig: Rig, name: str, place: Array, color: str
    ) -> None:
        """Draw the machine below its name at a position (3,), with a trail in this colour."""
        model, root = rig.model, "/" + name.replace(" ", "_")
        self._place, red = place, np.array(rgb(FAILED))
        self._frames = dict[int, viser.FrameHandle]()
        self._healthy, self._failed = dict[int, viser.GlbHandle](), dict[int, viser.MeshHandle]()
        for body in range(model.nbody):
            first = model.body_geomadr[body]
            own = range(first, first + model.body_geomnum[body])
            geoms = [k for k in own if _is_visible(model, k)]
            if not geoms:
                continue
            mesh, under = merge_geoms(model, geoms), f"{root}/bodies/{body}"
            self._frames[body] = scene.add_frame(under, show_axes=False)
            self._healthy[body] = scene.add_mesh_trimesh(f"{under}/healthy", mesh)
            self._failed[body] = scene.add_mesh_simple(
                f"{under}/failed", mesh.vertices, mesh.faces, color=red, visible=False
            )
        ids = {body_name(model, k): k for k in range(model.nbody)}
        self._moves = model.body_weldid != 0
        self._bodies = [[ids[body] for body in names] for names in stated_of(rig).bodies]
        top = model.stat.center + np.array([0.0, 0.0, 0.75 * model.stat.extent])
        scene.add_label(f"{root}/name", name, position=place + top, anchor="bottom-center")
        lines = partial(
            scene.add_line_segments, points=np.zeros((1, 2, 3)), thickness_units="screen"
        )
        self._trail = lines(f"{root}/trail", colors=np.array(rgb(color)), thickness=3.0)
        self._reference = lines(f"{root}/reference", colors=np.array(rgb(_GREY)), thickness=1.0)

    def move(self, motion: Motion) -> None:
        """Move the bodies to the last poses of a motion."""
        quats = Rotation.from_matrix(motion.rotation[-1]).as_quat(scalar_first=True)
        for body, frame in self._frames.items():
            frame.position = motion.position_m[-1, body] + self._place
            frame.wxyz = quats[body]
        self._frames = {k: frame for k, frame in self._frames.items() if self._moves[k]}

    def trail(self, past: Array, reference: Array) -> None:
        """Draw the trail of the last ticks and the reference path: positions (N, 3) [m]."""
        for handle, places in ((self._trail, past), (self._reference, reference)):
            ends = np.stack([places[:-1], places[1:]], axis=1) + self._place
            handle.points = ends.astype(np.float32)

    def color(self, states: Sequence[str]) -> None:
        """Colour the bodies of failed actuators, by the states of all actuators."""
        bad = {b for bodies, state in zip(self._bodies, states, strict=True) if state != HEALTHY
               for b in bodies}  # fmt: skip
        for body in self._failed:
            self._failed[body].visible = body in bad
            self._healthy[body].visible = body not in bad


def _is_visible(model: mujoco.MjModel, geom: int) -> bool:
    is_infinite = model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE
    group = model.geom_group[geom]
    return not is_infinite and group < _VISIBLE_GROUPS and model.geom_rgba[geom, 3] > 0
