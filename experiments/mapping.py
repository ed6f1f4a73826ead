"""From desired pointing to strut displacements: the mapping block of Fig. 3, and its pose estimate.

Displacements are absolute, from the nominal pose: eq. (41) taken whole. Its incremental form drifts
when J is re-evaluated; docs/jacobian.md compares the forms.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from experiments.choices import JacobianChoice
from experiments.goal import MAJOR, SECONDARY, Goal
from prioritized import ConstrainedSystem, VelocityMapping
from sim import NOMINAL, Array, Hexapod, Pose, pointing_angles, secondary_motion

DisplacementForm = Literal["absolute", "incremental", "relinearized"]
"""How eq. (41) becomes a displacement: from the nominal pose; from what was asked for a tick
before; or, from where the struts are, one Gauss-Newton step towards the optimum of the curved
problem."""


@dataclass(frozen=True)
class Asked:
    """What the incremental form goes on from.

    Attributes:
        pointing_rad: (alpha, beta) last asked of the mapping.
        displacements_m: Strut displacements that it answered, before the converters, shape (6,).
        rest_m: Desired strut displacements last asked of it, shape (6,).
    """

    pointing_rad: Array
    displacements_m: Array
    rest_m: Array


NOTHING_YET = Asked(np.zeros(2), np.zeros(6), np.zeros(6))


@dataclass(frozen=True)
class Reconfigured:
    """The mapping at one pose, section 2.3.

    Attributes:
        mapping: Rates of the surviving struts, eqs. (28) and (30).
        expand: Puts them on the six struts, shape (6, n').
        J: Twist per surviving strut rate, eq. (14), shape (6, n').
    """

    mapping: VelocityMapping
    expand: Array
    J: Array


class StrutMapping:
    """Optimal strut displacements for desired (alpha, beta), eqs. (28) and (30).

    Its model of the machine is its own: the closed-form geometry of the sound hexapod, with the
    struts that it was told have failed reconfigured as in section 2.3.
    """

    def __init__(
        self,
        geometry: Hexapod,
        goal: Goal,
        jacobian: JacobianChoice,
        stiffness: Array | None = None,
        form: DisplacementForm = "absolute",
    ) -> None:
        """Prepare the mapping at the nominal pose; "analytic" re-evaluates it at every call.

        `stiffness`, over [struts; payload twist], says where a free strut goes.

        Raises:
            ValueError: Free or loose struts without stiffness: an unstable singularity. A strut
                locked off centre in incremental form: no increment tells of its displacement.
        """
        if form == "incremental" and any(goal.locked_m.values()):
            raise ValueError(
                f'form must be "absolute" or "relinearized" with a strut locked off centre, '
                f"got {form} with locked_m = {goal.locked_m}"
            )
        self.geometry = geometry
        self.goal = goal
        self.jacobian = jacobian
        self.form = form
        if stiffness is None and (goal.free or goal.loose):
            raise ValueError(
                "stiffness must be given for a goal with free or loose struts, got None"
            )
        self._stiffness = None if stiffness is None else stiffness.copy()
        if self._stiffness is not None:
            self._stiffness[list(goal.loose), list(goal.loose)] = 0.0
        self._A_0 = geometry.inverse_jacobian(NOMINAL)
        self._at_nominal = self.at(self._A_0)
        self._locked_m = np.zeros(len(self._A_0))
        for strut, displacement in goal.locked_m.items():
            self._locked_m[strut] = displacement
        self._follow = self._free_struts_follow()

    def pointing_gain(self) -> Array:
        """Strut displacements per commanded (alpha, beta) at the nominal pose, shape (6, 2)."""
        return self._at_nominal.expand @ self._at_nominal.mapping.major

    def displacements(
        self,
        pointing_rad: Array,
        pose: Pose,
        sent_m: Array | None = None,
        last: Asked | None = None,
        rest_m: Array | None = None,
    ) -> Array:
        """Strut displacements (6,) for desired (alpha, beta); zero at struts known to be stuck.

        Args:
            pointing_rad: Desired (alpha, beta), shape (2,).
            pose: Where the payload is.
            sent_m: Strut displacements that hold it there; the relinearized form goes on from them.
            last: What was asked before; the incremental form goes on from it.
            rest_m: Desired strut displacements (6,): where the secondary goal is at its best, so
                far as pointing leaves the struts free; None is the nominal pose.

        Raises:
            ValueError: What the form goes on from is missing.
        """
        A, now = self._present(pose)
        joint = np.zeros(now.J.shape[1]) if rest_m is None else now.expand.T @ rest_m
        secondary = now.J[SECONDARY] @ joint
        if self.form == "incremental":
            if last is None:
                raise ValueError("last must be given in incremental form, got None")
            before = now.expand.T @ last.rest_m
            change = now.mapping(
                pointing_rad - last.pointing_rad,
                joint - before,
                secondary - now.J[SECONDARY] @ before,
            )
            return last.displacements_m + now.expand @ change
        if self.form == "relinearized":
            if sent_m is None:
                raise ValueError("sent_m must be given in relinearized form, got None")
            gamma_and_t = secondary_motion(pose.rotation, pose.translation_m)
            change = now.mapping(
                pointing_rad - pointing_angles(pose.rotation),
                joint - now.expand.T @ sent_m,
                secondary - gamma_and_t[[1, 2, 3, 0]],
            )
            return sent_m + now.expand @ change
        if not self._locked_m.any():
            return now.expand @ now.mapping(pointing_rad, joint, secondary)
        # A strut stuck off centre has already moved the payload by J[:, k] l_k.
        offset = np.linalg.solve(A, self._follow @ self._locked_m)
        return now.expand @ now.mapping(
            pointing_rad - offset[MAJOR], joint, secondary - offset[SECONDARY]
        )

    def pointing(self, displacements_m: Array, pose: Pose) -> Array:
        """(alpha, beta) of displacements (6,) of all struts, sound or not, about the pose."""
        A = self._A_0 if self.jacobian == "constant" else self.geometry.inverse_jacobian(pose)
        return np.linalg.solve(A, displacements_m)[MAJOR]

    def split(self, displacements_m: Array, pose: Pose) -> tuple[Array, Array]:
        """What displacements (6,) of the surviving struts do to pointing, and what is left of them.

        The first, (alpha, beta), would take the mapping's own displacements; less these, the
        second, shape (6,), is secondary motion alone.
        """
        _, now = self._present(pose)
        surviving = now.expand.T @ displacements_m
        pointing_rad = now.J[MAJOR] @ surviving
        return pointing_rad, now.expand @ (surviving - now.mapping(pointing_rad))

    def _present(self, pose: Pose) -> tuple[Array, Reconfigured]:
        """A in l_dot = A x_dot, and the mapping there: at the pose, or at the nominal one."""
        if self.jacobian == "constant":
            return self._A_0, self._at_nominal
        A = self.geometry.inverse_jacobian(pose)
        return A, self.at(A)

    def estimate(self, displacements_m: Array, pose: Pose) -> Pose:
        """Pose that the commanded strut displacements lead to, from the pose one tick before.

        One Newton step on the strut lengths; a tick moves so little that it lands within round-off.
        There is no other sensor for gamma, t_x, t_y, t_z; alpha and beta come from the same
        commands, so that the estimate carries no detector noise.
        """
        lengths = self._follow @ (displacements_m + self._locked_m)
        if self.jacobian == "constant":
            return NOMINAL.moved(np.linalg.solve(self._A_0, lengths))
        A = self.geometry.inverse_jacobian(pose)
        return pose.moved(np.linalg.solve(A, lengths - self.geometry.displacements(pose)))

    def at(self, A: Array) -> Reconfigured:
        """The mapping where l_dot = A x_dot."""
        kinematics = self._system(A, locked=list(self.goal.locked_m)).kinematics()
        mapping = kinematics.velocity_mapping(
            major=MAJOR,
            secondary=SECONDARY,
            joint_weight=self.goal.joint_weight,
            secondary_weight=self.goal.secondary_weight,
        )
        return Reconfigured(mapping, np.eye(len(A))[:, kinematics.actuators], kinematics.J)

    def _system(self, A: Array, locked: Sequence[int] = ()) -> ConstrainedSystem:
        """Struts and payload with the free struts released: theta_dot = [l_dot; x_dot]."""
        n = len(A)
        sound = ConstrainedSystem(
            J_T=np.hstack([np.zeros((6, n)), np.eye(6)]),
            J_C=np.hstack([np.eye(n), -A]),
            active=np.arange(n),
            stiffness=self._stiffness,
        )
        return sound.with_failures(locked, free=[*self.goal.free, *self.goal.loose])

    def _free_struts_follow(self) -> Array:
        """Displacements of all struts per displacement of those that are held, shape (6, 6)."""
        kinematics = self._system(self._A_0).kinematics()
        follow = np.zeros((6, 6))
        follow[kinematics.actuators, kinematics.actuators] = 1.0
        is_strut = kinematics.passive < 6
        free = kinematics.passive[is_strut]
        follow[np.ix_(free, kinematics.actuators)] = kinematics.passive_gain[is_strut]
        return follow
