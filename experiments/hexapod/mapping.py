"""The hexapod's mapping from demanded pointing to strut displacements: :mod:`ftc.mapping` on it."""

import numpy as np

from experiments.hexapod.choices import JacobianChoice
from experiments.hexapod.columns import MAJOR, SECONDARY
from ftc.goal import Goal
from ftc.mapping import Asked as Asked  # lead: remove
from ftc.mapping import DisplacementForm, PrioritizedMapping
from ftc.mapping import Mapping as Mapping  # lead: remove
from ftc.mapping import Reconfigured as Reconfigured  # lead: remove
from prioritized import ConstrainedSystem
from sim import NOMINAL, Array, Hexapod, Pose, Posture, pointing_angles, secondary_motion

NOTHING_YET = Asked(np.zeros(2), np.zeros(6), np.zeros(6))


class HexapodGeometry:
    """The closed-form geometry of the sound hexapod, as :class:`ftc.mapping.Geometry`."""

    def __init__(self, hexapod: Hexapod, *, constant: bool, stiffness: Array | None) -> None:
        """Take the nodes; `constant` evaluates the Jacobian at the nominal pose alone.

        `stiffness`, over [struts; payload twist], determines where a free strut goes.
        """
        self.hexapod, self.constant = hexapod, constant
        self.nominal = hexapod.posture(NOMINAL)
        # Struts and payload, theta_dot = [l_dot; x_dot]: l_dot = A x_dot.
        self.system = ConstrainedSystem(
            J_T=np.hstack([np.zeros((6, 6)), np.eye(6)]),
            J_C=np.hstack([np.eye(6), -self.nominal.inverse_jacobian]),
            active=np.arange(6),
            stiffness=stiffness,
        )

    def posture(self, pose: Pose) -> Posture:
        """The pose with its struts, or the nominal one."""
        return self.nominal if self.constant else self.hexapod.posture(pose)

    def jacobian(self, posture: Pose) -> Array:
        """A in l_dot = A x_dot, shape (6, 6)."""
        return self.hexapod.inverse_jacobian(posture)

    def placed(self, system: ConstrainedSystem, jacobian: Array) -> ConstrainedSystem:
        """The system where l_dot = A x_dot."""
        J_C = system.J_C.copy()
        J_C[:, 6:] = -jacobian
        return system.at(J_C=J_C)

    def twist(self, posture: Pose, displacements_m: Array) -> Array:
        """Payload twist (6,) of small strut displacements (6,)."""
        return self.hexapod.posture(posture).twist(displacements_m)

    def moved(self, pose: Pose, displacements_m: Array) -> Pose:
        """The pose to which strut displacements (6,) lead, from the pose one tick before.

        One Newton step on the strut lengths; a tick moves so little that it lands within round-off.
        With the present Jacobian the pose comes with its struts, which the mapping and the next
        estimate need.
        """
        if self.constant:
            return NOMINAL.moved(self.nominal.twist(displacements_m))
        posture = self.hexapod.posture(pose)
        moved = pose.moved(posture.twist(displacements_m - posture.displacement_m))
        return self.hexapod.posture(moved)


def task_coordinates(pose: Pose) -> Array:
    """[alpha, beta, gamma, t_x, t_y, t_z] of a pose, shape (6,)."""
    secondary = secondary_motion(pose.rotation, pose.translation_m)
    return np.concatenate([pointing_angles(pose.rotation), secondary])


class StrutMapping(PrioritizedMapping[Pose]):
    """Optimal strut displacements for demanded (alpha, beta), eqs. (28) and (30)."""

    def __init__(
        self,
        geometry: Hexapod,
        goal: Goal,
        jacobian: JacobianChoice,
        stiffness: Array | None = None,
        form: DisplacementForm = "absolute",
    ) -> None:
        """Prepare the mapping at the nominal pose; "analytic" re-evaluates it at every call.

        `stiffness`, over [struts; payload twist], determines where a free strut goes.

        Raises:
            ValueError: Free or loose struts without stiffness: an unstable singularity. A strut
                locked off centre in incremental form: its displacement is in no increment.
        """
        self.geometry = geometry
        self.jacobian = jacobian
        if stiffness is None and (goal.free or goal.loose):
            raise ValueError(
                "stiffness must be given for a goal with free or loose struts, got None"
            )
        own = HexapodGeometry(geometry, constant=jacobian == "constant", stiffness=stiffness)
        super().__init__(own, goal, MAJOR, SECONDARY, form, task_coordinates)
