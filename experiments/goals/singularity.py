"""A singularity of the serial arm: desired joint rates along the gradient of manipulability."""

import numpy as np

from experiments.goals.arm import LOOP_GAIN_PER_S, PERIOD_S, TRACKER_NOISE_RAD, sweep
from experiments.goals.demonstration import Demonstration, Outcome, Way, smooth_step
from experiments.hexapod.compensator import Loop
from sim import Array

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


def goal_rates(axes: Array, time_s: float) -> Array:
    """Desired joint rates, theta_ad of eq. (24), shape (n,), [rad]/[s]."""
    return GAIN_PER_S * smooth_step(time_s / FADE_S) * manipulability_gradient(axes)


def no_rates(axes: Array, time_s: float) -> Array:
    """No secondary goal."""
    return np.zeros(axes.shape[1])


def run(way: Way, duration_s: float, loops: tuple[Loop, Loop]) -> Outcome:
    """One sweep of the camera."""
    return sweep(
        axis_rad=np.deg2rad(AXIS_DEG),
        angle_rad=ANGLE_RAD,
        duration_s=duration_s,
        locked=SHOULDER if way.limited else (),
        rates=goal_rates if way.pursues else no_rates,
        major_weight=way.major_weight,
        seed=way.seed,
    )


DEMONSTRATION = Demonstration(
    name="singularity",
    title="A singularity of the serial arm",
    machine="arm",
    angles=("along", "across"),
    measure="condition_number",
    limit=CONDITION,
    keeps_below=True,
    judged_from_s=0.0,
    duration_s=12.0,
    quick_duration_s=8.0,
    settings={
        "axis_deg": AXIS_DEG,
        "angle_rad": ANGLE_RAD,
        "gain_per_s": GAIN_PER_S,
        "fade_s": FADE_S,
        "locked_joints": SHOULDER,
        "period_s": PERIOD_S,
        "loop_gain_per_s": LOOP_GAIN_PER_S,
        "tracker_noise_rad": TRACKER_NOISE_RAD,
    },
    run=run,
)
