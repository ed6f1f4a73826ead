"""One tick by the general path: for any MJCF, nothing in closed form."""

from dataclasses import dataclass

import mujoco

from experiments.benchmark.case import GOAL, STUCK
from experiments.hexapod.goal import MAJOR, SECONDARY
from prioritized import ConstrainedSystem, VelocityMapping
from sim import Array, jacobians


@dataclass(frozen=True)
class GeneralTick:
    """The library as a client with a robot of its own calls it.

    Attributes:
        model: The machine.
        data: Where its kinematics are computed.
        system: The machine at its nominal pose, strut 1 locked.
        mapping: Task and weights, prepared there.
    """

    model: mujoco.MjModel
    data: mujoco.MjData
    system: ConstrainedSystem
    mapping: VelocityMapping

    def displacements(self, pointing_rad: Array, qpos: Array) -> Array:
        """Actuator displacements (n,) for desired (alpha, beta) at joint positions (nq,)."""
        self.data.qpos[:] = qpos
        jac = jacobians(self.model, self.data, site="payload", axes="base")
        kinematics = self.system.at(J_T=jac.J_T, J_C=jac.J_C).kinematics()
        return kinematics.expand(self.mapping.at(kinematics)(pointing_rad))


def general_tick(model: mujoco.MjModel) -> GeneralTick:
    """What is computed once, before the first tick."""
    data = mujoco.MjData(model)
    jac = jacobians(model, data, site="payload", axes="base")
    system = ConstrainedSystem(jac.J_T, jac.J_C, jac.active).with_failures(locked=[STUCK])
    mapping = system.kinematics().velocity_mapping(
        MAJOR, SECONDARY, GOAL.joint_weight, GOAL.secondary_weight
    )
    return GeneralTick(model, data, system, mapping)
