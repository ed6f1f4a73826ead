"""Constraint forces of a mechanism, eqs. (9), (11) and (13), stuck joints and springs included."""

from typing import NamedTuple

import numpy as np

from argument_checks import Array, Indices
from prioritized._arrays import read_only
from prioritized._elimination import Joints, PassiveMotion, Task


class ConstraintForces(NamedTuple):
    """Constraint forces of least norm per task force, and the torques in equilibrium with them.

    Attributes:
        gain: For the c rows of J_C and then for the s stuck joints, shape (c + s, m).
        torques: Shape (n - q, m).
    """

    gain: Array
    torques: Array


def internal_force_rows(J_C: Array, joints: Joints, motion: PassiveMotion) -> Array:
    """Rows (r, c + s) that span the left null space of [J_C; E] without its active columns."""
    left = motion.loops.left_null
    return np.hstack([left, -left @ J_C[:, joints.stuck]])  # E balances the stuck joints


def constraint_forces(
    task: Task,
    J_C: Array,
    joints: Joints,
    stiffness: Array | None,
    motion: PassiveMotion,
    internal_force: Array,
) -> ConstraintForces:
    """Eq. (11) without its internal force, of which `internal_force` has orthonormal rows."""
    stuck, active = joints.stuck, joints.active

    def spring_load(locked: Indices) -> Array:
        """Load on locked joints from springs to the joints that a task force moves."""
        if stiffness is None:
            return np.zeros((len(locked), len(task.J_T)))
        stretch = motion.compliance @ task.moving.T
        return stiffness[np.ix_(locked, joints.moving)] @ stretch

    f_C = -motion.closing.T @ task.moving.T
    # A stuck joint's reaction balances the task force, f_C and the springs on it, eq. (9).
    reaction = -task.J_T[:, stuck].T - J_C[:, stuck].T @ f_C
    reaction += spring_load(stuck)
    gain = np.vstack([f_C, reaction])
    gain = gain - internal_force.T @ (internal_force @ gain)
    torques = task.active.T + J_C[:, active].T @ gain[: len(J_C)]
    return ConstraintForces(read_only(gain), torques - spring_load(active))
