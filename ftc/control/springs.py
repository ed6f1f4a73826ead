"""Springs of a mechanism for the mapping: on its actuators, and on its payload."""

import numpy as np
import scipy.linalg

from argument_checks import Array, Indices
from prioritized import ConstrainedSystem


def actuator_and_payload_stiffness(
    J_T: Array, J_C: Array, active: Indices, payload: Indices, stiffness: Array
) -> Array:
    """Stiffness over [n actuator displacements; payload twist], shape (n + m, n + m).

    The springs of the actuated joints resist the actuators; all others resist the payload, whose
    twist the other joints follow.

    Args:
        J_T: Twist of the payload per velocity, shape (m, N).
        J_C: Constraint Jacobian of the closed loops, shape (c, N).
        active: Velocity index of each actuator, shape (n,).
        payload: Velocity indices that move the payload alone, shape (m,).
        stiffness: Of each joint's spring, shape (N,).
    """
    others = stiffness.copy()
    others[active] = 0.0
    # With the payload as the active joint of the mechanism, the passive rates follow it.
    kin = ConstrainedSystem(J_T, J_C, payload).kinematics()
    follow = kin.passive_gain @ np.linalg.inv(kin.J)  # passive rates per payload twist
    at_payload = follow.T @ (others[kin.passive, None] * follow)
    return scipy.linalg.block_diag(np.diag(stiffness[active]), at_payload)
