"""An arm with limited joints turns its camera along a long path; a joint locks halfway."""

from dataclasses import dataclass

import mujoco
import numpy as np

from experiments.limits.allocation import Strategy, allocated
from experiments.rig.arm import ARM_MJCF, POINTING, SECONDARY, camera_axes, smooth_step
from prioritized import ConstrainedSystem, viable_rates
from sim import Array, JacobianReader, advance, load_model

PERIOD_S = 0.02
GAIN_PER_S = 2.0
"""Of the pointing error."""
RANGE_RAD = 0.8
"""Each joint may turn as far from the nominal posture, either way [chosen]."""
RATE_RAD_PER_S = 0.6
ACCELERATION_RAD_PER_S2 = 5.0
"""And as fast, and change its rate so quickly [chosen]."""
TILT_RAD = 0.9
"""Of the line of sight, which circles about its first direction."""
TURN_S = 10.0
EASE_S = 5.0
"""In which the line of sight tilts, and at the end returns."""
LOCKED = 3
"""The elbow fails."""


@dataclass(frozen=True)
class ArmRun:
    """One long motion.

    Attributes:
        time_s: Shape (N,).
        error_rad: Angle between desired and true line of sight, shape (N,).
        joint_rad: Shape (N, 7).
    """

    time_s: Array
    error_rad: Array
    joint_rad: Array


def line_of_sight(time_s: Array, duration_s: float) -> Array:
    """Desired unit vectors in base axes, shape (N, 3)."""
    eased = smooth_step(time_s / EASE_S) * smooth_step((duration_s - time_s) / EASE_S)
    tilt, turned = TILT_RAD * eased, 2 * np.pi * time_s / TURN_S
    across = np.sin(tilt)
    return np.stack([across * np.cos(turned), across * np.sin(turned), np.cos(tilt)], axis=1)


@dataclass(frozen=True)
class Motion:
    """One motion of the arm."""

    strategy: Strategy
    duration_s: float


def move(motion: Motion) -> ArmRun:
    """Resolved rates with feedback, kinematically; the joint locks halfway, known at once."""
    model, strategy = load_model(ARM_MJCF), motion.strategy
    data = mujoco.MjData(model)
    reader = JacobianReader(model, site="payload", axes="payload")
    system = ConstrainedSystem.of(reader.at(data))
    time_s = np.arange(round(motion.duration_s / PERIOD_S) + 1) * PERIOD_S
    views = line_of_sight(time_s, motion.duration_s)
    reach = np.inf if strategy.allocation == "unlimited" else RANGE_RAD
    rates, kept = np.zeros(model.nv), []
    for k, now in enumerate(time_s[:-1]):
        if k == len(time_s) // 2:
            system = system.with_failures(locked=[LOCKED])
        kinematics = system.at(J_T=reader.at(data).J_T).kinematics()
        camera = camera_axes(data)
        off = _turn(camera[:, 2], views[k])
        ahead = np.cross(views[k], views[k + 1] - views[k]) / PERIOD_S
        pointing = (camera.T @ (GAIN_PER_S * off + ahead))[POINTING]
        box = viable_rates(
            data.qpos,
            rates,
            position_limits=(-reach, reach),
            rate_limits=(-RATE_RAD_PER_S, RATE_RAD_PER_S),
            acceleration_limits=(-ACCELERATION_RAD_PER_S2, ACCELERATION_RAD_PER_S2),
            period_s=PERIOD_S,
        )
        mapping = allocated(kinematics, strategy, (box.lower, box.upper), POINTING, SECONDARY)
        rates = kinematics.expand(mapping.solve(pointing).rates)
        kept.append((now, np.linalg.norm(off), data.qpos.copy()))
        data = advance(model, data, rates, PERIOD_S)
    return ArmRun(*map(np.array, zip(*kept, strict=True)))


def _turn(now: Array, desired: Array) -> Array:
    """The rotation vector from one unit vector to another, shape (3,)."""
    axis = np.cross(now, desired)
    sine = np.linalg.norm(axis)
    return axis * (np.arctan2(sine, now @ desired) / sine if sine > 0 else 1.0)
