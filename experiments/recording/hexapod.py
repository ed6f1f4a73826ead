"""The hexapod as recordings show it: loops that close however much motion is magnified."""

from collections.abc import Callable, Mapping, Sequence

import matplotlib
import mujoco
import numpy as np
import rerun as rr
from scipy.spatial.transform import Rotation

from experiments.recording.file import rgb
from experiments.recording.machine import Motion, exaggeration, motion_of
from experiments.recording.marks import Mark, found_in
from experiments.recording.shown import Shown, Ticks
from experiments.recording.signals import Plot
from experiments.study.palette import VERMILION
from sim import NOMINAL, Array, Pose

ROBOT = "University of Wyoming hexapod"
SECONDARY = ("gamma [urad]", "t_x [um]", "t_y [um]", "t_z [um]")
STRUTS = tuple(f"strut {k}" for k in range(1, 7))
BODIES = tuple((f"housing{k}", f"stem{k}") for k in range(1, 7))
FULL = np.full(6, 100.0)
"""Input at which a coil has its largest force [%]."""

_LABEL = [240] * 3
FIXTURES: tuple[tuple[str, rr.AsComponents], ...] = (
    *(
        (
            f"housing{k}/number",
            rr.Points3D(
                [[0, 0, 0.21]], radii=[0.001], colors=[_LABEL], labels=[f"{k}"], show_labels=True
            ),
        )
        for k in range(1, 7)
    ),
    # The pointing axis: the payload's z axis, upwards. The laser is in the MJCF, and stands still.
    (
        "payload/beam",
        rr.LineStrips3D([[[0, 0, 0.17], [0, 0, 0.55]]], colors=[rgb(VERMILION)], radii=[0.002]),
    ),
)
"""What is drawn beside the geoms of the MJCF."""


def of_hexapod(
    run: Mapping[str, Array],
    model: mujoco.MjModel,
    marks: Sequence[Mark] = (),
    *,
    extras: Sequence[Plot] = (),
    status: str = "",
) -> Shown:
    """A run of the hexapod, as its `.npz` has it, with the marks of its failing struts."""
    motion = np.concatenate([run["true_rad"], run["secondary"]], axis=1)
    return Shown(
        robot=ROBOT,
        model=model,
        time_s=run["time_s"],
        rows=("alpha", "beta"),
        row_units=("rad", "rad"),
        desired=run["desired_rad"],
        true=run["true_rad"],
        measured=run["measured_rad"],
        actuators=STRUTS,
        input_units=("%",) * 6,
        inputs=run["strut_input_percent"],
        limits=(-FULL, FULL),
        units=("m",) * 6,
        displacement=run["strut_displacement_m"],
        bodies=BODIES,
        secondary=(SECONDARY, 1e6 * run["secondary"]),
        estimated=1e6 * run["secondary_estimated"],
        closure_m=run["closure_residual_m"],
        motion=lambda ticks, factor: magnified(model, motion, ticks, factor),
        factor=factor_of(motion),
        marks=sorted(marks, key=lambda mark: mark.failed_s),
        beliefs=found_in(marks),
        status=status,
        extras=extras,
        colored=True,
        fixtures=FIXTURES,
    )


def factor_of(motion: Array) -> int:
    """A round factor that makes displacements (N, 6) [rotation vector; translation] visible."""
    largest = np.abs(motion).max(axis=0)
    return exaggeration(float(largest[:3].max()), float(largest[3:].max()))


def magnified(model: mujoco.MjModel, motion: Array, ticks: Ticks, factor: float) -> Motion:
    """Bodies at some ticks of displacements (N, 6) of the payload, multiplied by a factor.

    Takes alpha, beta, gamma as a rotation vector: correct to the second order of the angles.
    """
    return hexapod_motion(model, NOMINAL.moved(factor * motion[ticks]))


def hexapod_motion(model: mujoco.MjModel, pose: Pose) -> Motion:
    """All bodies of the hexapod with its payload at poses (T,), struts pointing at their top nodes.

    However large the motion, its loops are closed.
    """
    return hexapod_mover(model)(pose)


def hexapod_mover(model: mujoco.MjModel) -> Callable[[Pose], Motion]:
    """:func:`hexapod_motion` for who asks for many, one after the other."""
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


def load_colors(load: Array, full_load: float) -> Array:
    """Blue for negative, grey for no, red for positive load (T,), shape (T, 3), 0..255."""
    share = 0.5 + 0.5 * load / full_load
    return matplotlib.colormaps["coolwarm"](share, bytes=True)[:, :3]
