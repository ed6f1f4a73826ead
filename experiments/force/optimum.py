"""How good a torque can be, from eqs. (8) and (9) themselves: nothing of them is eliminated.

Independent of the library's elimination, mapping and rank decision.
"""

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from experiments.force.aims import ForceGoal
from experiments.rig.hexapod.columns import MAJOR, SECONDARY
from prioritized import ConstrainedSystem
from sim import Array


@dataclass(frozen=True)
class Statics:
    """Every force [f; f_C] that a failed mechanism can be in equilibrium with, at a major force.

    Attributes:
        start: One of them for each major force, shape (D, 6 + c).
        free: What may be added to it, orthonormal columns, shape (6 + c, d).
        to_torques: Torques of all actuators, zero at failed ones, per force, shape (n, 6 + c).
        to_secondary: Secondary force, shape (4, 6 + c).
    """

    start: Array
    free: Array
    to_torques: Array
    to_secondary: Array


def statics(system: ConstrainedSystem, major: Array) -> Statics:
    """All equilibria with the given major forces (D, 2)."""
    balance = np.vstack([system.J_T, system.J_C]).T  # velocities x [f; f_C]
    failures = system.failures
    failed = sorted(failures.locked | failures.free)
    # A lock bears whatever comes on its joint; every other passive joint bears nothing.
    driven = np.delete(system.active, failed)
    bears_nothing = np.setdiff1d(np.arange(len(balance)), [*driven, *system.stuck])
    to_f = np.eye(6, balance.shape[1])
    conditions = np.vstack([balance[bears_nothing], to_f[MAJOR]])
    asked = np.hstack([np.zeros((len(major), len(bears_nothing))), major])
    to_torques = balance[system.active].copy()
    to_torques[failed] = 0.0
    return Statics(
        start=np.linalg.lstsq(conditions, asked.T)[0].T,
        free=scipy.linalg.null_space(conditions),
        to_torques=to_torques,
        to_secondary=to_f[SECONDARY],
    )


def weighed(goal: ForceGoal, torques: Array, secondary: Array) -> Array:
    """W3 torques over W4 f_s, of (D, 6) and (D, 4), shape (D, 10)."""
    W3, W4 = (
        np.zeros(size) if weight is None else np.array(weight)
        for weight, size in ((goal.torque_weight, 6), (goal.secondary_weight, 4))
    )
    return np.hstack([torques * W3, secondary * W4])


def cost(goal: ForceGoal, torques: Array, secondary: Array, desired: Array) -> Array:
    """|W3 torques|^2 + |W4 (f_s - f_sd)|^2 of Problem 6, no torque being desired, shape (D,)."""
    return (weighed(goal, torques, secondary - desired) ** 2).sum(axis=1)


def least_cost(goal: ForceGoal, all_forces: Statics, desired: Array) -> Array:
    """The least that any equilibrium costs, shape (D,)."""
    A = weighed(
        goal,
        (all_forces.to_torques @ all_forces.free).T,
        (all_forces.to_secondary @ all_forces.free).T,
    ).T
    torques = all_forces.start @ all_forces.to_torques.T
    secondary = all_forces.start @ all_forces.to_secondary.T - desired
    off = weighed(goal, torques, secondary).T
    best = np.linalg.lstsq(A, -off)[0]
    return ((A @ best + off) ** 2).sum(axis=0)
