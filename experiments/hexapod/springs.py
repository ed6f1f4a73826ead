"""Springs of the hexapod: of the whole mechanism, and as the strut mapping sees them."""

import mujoco
import numpy as np

from ftc.springs import actuator_and_payload_stiffness
from prioritized import ConstrainedSystem
from sim import Array, element_id, jacobians, joint_stiffness


def strut_and_payload_stiffness(model: mujoco.MjModel) -> Array:
    """Stiffness over [six strut displacements; payload twist in base axes], shape (12, 12).

    The suspensions resist the struts; the flexures, all other springs, resist the payload.
    """
    jac = jacobians(model, mujoco.MjData(model), site="payload", axes="base")
    free_joint = model.body_dofadr[element_id(model, "body", "payload")] + np.arange(6)
    return actuator_and_payload_stiffness(
        jac.J_T, jac.J_C, jac.active, free_joint, joint_stiffness(model)
    )


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
