"""Constraint forces, eqs. (9), (11), (13), with stuck joints and springs, in natural units."""

import numpy as np

from argument_checks import Array, Indices
from prioritized._mechanism.elimination import Partition, PassiveMotion


def internal_rows(system: Partition, motion: PassiveMotion) -> Array:
    """Return rows that span the left null space of [J_Cp; E], eq. (13), shape (r, c + s)."""
    null = motion.left_null  # the reactions of stuck joints balance it
    return np.hstack([null, -null @ system.J_C[:, system.joints.stuck]])


def constraint_gain(system: Partition, motion: PassiveMotion, internal_force: Array) -> Array:
    """Return constraint forces per task force, eq. (11), (c + s, m), without internal ones."""
    stuck = system.joints.stuck
    f_C = -motion.closing.T @ system.J_T[:, system.joints.moving].T
    # A stuck joint's reaction balances the task force, f_C and the springs on it, eq. (9).
    reaction = -system.J_T[:, stuck].T - system.J_C[:, stuck].T @ f_C
    reaction += _spring_load(system, motion, stuck)
    gain = np.vstack([f_C, reaction])
    return gain - internal_force.T @ (internal_force @ gain)


def torque_gain(system: Partition, motion: PassiveMotion, constraint_gain: Array) -> Array:
    """Return torques in equilibrium with a task force and its constraint forces, (n - q, m)."""
    active, f_C = system.joints.active, constraint_gain[: len(system.J_C)]
    torques = system.J_T[:, active].T + system.J_C[:, active].T @ f_C
    return torques - _spring_load(system, motion, active)


def _spring_load(system: Partition, motion: PassiveMotion, locked: Indices) -> Array:
    """Return the spring load on locked joints per task force, which moves other joints."""
    moving, stiffness = system.joints.moving, system.stiffness
    if stiffness is None:
        return np.zeros((len(locked), len(system.J_T)))
    return stiffness[np.ix_(locked, moving)] @ (motion.compliance @ system.J_T[:, moving].T)
