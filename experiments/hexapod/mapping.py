"""From desired pointing to strut displacements: the mapping block of Fig. 3, and its pose estimate.

Displacements are absolute, from the nominal pose: eq. (41) taken whole. Its incremental form drifts
when J is re-evaluated; docs/jacobian.md compares the forms.
"""

from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike

from experiments.hexapod.choices import JacobianChoice
from experiments.hexapod.goal import MAJOR, SECONDARY, Goal
from prioritized import ConstrainedSystem, Status
from sim import NOMINAL, Array, Hexapod, Pose, Posture, pointing_angles, secondary_motion

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


class Mapping(Protocol):
    """What makes rates of a pointing velocity; see :class:`prioritized.VelocityMapping`."""

    @property
    def major(self) -> Array:
        """Gain of the pointing velocity."""
        ...

    @property
    def status(self) -> Status:
        """What it can promise about the pointing."""
        ...

    def __call__(
        self,
        v_major: ArrayLike,
        joint_velocity: ArrayLike | None = None,
        secondary_velocity: ArrayLike | None = None,
    ) -> Array:
        """Optimal rates; what is None counts as zero."""
        ...


@dataclass(frozen=True)
class Reconfigured:
    """The mapping at one pose, section 2.3.

    Attributes:
        mapping: Rates of the surviving struts, eqs. (28) and (30).
        expand: Puts them on the six struts, shape (6, n').
        J: Twist per surviving strut rate, eq. (14), shape (6, n').
    """

    mapping: Mapping
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
        if stiffness is not None:
            stiffness = stiffness.copy()
            stiffness[list(goal.loose), list(goal.loose)] = 0.0
        self._nominal = geometry.posture(NOMINAL)
        released = _parallel(self._nominal, stiffness).with_failures(free=[*goal.free, *goal.loose])
        self._failed = released.with_failures(locked=list(goal.locked_m))
        survivors = self._failed.kinematics().actuators
        self._expand = np.eye(len(self._failed.active))[:, survivors]
        self._prepared = self._failed.kinematics().velocity_mapping(
            MAJOR, SECONDARY, goal.joint_weight, goal.secondary_weight
        )
        self._at_nominal = self.at(self._nominal.inverse_jacobian)
        self._locked_m = np.zeros(len(self._failed.active))
        for strut, displacement in goal.locked_m.items():
            self._locked_m[strut] = displacement
        self._is_off_centre = bool(self._locked_m.any())
        self._follow = _free_struts_follow(released)

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
        posture, now = self._present(pose)
        if self.form == "absolute" and rest_m is None and not self._is_off_centre:
            return now.expand.dot(now.mapping(pointing_rad))
        joint = np.zeros(now.J.shape[1]) if rest_m is None else now.expand.T.dot(rest_m)
        secondary = now.J[SECONDARY].dot(joint)
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
        # A strut stuck off centre has already moved the payload by J[:, k] l_k.
        offset = posture.twist(self._follow.dot(self._locked_m))
        return now.expand.dot(
            now.mapping(pointing_rad - offset[MAJOR], joint, secondary - offset[SECONDARY])
        )

    def pointing(self, displacements_m: Array, pose: Pose) -> Array:
        """(alpha, beta) of displacements (6,) of all struts, sound or not, about the pose."""
        posture = self._nominal if self.jacobian == "constant" else self.geometry.posture(pose)
        return posture.twist(displacements_m)[MAJOR]

    def split(self, displacements_m: Array, pose: Pose) -> tuple[Array, Array]:
        """What displacements (6,) of the surviving struts do to pointing, and what is left of them.

        The first, (alpha, beta), would take the mapping's own displacements; less these, the
        second, shape (6,), is secondary motion alone.
        """
        _, now = self._present(pose)
        surviving = now.expand.T @ displacements_m
        pointing_rad = now.J[MAJOR] @ surviving
        return pointing_rad, now.expand @ (surviving - now.mapping(pointing_rad))

    def _present(self, pose: Pose) -> tuple[Posture, Reconfigured]:
        """The struts, and the mapping: at the pose, or at the nominal one."""
        if self.jacobian == "constant":
            return self._nominal, self._at_nominal
        posture = self.geometry.posture(pose)
        return posture, self.at(posture.inverse_jacobian)

    def estimate(self, displacements_m: Array, pose: Pose) -> Pose:
        """Pose that the commanded strut displacements lead to, from the pose one tick before.

        One Newton step on the strut lengths; a tick moves so little that it lands within round-off.
        There is no other sensor for gamma, t_x, t_y, t_z; alpha and beta come from the same
        commands, so that the estimate carries no detector noise. With the present Jacobian the
        pose comes with its struts, which the mapping and the next estimate need.
        """
        lengths = self._follow.dot(displacements_m + self._locked_m)
        if self.jacobian == "constant":
            return NOMINAL.moved(self._nominal.twist(lengths))
        posture = self.geometry.posture(pose)
        moved = pose.moved(posture.twist(lengths - posture.displacement_m))
        return self.geometry.posture(moved)

    def at(self, A: Array) -> Reconfigured:
        """The mapping where l_dot = A x_dot."""
        J_C = self._failed.J_C.copy()
        J_C[:, len(A) :] = -A
        kinematics = self._failed.at(J_C=J_C).kinematics()
        return Reconfigured(self._prepared.at(kinematics), self._expand, kinematics.J)


def _parallel(posture: Posture, stiffness: Array | None) -> ConstrainedSystem:
    """Struts and payload, theta_dot = [l_dot; x_dot]: l_dot = A x_dot."""
    A = posture.inverse_jacobian
    n = len(A)
    return ConstrainedSystem(
        J_T=np.hstack([np.zeros((6, n)), np.eye(6)]),
        J_C=np.hstack([np.eye(n), -A]),
        active=np.arange(n),
        stiffness=stiffness,
    )


def _free_struts_follow(released: ConstrainedSystem) -> Array:
    """Displacements of all struts per displacement of those that are held, shape (6, 6)."""
    kinematics = released.kinematics()
    follow = np.zeros((6, 6))
    follow[kinematics.actuators, kinematics.actuators] = 1.0
    is_strut = kinematics.passive < 6
    free = kinematics.passive[is_strut]
    follow[np.ix_(free, kinematics.actuators)] = kinematics.passive_gain[is_strut]
    return follow
