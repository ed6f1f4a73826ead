"""Cost of the hexapod's curved geometry for a goal, without dynamics and noise."""

from dataclasses import dataclass

import numpy as np

from fjh.rig.hexapod.closed_form import Hexapod
from fjh.rig.hexapod.columns import MAJOR
from fjh.rig.hexapod.controller import NO_COMMAND, StrutMapping
from fjh.rig.hexapod.detector import pointing_angles, secondary_motion
from fjh.rig.hexapod.forward import forward_kinematics
from ftc import Goal
from ftc.control import PreviousCommand
from sim import NOMINAL, Array

MOST_STEPS = 20  # of Gauss-Newton
TICKS_A_POINT = 4  # enough to settle: each reduces the error to its fraction e of eq. (40)


@dataclass(frozen=True)
class Visited:
    """Strut displacements (T, 6), (alpha, beta) (T, 2) and secondary motion (T, 4) of a path."""

    strut_m: Array
    pointing_rad: Array
    secondary: Array


def visit(geometry: Hexapod, strut_m: Array) -> Visited:
    """Return pointing and secondary motion at strut displacements (T, 6)."""
    pose = forward_kinematics(geometry, strut_m)
    secondary = secondary_motion(pose.rotation, pose.translation_m)
    return Visited(strut_m, pointing_angles(pose.rotation), secondary)


def follow(mapping: StrutMapping, desired_rad: Array) -> Visited:
    """Return the path of a pointing loop that settles at every desired (alpha, beta), (T, 2)."""
    pose, pointing, last = NOMINAL, np.zeros(2), NO_COMMAND
    visited_m = []
    for desired in desired_rad:
        for _ in range(TICKS_A_POINT):
            pointing = pointing + desired - pointing_angles(pose.rotation)
            commanded_m = mapping.displacements(pointing, pose, last.displacements, last)
            last = PreviousCommand(pointing, commanded_m, last.secondary_reference)
            pose = forward_kinematics(mapping.geometry, commanded_m, start=pose)
        visited_m.append(last.displacements)
    return visit(mapping.geometry, np.array(visited_m))


def optimum(geometry: Hexapod, goal: Goal, pointing_rad: Array) -> Visited:
    """Return the strut displacements with exact pointing and least cost, curvature included.

    Minimizes |W1 l|^2 + |W2 s|^2, with displacements l and secondary motion s, over all poses with
    this pointing (T, 2), by Gauss-Newton steps, each of which is the mapping at the present pose.

    Raises:
        RuntimeError: The iteration does not converge.
    """
    mapping = StrutMapping(geometry, goal, "analytic", form="gauss_newton")
    strut_m, pose, best_m = np.zeros(6), NOMINAL, []
    for pointing in pointing_rad:
        for _ in range(MOST_STEPS):
            change_m = mapping.displacements(pointing, pose, strut_m) - strut_m
            strut_m = strut_m + change_m
            pose = forward_kinematics(geometry, strut_m, start=pose)
            if np.abs(change_m).max() < 1e-13:
                break
        else:
            raise RuntimeError(f"no optimum found at (alpha, beta) = {pointing} rad")
        best_m.append(strut_m)
    return visit(geometry, np.array(best_m))


def goal_vector(goal: Goal, visited: Visited) -> Array:
    """Return the cost vector of a goal: [W1 l; W2 s], shape (T, 10)."""
    w1 = np.zeros(6) if goal.joint_weight is None else np.array(goal.joint_weight)
    w2 = np.zeros(4) if goal.secondary_weight is None else np.array(goal.secondary_weight)
    return np.hstack([w1 * visited.strut_m, w2 * visited.secondary[:, [1, 2, 3, 0]]])


def extra_percent(geometry: Hexapod, goal: Goal, visited: Visited) -> float:
    """Return a path's RMS distance from the optimum of equal pointing, in % of its cost."""
    least = goal_vector(goal, optimum(geometry, goal, visited.pointing_rad))
    return 100 * float(np.linalg.norm(goal_vector(goal, visited) - least) / np.linalg.norm(least))


def loop_gain_error(mapping: StrutMapping, strut_m: Array) -> float:
    """Return the largest ||J_m(l) M - I|| over displacements (T, 6), M the constant mapping."""
    pose = forward_kinematics(mapping.geometry, strut_m)
    J_m = np.linalg.inv(mapping.geometry.inverse_jacobian(pose))[:, MAJOR]
    off = J_m @ mapping.major_gain() - np.eye(2)
    return float(np.linalg.norm(off, 2, axis=(-2, -1)).max())
