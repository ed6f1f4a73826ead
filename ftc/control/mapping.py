"""The prioritized mapping in the loop: from a major task to displacements of the actuators.

Displacements are absolute, from the nominal pose: eq. (41) taken whole. Its incremental form drifts
when J is re-evaluated; docs/jacobian.md compares the forms.
"""

from collections.abc import Callable, Sequence
from typing import Generic, Literal, cast, get_args

import numpy as np
from numpy.typing import ArrayLike

import argument_checks as check
from argument_checks import Array, Mask
from ftc.control.geometry import Geometry, Pose, free_actuators_follow, without_springs, yielded
from ftc.control.limits import LimitedDisplacements, LimitedMapping, MovableLimits
from ftc.control.local_mapping import LocalMapping, Mapping, PreviousCommand
from ftc.goal import Goal
from prioritized import Kinematics, WhenLimited

DisplacementForm = Literal["absolute", "incremental", "gauss_newton"]
"""How eq. (41) becomes a displacement: from the nominal pose; from what was commanded a tick
before; or, from where the actuators are, one Gauss-Newton step towards the optimum of the curved
problem."""


class PrioritizedMapping(Generic[Pose]):
    """Optimal displacements of the actuators for a demanded major task, eqs. (28) and (30).

    Actuators that the goal says have failed are reconfigured as in section 2.3.
    """

    def __init__(
        self,
        geometry: Geometry[Pose],
        goal: Goal,
        major: Sequence[int],
        secondary: Sequence[int],
        form: DisplacementForm = "absolute",
        task: Callable[[Pose], Array] | None = None,
        *,
        limits: tuple[ArrayLike, ArrayLike] | None = None,
        when_limited: WhenLimited = "least_squares",
    ) -> None:
        """Prepare the mapping at the nominal pose.

        Args:
            geometry: The mechanism.
            goal: Weights, and the failures that are known.
            major: Task rows of the major task.
            secondary: Task rows of the secondary task, in the order of its weights.
            form: How eq. (41) becomes a displacement.
            task: Task coordinates (m,) of a pose, for the Gauss-Newton form.
            limits: Lower and upper displacements of the actuators from the nominal pose, shape
                (n,) or one number each, for :meth:`within_limits`; those of failed actuators do not
                count. A weakened actuator needs limits that it can hold with the force left.
            when_limited: What becomes of a major task beyond them.

        Raises:
            ValueError, TypeError: An actuator locked off centre in incremental form: its
                displacement is in no increment. The Gauss-Newton form without task coordinates.
                Limits in incremental form. Anything of another number or kind than that.
        """
        parts = "posture", "jacobian", "placed", "twist", "moved"
        check.methods("geometry", geometry, *parts)
        check.choice("form", form, get_args(DisplacementForm))
        check.choice("when_limited", when_limited, get_args(WhenLimited))
        task = task if task is None else check.function("task", task)
        check.instance("goal", goal, Goal).of(len(geometry.system.active))
        rows = len(geometry.system.J_T)
        if form == "gauss_newton" and task is None:
            raise ValueError("task must be given in gauss_newton form, got None")
        if form == "incremental" and any(goal.locked_at.values()):
            raise ValueError(
                f'form must be "absolute" or "gauss_newton" with an actuator locked off centre, '
                f"got {form} with locked_at = {goal.locked_at}"
            )
        if limits is not None and form == "incremental":
            raise ValueError(
                'form must be "absolute" or "gauss_newton" with limits, got incremental'
            )
        self._model, self._task = geometry, task
        self._major, self._secondary = (
            check.indices(name, value, rows).tolist()
            for name, value in (("major", major), ("secondary", secondary))
        )
        self.goal = goal
        self.form = form
        self._nominal = geometry.nominal
        released = without_springs(geometry.system, goal.spring_lost).with_failures(
            free=[*goal.free, *goal.spring_lost]
        )
        self._failed = released.with_failures(locked=list(goal.locked_at))
        kinematics = self._failed.kinematics()
        self._surviving = kinematics.actuators
        self._expand = np.eye(len(self._failed.active))[:, self._surviving]
        self._prepared = kinematics.velocity_mapping(
            self._major, self._secondary, goal.joint_weight, goal.secondary_weight
        )
        self._locked_at = np.zeros(self.actuators)
        for actuator, displacement in goal.locked_at.items():
            self._locked_at[actuator] = displacement
        self._locked = None
        if goal.locked_at:
            self._locked = np.isin(np.arange(self.actuators), list(goal.locked_at))
        self._is_off_centre = bool(self._locked_at.any())
        self._follow = free_actuators_follow(released)
        is_identity = np.array_equal(self._follow, np.eye(self.actuators))
        follows = np.isin(np.arange(self.actuators), list(goal.free))[:, None] * self._follow
        self._free_follow = follows if follows.any() else None
        self._are_all_held = is_identity and not self._is_off_centre
        # Where closed loops tie the actuators together, the others yield to one that is off centre.
        others = yielded(released, self._locked_at, kinematics.actuators)
        self._yielded = self._expand.T @ others
        self._standing = self._locked_at + others
        self.limits, self._limited = None, None
        if limits is not None:
            within = check.limit_vectors("limits", limits, self.actuators)
            self.limits = lower, upper = within
            self._limited = kinematics.velocity_mapping(
                self._major,
                self._secondary,
                goal.joint_weight,
                goal.secondary_weight,
                rate_limits=(lower - others, upper - others),
                when_limited=when_limited,
            )
        self._at_nominal = self.at(geometry.jacobian(self._nominal))

    @property
    def actuators(self) -> int:
        """Number of actuators, failed ones included."""
        return len(self._failed.active)

    @property
    def nominal(self) -> Pose:
        """The pose that displacements are measured from."""
        return self._nominal

    @property
    def unused(self) -> Mask:
        """Which actuators are commanded nothing, because the goal says that they have failed."""
        return ~np.isin(np.arange(self.actuators), self._surviving)

    def nothing(self) -> PreviousCommand:
        """State before the first demand."""
        n = self.actuators
        return PreviousCommand(np.zeros(len(self._major)), np.zeros(n), np.zeros(n))

    def major_gain(self) -> Array:
        """Displacements per demanded major task at the nominal pose, shape (n, m1)."""
        return self._at_nominal.expand @ self._at_nominal.mapping.major

    def secondary_gain(self) -> Array:
        """Displacements per secondary reference, at the nominal pose, shape (n, n).

        Its columns span the motions that a reference can ask for without a part in the major task.
        """
        now = self._at_nominal
        still, secondary = np.zeros(len(self._major)), now.J[self._secondary]
        rates = [now.mapping(still, unit, secondary @ unit) for unit in now.expand]
        return now.expand @ np.array(rates).T

    def displacements(
        self,
        demand: Array,
        pose: Pose,
        commanded: Array | None = None,
        last: PreviousCommand | None = None,
        secondary_reference: Array | None = None,
    ) -> Array:
        """Displacements (n,) for a demanded major task; zero at actuators known to be locked.

        Args:
            demand: Demanded major task, shape (m1,).
            pose: Where the mechanism is.
            commanded: Displacements (n,) that hold it there; the Gauss-Newton form goes on from
                them.
            last: What was demanded before; the incremental form goes on from it.
            secondary_reference: Reference of the secondary goal, displacements (n,); it is
                followed as far as the major task leaves the actuators free. None is the nominal
                pose.

        Raises:
            ValueError: What the form goes on from is missing.
        """
        if self.form == "absolute" and secondary_reference is None and not self._is_off_centre:
            return self._expand.dot(self._rates(pose)(demand))
        posture, now = self._present(pose)
        joint, secondary = self._references(now, secondary_reference)
        if self.form == "incremental":
            if last is None:
                raise ValueError("last must be given in incremental form, got None")
            before = now.expand.T @ last.secondary_reference
            change = now.mapping(
                demand - last.demand,
                joint - before,
                secondary - now.J[self._secondary] @ before,
            )
            return now.expand @ (now.expand.T @ last.displacements + change)
        if self.form == "gauss_newton":
            here, remaining = self._step(now, demand, pose, commanded, joint, secondary)
            return now.expand.dot(here + now.mapping(*remaining))
        change = now.mapping(*self._remaining(posture, demand, joint, secondary))
        return now.expand.dot(self._yielded + change)

    def within_limits(
        self,
        demand: Array,
        pose: Pose,
        secondary_reference: Array | None = None,
        *,
        commanded: Array | None = None,
    ) -> LimitedDisplacements:
        """Displacements within `limits`, the major task they achieve, and what is lacking.

        Limits come first, then the major task, then the secondary goals with what is left; the
        arguments are those of :meth:`displacements`.

        Raises:
            ValueError: The mapping has no limits; or the Gauss-Newton form nothing to go on from.
        """
        posture, now = self._present(pose)
        limited = now.limited
        if limited is None or self.limits is None:
            raise ValueError("limits must be given for displacements within limits, got None")
        joint, secondary = self._references(now, secondary_reference)
        if self.form == "gauss_newton":
            here, remaining = self._step(now, demand, pose, commanded, joint, secondary)
            # Picked, not multiplied: a limit may be infinite.
            lower, upper = (limit[self._surviving] - here for limit in self.limits)
            limited = cast(MovableLimits, limited).within((lower, upper))
        else:
            here, remaining = self._yielded, self._remaining(posture, demand, joint, secondary)
        solved = limited.solve(*remaining)
        displacements = now.expand.dot(here + solved.rates)
        residual = remaining[0] - now.J[self._major].dot(solved.rates)
        return LimitedDisplacements(displacements, demand - residual, residual, solved)

    def _step(
        self,
        now: LocalMapping,
        demand: Array,
        pose: Pose,
        commanded: Array | None,
        joint: Array,
        secondary: Array,
    ) -> tuple[Array, tuple[Array, Array, Array]]:
        """Displacements of the survivors (n',), and what a Gauss-Newton step from there is to do.

        Raises:
            ValueError: `commanded` is missing.
        """
        if commanded is None or self._task is None:
            raise ValueError("commanded must be given in gauss_newton form, got None")
        task, here = self._task(pose), now.expand.T.dot(commanded)
        remaining = demand - task[self._major], joint - here, secondary - task[self._secondary]
        return here, remaining

    def _references(
        self, now: LocalMapping, secondary_reference: Array | None
    ) -> tuple[Array, Array]:
        """References of the survivors (n',) and of the secondary task (m2,)."""
        joint = np.zeros(now.J.shape[1])
        if secondary_reference is not None:
            joint = now.expand.T.dot(secondary_reference)
        return joint, now.J[self._secondary].dot(joint)

    def _remaining(
        self, posture: Pose, demand: Array, joint: Array, secondary: Array
    ) -> tuple[Array, Array, Array]:
        """What remains of absolute demands for the survivors: some displacements stand already."""
        # An actuator locked off centre has already moved the task by J[:, k] l_k.
        offset = self._model.twist(posture, self._follow.dot(self._standing))
        return (
            demand - offset[self._major],
            joint - self._yielded,
            secondary - offset[self._secondary],
        )

    def followed(self, displacements: Array) -> Array | None:
        """Where displacements (n,) of the others take actuators known to be free, shape (n,).

        To first order about the nominal pose; None: none is, or nothing takes them anywhere.
        """
        if self._free_follow is None:
            return None
        return self._free_follow.dot(displacements + self._locked_at)

    def major_motion(self, displacements: Array, pose: Pose) -> Array:
        """Major task (m1,) of displacements (n,) of all actuators, failed ones too, at the pose."""
        return self._model.twist(self._model.posture(pose), displacements)[self._major]

    def reached(self, pose: Pose) -> Array:
        """Major task (m1,) at a pose, by the task coordinates.

        Raises:
            ValueError: The mapping was made without task coordinates.
        """
        if self._task is None:
            raise ValueError("task must be given for the task at a pose, got None")
        return self._task(pose)[self._major]

    def split(self, displacements: Array, pose: Pose) -> tuple[Array, Array, Array | None]:
        """Displacements (n,) of the surviving actuators in three parts.

        Returns:
            Their effect on the major task, shape (m1,), which the mapping's own displacements would
            have too; less these, what is secondary motion alone, shape (n,); and what no motion
            follows, because closed loops tie the actuators together, shape (n,): None if nothing
            does.
        """
        _, now = self._present(pose)
        surviving, internal = now.expand.T @ displacements, None
        if len(now.constraint):
            internal = np.linalg.pinv(now.constraint) @ (now.constraint @ surviving)
            surviving, internal = surviving - internal, now.expand @ internal
        demand = now.J[self._major] @ surviving
        secondary_reference = now.expand @ (surviving - now.mapping(demand))
        return demand, secondary_reference, internal

    def estimate(self, displacements: Array, pose: Pose) -> Pose:
        """The pose to which commanded displacements (n,) lead, from the pose one tick before.

        There is no sensor for the secondary task; the major task comes from the same commands, so
        that the estimate carries no sensor noise.
        """
        if self._locked is not None:  # a former mapping may still have commanded it
            displacements = np.where(self._locked, self._locked_at, displacements)
        if self._are_all_held:
            return self._model.moved(pose, displacements)
        return self._model.moved(pose, self._follow.dot(displacements))

    def at(self, jacobian: Array, /) -> LocalMapping:
        """The mapping for this Jacobian of the geometry."""
        kinematics = self.kinematics_at(jacobian)
        return LocalMapping(
            self.rates_at(kinematics),
            self._expand,
            kinematics.J,
            kinematics.active_constraint,
            self.limited_at(kinematics),
        )

    def kinematics_at(self, jacobian: Array) -> Kinematics:
        """Of the surviving actuators; a mechanism with a closed form would override this."""
        return self._model.placed(self._failed, jacobian).kinematics()

    def rates_at(self, kinematics: Kinematics) -> Mapping:
        """Optimal rates of the surviving actuators; another optimality would override this."""
        return self._prepared.at(kinematics)

    def limited_at(self, kinematics: Kinematics) -> LimitedMapping | None:
        """The same within the limits, if there are any; another allocation would override this."""
        return None if self._limited is None else self._limited.at(kinematics)

    def _rates(self, pose: Pose) -> Mapping:
        """Of :meth:`_present` the rates alone, for every tick."""
        posture = self._model.posture(pose)
        if posture is self._nominal:
            return self._at_nominal.mapping
        return self.rates_at(self.kinematics_at(self._model.jacobian(posture)))

    def _present(self, pose: Pose) -> tuple[Pose, LocalMapping]:
        posture = self._model.posture(pose)
        if posture is self._nominal:
            return posture, self._at_nominal
        return posture, self.at(self._model.jacobian(posture))
