"""The arm of `models/arm.xml` that points a camera: task rows, axes, smooth motion."""

import mujoco
import numpy as np

from sim import HEXAPOD_MJCF, Array

ARM_MJCF = HEXAPOD_MJCF.with_name("arm.xml")
POINTING, SECONDARY = [0, 1], [2, 3, 4, 5]
"""Task rows in payload axes: rotations of the camera across its line of sight, and the others."""


def camera_axes(data: mujoco.MjData) -> Array:
    """Return the camera's axes as columns in base axes, (3, 3); the last is the line of sight."""
    base, payload = (data.site(name).xmat.reshape(3, 3) for name in ("base", "payload"))
    return base.T @ payload


def smooth_step(progress: Array | float) -> Array:
    """Return the minimum-jerk step from 0 to 1 for progress from 0 to 1; constant outside."""
    s = np.clip(progress, 0.0, 1.0)
    return s**3 * (10 - 15 * s + 6 * s**2)
