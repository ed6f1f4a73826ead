"""The arm of `models/arm.xml`, whose camera points: its task rows, its axes, and eased motion."""

import mujoco
import numpy as np

from sim import HEXAPOD_MJCF, Array

ARM_MJCF = HEXAPOD_MJCF.with_name("arm.xml")
POINTING, SECONDARY = [0, 1], [2, 3, 4, 5]
"""Task rows in payload axes: turns of the camera across its line of sight, and the rest."""


def camera_axes(data: mujoco.MjData) -> Array:
    """Axes of the camera in those of the base, shape (3, 3); the line of sight is the last."""
    base, payload = (data.site(name).xmat.reshape(3, 3) for name in ("base", "payload"))
    return base.T @ payload


def smooth_step(progress: Array | float) -> Array:
    """From 0 to 1 with the least jerk, as progress goes from 0 to 1; constant outside."""
    s = np.clip(progress, 0.0, 1.0)
    return s**3 * (10 - 15 * s + 6 * s**2)
