"""Problem 6: the forces that are asked for, what is to be least, and the least that it can be.

The optimum is computed from eqs. (8) and (9) themselves, of which nothing is eliminated:
independent of the library's elimination, mapping and rank decision.
"""

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from experiments.rig.hexapod.columns import MAJOR, SECONDARY
from prioritized import ConstrainedSystem
from sim import Array


@dataclass(frozen=True)
class ForceGoal:
    """One of the three cases of Problem 6, by the theorem that solves it without failures."""

    theorem: int
    torque_weight: tuple[float, ...] | None  # W3, diagonal over the struts, [1]/[N]; None is zero
    secondary_weight: tuple[float, ...] | None  # W4, of [f_x, f_y, f_z, m_z], [1]/[N], [1]/[N m]

    def __str__(self) -> str:
        return f"theorem {self.theorem}"


SPARING = (2.0, 1.0, 2.0, 1.0, 2.0, 1.0)
"""W3: struts 1, 3 and 5 are hot, as under the paper's W_b. With W3 = I nothing would be traded: in
the orthogonal hexapod the least torque exerts no secondary force at all."""

LEVERED = (1.0, 1.0, 1.0, 3.0)
"""W4: a moment counts as the force that makes it at the nodes, 0.33 m from the axis."""

LEAST_TORQUE, PRESCRIBED = ForceGoal(8, SPARING, None), ForceGoal(9, None, LEVERED)
GOALS = (ForceGoal(7, SPARING, LEVERED), LEAST_TORQUE, PRESCRIBED)


@dataclass(frozen=True)
class Aims:
    """Forces asked for, one a row."""

    major: Array  # moments about x_b and y_b, (D, 2), [N m]
    secondary: Array  # [f_x, f_y, f_z, m_z], (D, 4), [N] and [N m]

    @property
    def wrench(self) -> Array:
        """All of it as [moment; force], shape (D, 6)."""
        return as_wrench(self.major, self.secondary)


def as_wrench(major: Array, secondary: Array) -> Array:
    """[moment; force] (D, 6) of its major and secondary parts."""
    wrench = np.empty((len(major), 6))
    wrench[:, MAJOR], wrench[:, SECONDARY] = major, secondary
    return wrench


MAJOR_N_M, FORCE_N, TWIST_N_M = 3.0, 20.0, 2.0
"""Sizes of the major moment, the secondary force, and (at most) the moment about z_b: together they
ask for up to some 20 N of a coil, which has 80."""


def draw_aims(rng: np.random.Generator, count: int) -> Aims:
    """Random directions."""
    angle = rng.uniform(0, 2 * np.pi, count)
    force = rng.normal(size=(count, 3))
    force *= FORCE_N / np.linalg.norm(force, axis=1, keepdims=True)
    twist = rng.uniform(-TWIST_N_M, TWIST_N_M, (count, 1))
    major = MAJOR_N_M * np.column_stack([np.cos(angle), np.sin(angle)])
    return Aims(major=major, secondary=np.hstack([force, twist]))


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
