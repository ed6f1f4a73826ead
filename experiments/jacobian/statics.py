"""The mapping on the geometry alone: no inertia, no noise, struts that go where they are told."""

from dataclasses import dataclass

import numpy as np

from experiments.hexapod.goal import MAJOR, Goal
from experiments.hexapod.mapping import NOTHING_YET, Asked, StrutMapping
from sim import (
    NOMINAL,
    Array,
    Hexapod,
    Pose,
    forward_kinematics,
    pointing_angles,
    secondary_motion,
)

_MOST_STEPS = 20
_TICKS_A_POINT = 4
"""Enough to settle: each leaves a part e, eq. (40), of the error before."""


@dataclass(frozen=True)
class Visited:
    """Where a path leads.

    Attributes:
        strut_m: Strut displacements, shape (T, 6).
        pose: Of the payload, batch (T,).
    """

    strut_m: Array
    pose: Pose

    @property
    def pointing_rad(self) -> Array:
        """(alpha, beta), shape (T, 2)."""
        return pointing_angles(self.pose.rotation)

    @property
    def secondary(self) -> Array:
        """[gamma_rad, t_x_m, t_y_m, t_z_m], shape (T, 4)."""
        return secondary_motion(self.pose.rotation, self.pose.translation_m)


def follow(mapping: StrutMapping, desired_rad: Array) -> Visited:
    """The path of a pointing loop that settles at every point.

    Args:
        mapping: With the Jacobian and the form that are asked about.
        desired_rad: (alpha, beta), shape (T, 2).
    """
    pose, pointing, last = NOMINAL, np.zeros(2), NOTHING_YET
    visited = []
    for desired in desired_rad:
        for _ in range(_TICKS_A_POINT):
            pointing = pointing + desired - pointing_angles(pose.rotation)
            wanted_m = mapping.displacements(pointing, pose, last.displacements_m, last)
            last = Asked(pointing, wanted_m, last.rest_m)
            pose = forward_kinematics(mapping.geometry, wanted_m, start=pose)
        visited.append(last.displacements_m)
    return visit(mapping.geometry, np.array(visited))


def visit(geometry: Hexapod, strut_m: Array) -> Visited:
    """Poses at strut displacements (T, 6)."""
    return Visited(strut_m, forward_kinematics(geometry, strut_m))


def optimum(geometry: Hexapod, goal: Goal, pointing_rad: Array) -> Visited:
    """The strut displacements that point exactly and meet the goal best, curvature and all.

    Minimizes |W1 l|^2 + |W2 s|^2 over all poses that point as asked, s as :func:`secondary_motion`:
    Gauss-Newton, each step the mapping at the present pose.

    Args:
        geometry: The hexapod.
        goal: Weights, and struts locked at their centres.
        pointing_rad: (alpha, beta), shape (T, 2).

    Raises:
        RuntimeError: It does not converge.
    """
    mapping = StrutMapping(geometry, goal, "analytic", form="relinearized")
    strut_m, pose, best = np.zeros(6), NOMINAL, []
    for pointing in pointing_rad:
        for _ in range(_MOST_STEPS):
            change_m = mapping.displacements(pointing, pose, strut_m) - strut_m
            strut_m = strut_m + change_m
            pose = forward_kinematics(geometry, strut_m, start=pose)
            if np.abs(change_m).max() < 1e-13:
                break
        else:
            raise RuntimeError(f"no optimum found at (alpha, beta) = {pointing} rad")
        best.append(strut_m)
    return visit(geometry, np.array(best))


def goal_vector(goal: Goal, strut_m: Array, secondary: Array) -> Array:
    """What the goal keeps small: [W1 l; W2 s], shape (T, 10)."""
    w1 = np.zeros(6) if goal.joint_weight is None else np.array(goal.joint_weight)
    w2 = np.zeros(4) if goal.secondary_weight is None else np.array(goal.secondary_weight)
    return np.hstack([w1 * strut_m, w2 * secondary[:, [1, 2, 3, 0]]])


def extra_percent(goal: Goal, visited: tuple[Array, Array], best: Visited) -> float:
    """How far a run is from the optimum, RMS over it, in percent of what the optimum costs.

    Args:
        goal: What was to be kept small.
        visited: Strut displacements (T, 6) and secondary motion (T, 4).
        best: The optimum at the same pointing.
    """
    least = goal_vector(goal, best.strut_m, best.secondary)
    return 100 * float(np.linalg.norm(goal_vector(goal, *visited) - least) / np.linalg.norm(least))


def loop_gain_error(mapping: StrutMapping, strut_m: Array) -> float:
    """Largest ||J_m(l) M - I|| over strut displacements (T, 6), M the constant mapping."""
    pose = forward_kinematics(mapping.geometry, strut_m)
    J_m = np.linalg.inv(mapping.geometry.inverse_jacobian(pose))[:, MAJOR]
    off = J_m @ mapping.pointing_gain() - np.eye(2)
    return float(np.linalg.norm(off, 2, axis=(-2, -1)).max())
