"""Springs of the hexapod: of the whole mechanism, and as the strut mapping sees them."""

import mujoco
import numpy as np
import scipy.linalg

from prioritized import ConstrainedSystem
from sim import Array, element_id, jacobians, joint_stiffness


def strut_and_payload_stiffness(model: mujoco.MjModel) -> Array:
    """Stiffness over [six strut displacements; payload twist in base axes], shape (12, 12).

    The suspensions resist the struts; the flexures, all other springs, resist the payload. The
    library says how: with the payload as the active joint of the mechanism, the passive rates
    follow it.
    """
    data = mujoco.MjData(model)
    jac = jacobians(model, data, site="payload", axes="base")
    stiffness = joint_stiffness(model)
    suspension = stiffness[jac.active]
    flexures = stiffness.copy()
    flexures[jac.active] = 0.0

    free_joint = model.body_dofadr[element_id(model, "body", "payload")] + np.arange(6)
    kin = ConstrainedSystem(jac.J_T, jac.J_C, free_joint).kinematics()
    follow = kin.passive_gain @ np.linalg.inv(kin.J)  # passive rates per payload twist
    at_payload = follow.T @ (flexures[kin.passive, None] * follow)
    return scipy.linalg.block_diag(np.diag(suspension), at_payload)


def elastic_system(
    model: mujoco.MjModel, suspension: dict[int, float] | None = None
) -> ConstrainedSystem:
    """The whole mechanism with its springs, 42 velocities, at the nominal pose.

    Args:
        model: The hexapod.
        suspension: Stiffness of some struts' suspensions by strut 0..5, [N]/[m].
    """
    jac = jacobians(model, mujoco.MjData(model), site="payload", axes="base")
    stiffness = joint_stiffness(model)
    for strut, value in (suspension or {}).items():
        stiffness[jac.active[strut]] = value
    return ConstrainedSystem(jac.J_T, jac.J_C, jac.active, stiffness=stiffness)
