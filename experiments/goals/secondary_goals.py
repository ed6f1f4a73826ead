"""The four secondary goals: what each is to keep clear of, and the weights or rates that do.

Reliability by weights W1 that follow the coils' temperatures; stroke limits, an obstacle and a
singularity by desired rates down the gradient of what is missing, eq. (24).
"""

from dataclasses import asdict
from typing import Any

import mujoco
import numpy as np

from experiments.rig.arm import smooth_step
from ftc.goal import Goal
from sim import HEXAPOD_MJCF, Array, Coils, Pose

HOT_TARGET_URAD = (2771.0, 1600.0)
"""3.2 mrad off the axis, where struts 1 and 4 do most of the work: 84 % of their current."""
COILS = Coils(
    resistance_ohm=5.0,
    heat_capacity_j_per_k=4.0,
    thermal_resistance_k_per_w=np.array([2.2, 1.5, 1.5, 1.5, 1.5, 1.5]),
    ambient_c=20.0,
)
"""80 W at full current, and 10 g of copper: a light winding, with a time constant of 6 s, so that
16 s are long. Strut 1 has lost a third of its path to the ambient."""

LIMIT_C = 90.0
WARM_C = 60.0
"""Where a weight begins to rise; it reaches `HEAVIEST` at the limit."""
HEAVIEST = 10.0
REWEIGH_TICKS = 10
"""Between two changes of the weights: 10 ms. At 20 ms their steps begin to show in the pointing."""

FAR_TARGET_URAD = (3464.0, 2000.0)
"""4 mrad off the axis, in the direction of struts 1 and 4: the least sum of squares of the
displacements takes 664 um of these, beyond their stops; the least of the largest is 498 um."""
ACTIVE = 0.82
"""Part of the stroke beyond which a strut is led back."""
RELAX_S = 0.2
"""In which a strut comes back, or the payload clear; slow against the pointing loops, fast against
the slew."""
REACHED_UM = 10.0
"""A strut that is nearer to its stop than this has reached it: current and stop end together."""
LONGER = 1.5
"""The machine on which no stop needs avoiding."""

OBSTRUCTED_TARGET_URAD = (2000.0, 0.0)
"""Off the axis, so that the mirror cell below swings by 0.3 mm towards the obstacle."""
GAP_M = 0.25e-3
"""Between the obstacle and the mirror cell at the nominal pose."""
RADIUS_M = 0.02
SAFE_M = 0.1e-3
"""Clearance below which the payload is led away."""
TOUCHED_UM = 10.0
"""A clearance of less is a collision, or as good as one."""
LOCKED_STRUT = 0
"""Beside the obstacle, at its centre, as in Table I: with all six struts the four secondary
velocities are free, and there would be nothing that a pseudo-inverse has to compromise."""
OBSTRUCTED = Goal(secondary_weight=(1.0,) * 4, locked_at={LOCKED_STRUT: 0.0})
"""W_d; the desired secondary velocity is zero where the payload is clear."""
_REACH_M = 1.0  # farther than anything here is

SHOULDER = (0, 1, 2)
"""Joints that are locked: sound, the arm never comes near a singularity of pointing; with elbow
and wrist alone it does where the camera looks along the forearm."""
AXIS_DEG = 133.5
"""Of the sweep: about this axis, from x_b towards y_b, the view passes close beside the forearm
just when the wrist's pitch axis is parallel to the elbow's."""
ANGLE_RAD = 2.2
GAIN_PER_S = 0.5
"""Desired joint rates per slope of the manipulability, which is at most about one: slow against
the servos, fast against the sweep."""
FADE_S = 2.0
"""In which the goal sets in: desired rates that step would kick the servos."""
CONDITION = 5.0
"""Largest condition number of J_m that counts as far from the singularity."""

SETTINGS: dict[str, dict[str, Any]] = {
    "reliability": {
        "target_urad": HOT_TARGET_URAD,
        **asdict(COILS),
        "thermal_resistance_k_per_w": COILS.thermal_resistance_k_per_w.tolist(),
        "warm_c": WARM_C,
        "heaviest_weight": HEAVIEST,
        "reweigh_ticks": REWEIGH_TICKS,
    },
    "stroke": {
        "target_urad": FAR_TARGET_URAD,
        "active_part_of_stroke": ACTIVE,
        "relax_s": RELAX_S,
        "longer_stroke": LONGER,
    },
    "obstacle": {
        "target_urad": OBSTRUCTED_TARGET_URAD,
        "gap_m": GAP_M,
        "radius_m": RADIUS_M,
        "safe_m": SAFE_M,
        "relax_s": RELAX_S,
        "locked_strut": LOCKED_STRUT,
    },
    "singularity": {
        "axis_deg": AXIS_DEG,
        "angle_rad": ANGLE_RAD,
        "gain_per_s": GAIN_PER_S,
        "fade_s": FADE_S,
        "locked_joints": SHOULDER,
    },
}


def joint_weights(temperature_c: Array) -> Array:
    """Diagonal of W1 for coils that are so hot, shape (6,): a smooth step from 1 to HEAVIEST."""
    return 1.0 + (HEAVIEST - 1.0) * smooth_step((temperature_c - WARM_C) / (LIMIT_C - WARM_C))


def rates_from_stops(displacements_m: Array, stroke_m: float) -> Array:
    """Desired strut rates (6,), [m]/[s], zero while no strut is near a stop.

    Down the gradient of half the squares of what struts (6,) stand beyond the active part of their
    stroke, over the time to come back; after Chaumette and Marchand (2000), reference [3] of the
    paper.
    """
    beyond = np.maximum(0.0, np.abs(displacements_m) - ACTIVE * stroke_m)
    return -np.sign(displacements_m) * beyond / RELAX_S


def cluttered() -> mujoco.MjModel:
    """The hexapod with a sphere beside its mirror cell; the two collide, as hard as the closures.

    The sphere stands on the world's y axis, as high as the cell's middle.
    """
    spec = mujoco.MjSpec.from_file(str(HEXAPOD_MJCF))
    cell = spec.geom("mirror_cell")
    middle = np.array(spec.body("payload").pos) + np.array(cell.pos)
    spec.worldbody.add_geom(
        name="obstacle",
        type=mujoco.mjtGeom.mjGEOM_SPHERE,
        size=[RADIUS_M, 0, 0],
        pos=middle + np.array([0, cell.size[0] + GAP_M + RADIUS_M, 0]),
        contype=1,
        conaffinity=1,
        condim=1,
        priority=1,
        solref=[2.5e-4, 1],
        solimp=[0.9999, 0.9999, 0.001, 0.5, 2],
    )
    cell.contype = cell.conaffinity = 1
    spec.option.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    return spec.compile()


class Clearance:
    """How far the payload is from the obstacle, and which way leads away, at any pose."""

    def __init__(self, model: mujoco.MjModel) -> None:
        """Take the machine of :func:`cluttered`."""
        self._model, self._data = model, mujoco.MjData(model)
        mujoco.mj_kinematics(model, self._data)
        self._to_world = self._data.site("base").xmat.reshape(3, 3).copy()
        self._joint = model.jnt_qposadr[model.joint("payload").id]
        self._obstacle, self._cell = model.geom("obstacle").id, model.geom("mirror_cell").id

    def __call__(self, pose: Pose) -> tuple[float, Array]:
        """Clearance [m], negative where they overlap, and the unit vector (3,) away, base axes."""
        turn = self._to_world @ pose.rotation @ self._to_world.T
        at = self._joint
        self._data.qpos[:] = self._model.qpos0
        self._data.qpos[at : at + 3] += self._to_world @ pose.translation_m
        mujoco.mju_mat2Quat(self._data.qpos[at + 3 : at + 7], turn.ravel())
        mujoco.mj_kinematics(self._model, self._data)
        nearest = np.zeros(6)  # on the obstacle, on the cell
        distance = mujoco.mj_geomDistance(
            self._model, self._data, self._obstacle, self._cell, _REACH_M, nearest
        )
        away = nearest[3:] - self._data.geom_xpos[self._obstacle]
        return distance, self._to_world.T @ (away / np.linalg.norm(away))


def retreat(clearance: Clearance, pose: Pose) -> Array:
    """Desired secondary velocity, v_sd of eq. (24): [t_x, t_y, t_z, gamma], shape (4,), base axes.

    Down the gradient, over translations, of half the square of what is missing to the safe
    clearance, divided by the time to come clear, [m]/[s]; no roll.
    """
    distance, away = clearance(pose)
    return np.append(max(0.0, SAFE_M - distance) / RELAX_S * away, 0.0)


def manipulability(axes: Array) -> float:
    """Yoshikawa's measure sqrt(det(J_m J_m^T)) of pointing, J_m the first two rows of `axes`.

    Args:
        axes: Directions of the joints in payload axes, from the base outwards, shape (3, n).
    """
    J_m = axes[:2]
    return float(np.sqrt(np.linalg.det(J_m @ J_m.T)))


def manipulability_gradient(axes: Array) -> Array:
    """Slope of :func:`manipulability` over the joint angles, shape (n,), for a serial arm.

    Seen from the payload, joint j turns the axes of all joints before it by -a_j x a_i, and none
    after it; with w the measure, dw = w tr(J_m^+ dJ_m).
    """
    J_m, n = axes[:2], axes.shape[1]
    turned = -np.cross(axes[:, :, None], axes[:, None, :], axis=0)[:2]  # (2, j, i)
    turned *= np.tri(n, k=-1)  # only axes i before joint j
    return manipulability(axes) * np.einsum("ir,rji->j", np.linalg.pinv(J_m), turned)


def rates_from_singularity(axes: Array, time_s: float) -> Array:
    """Desired joint rates, theta_ad of eq. (24), shape (n,), [rad]/[s]."""
    return GAIN_PER_S * smooth_step(time_s / FADE_S) * manipulability_gradient(axes)
