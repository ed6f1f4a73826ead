"""Constraint forces of a mechanism, eqs. (9), (11) and (13), stuck joints and springs included."""

import numpy as np

from argument_checks import Array, Indices
from prioritized._elimination import Partition, PassiveMotion
from prioritized._rank import RankedSvd


def internal_force(system: Partition, motion: PassiveMotion) -> Array:
    """Orthonormal rows that span the left null space of [J_Cp; E], eq. (13), shape (r, c + s)."""
    rows = _internal_rows(system, motion)
    return np.linalg.qr(rows.T)[0].T if system.joints.stuck.size else rows.copy()


def _internal_rows(system: Partition, motion: PassiveMotion) -> Array:
    """Rows that span it: those without E, with the reactions that balance the stuck joints."""
    left = motion.loops.left_null
    return np.hstack([left, -left @ system.J_C[:, system.joints.stuck]])


def constraint_gain(system: Partition, motion: PassiveMotion, internal_force: Array) -> Array:
    """Constraint forces per task force, eq. (11), orthogonal to `internal_force`, (c + s, m)."""
    stuck = system.joints.stuck
    f_C = -motion.closing.T @ system.task.moving.T
    # A stuck joint's reaction balances the task force, f_C and the springs on it, eq. (9).
    reaction = -system.task.J_T[:, stuck].T - system.J_C[:, stuck].T @ f_C
    reaction += _spring_load(system, motion, stuck)
    gain = np.vstack([f_C, reaction])
    return gain - internal_force.T @ (internal_force @ gain)


def torque_gain(system: Partition, motion: PassiveMotion, constraint_gain: Array) -> Array:
    """Torques in equilibrium with a task force and its constraint forces, shape (n - q, m)."""
    active, f_C = system.joints.active, constraint_gain[: len(system.J_C)]
    torques = system.task.active.T + system.J_C[:, active].T @ f_C
    return torques - _spring_load(system, motion, active)


def internal_gain(
    system: Partition, motion: PassiveMotion, internal_force: Array, constraint: RankedSvd
) -> Array:
    """Internal force eta per torque that is out of equilibrium without it, shape (r, n - q)."""
    rows = _internal_rows(system, motion)
    return internal_force @ rows.T @ constraint.pseudo_inverse().T


def _spring_load(system: Partition, motion: PassiveMotion, locked: Indices) -> Array:
    """Load on locked joints from springs to the joints that a task force moves, per task force."""
    task, stiffness = system.task, system.stiffness
    if stiffness is None:
        return np.zeros((len(locked), len(task.J_T)))
    stretch = motion.compliance @ task.moving.T
    return stiffness[np.ix_(locked, system.joints.moving)] @ stretch
