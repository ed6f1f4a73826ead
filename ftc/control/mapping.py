"""The prioritized mapping in the loop: from a major task to displacements of the actuators.

Displacements are absolute, from the nominal pose: eq. (41) taken whole. Its incremental form drifts
when J is re-evaluated; docs/jacobian.md compares the forms.
"""

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any, Generic, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg.blas import dnrm2 as _norm

import argument_checks as check
from argument_checks import Array, Mask
from ftc.control.geometry import (
    Geometry,
    Pose,
    free_actuators_follow,
    without_idle_springs,
    without_springs,
    yielded,
)
from ftc.control.local_mapping import LimitedDisplacements, LocalMapping, PreviousCommand
from ftc.goal import Goal
from prioritized import Kinematics, Tick, VelocityMapping, WhenLimited

DisplacementForm = Literal["absolute", "incremental", "gauss_newton"]
"""How eq. (41) becomes a displacement: from the nominal pose; from what was commanded a tick
before; or, from where the actuators are, one Gauss-Newton step towards the optimum of the curved
problem."""


_MET = 1e-9
"""Part of a task up to which what limits leave of it is round-off."""


class _Step(NamedTuple):
    """What is left to do from some displacements of the survivors.

    Attributes:
        here: These displacements, (n',).
        major: Of the major task, (m1,).
        joint: Desired of the survivors, (n',).
        along: What the secondary task is to move by, as displacements of the survivors, (n',); None
            is nothing.
        secondary: And beside that, (m2,).
    """

    here: Array
    major: Array
    joint: Array
    along: Array | None
    secondary: Array

    def targets(self, J_s: Array) -> tuple[Array, Array, Array]:
        """Arguments of a velocity mapping, for the secondary rows (m2, n') of the Jacobian."""
        beside = self.secondary if self.along is None else J_s.dot(self.along) + self.secondary
        return self.major, self.joint, beside


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
        allocate: Callable[[Kinematics], Any] | None = None,
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
            allocate: What is to be compared with eqs. (28) and (30): for kinematics of the failed
                mechanism, what maps velocities to rates of the survivors as
                :class:`ftc.control.local_mapping.LocalMapping` says, in the place of the mapping
                within limits if there are any, or else of the mapping.

        Raises:
            ValueError, TypeError: An actuator locked off centre in incremental form: its
                displacement is in no increment. The Gauss-Newton form without task coordinates.
                Limits in incremental form. Anything of another number or kind than that.
        """
        parts = "posture", "jacobians", "twist", "moved"
        check.methods("geometry", geometry, *parts)
        check.choice("form", form, get_args(DisplacementForm))
        check.choice("when_limited", when_limited, get_args(WhenLimited))
        task = task if task is None else check.function("task", task)
        self._allocate = allocate if allocate is None else check.function("allocate", allocate)
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
            check.indices(name, value, rows)
            for name, value in (("major", major), ("secondary", secondary))
        )
        self.goal = goal
        self.form = form
        self._nominal = geometry.nominal
        released = without_springs(geometry.system, goal.spring_lost).with_failures(
            free=[*goal.free, *goal.spring_lost]
        )
        failed = released.with_failures(locked=list(goal.locked_at))
        self._failed = without_idle_springs(failed)
        kinematics = self._failed.kinematics()
        self._surviving = kinematics.actuators
        self._all_survive = len(self._surviving) == self.actuators
        self._expand = np.eye(self.actuators)[:, self._surviving]
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
        self._yielded = self._of_survivors(others)
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
        self._at_nominal = self._local(kinematics)
        self._still = np.zeros(len(self._secondary))
        self._weighs_secondary = goal.secondary_weight is not None
        self._velocities = self._failed.active[self._surviving]

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
        step = self._step(demand, pose, commanded, last, secondary_reference)
        posture = self._model.posture(pose)
        velocities = self._moved(self._tick, posture, step, None)
        if velocities is not None:
            return self._on_all(step.here + velocities[self._velocities])
        now = self.at(posture)
        return self._on_all(step.here + now.mapping(*step.targets(now.J[self._secondary])))

    def tick(
        self,
        demand: Array,
        pose: Pose,
        commanded: Array | None = None,
        last: PreviousCommand | None = None,
        secondary_reference: Array | None = None,
    ) -> tuple[Array, Array | None]:
        """Displacements (n,) within `limits`, and what these leave of the major task, (m1,).

        Those of :meth:`within_limits` where there are limits, else those of :meth:`displacements`,
        which leave nothing: None. The arguments and errors are theirs.
        """
        if self.limits is None:
            return self.displacements(demand, pose, commanded, last, secondary_reference), None
        step = self._step(demand, pose, commanded, last, secondary_reference)
        posture = self._model.posture(pose)
        velocities = self._moved(self._limited_tick, posture, step, self._left(step))
        if velocities is not None:
            moved = self._model.jacobians(posture).J_T.dot(velocities).take(self._major)
            residual = step.major - moved
            if _norm(residual) <= _MET * (_norm(step.major) + _norm(moved)):
                return self._on_all(step.here + velocities[self._velocities]), residual
        # What limits leave of a task may hang on singular values that a tick takes for zero.
        limited = self.within_limits(demand, pose, secondary_reference, commanded=commanded)
        return limited.displacements, limited.residual

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
        now = self.at(self._model.posture(pose))
        if now.limited is None or self.limits is None:
            raise ValueError("limits must be given for displacements within limits, got None")
        step, limited = self._step(demand, pose, commanded, None, secondary_reference), now.limited
        if self.form == "gauss_newton":
            limited = limited.within(self._left(step))
        solved = limited.solve(*step.targets(now.J[self._secondary]))
        residual = step.major - now.J[self._major].dot(solved.rates)
        displacements = self._on_all(step.here + solved.rates)
        return LimitedDisplacements(displacements, demand - residual, residual, solved)

    def _step(
        self,
        demand: Array,
        pose: Pose,
        commanded: Array | None,
        last: PreviousCommand | None,
        secondary_reference: Array | None,
    ) -> _Step:
        """What the form of the mapping leaves to do.

        Raises:
            ValueError: What it goes on from is missing, or an argument has a wrong shape.
        """
        n, wanted = self.actuators, None
        demand = _vector("demand", demand, len(self._major))
        if secondary_reference is not None:
            reference = _vector("secondary_reference", secondary_reference, n)
            wanted = self._of_survivors(reference)
        if self.form == "incremental":
            if last is None:
                raise ValueError("last must be given in incremental form, got None")
            before = self._of_survivors(last.secondary_reference)
            change = -before if wanted is None else wanted - before
            here = self._of_survivors(last.displacements)
            return _Step(here, demand - last.demand, change, change, self._still)
        if self.form == "absolute":
            here, task = self._yielded, self._offset(pose)
        elif commanded is None or self._task is None:
            raise ValueError("commanded must be given in gauss_newton form, got None")
        else:
            here = self._of_survivors(_vector("commanded", commanded, n))
            task = self._task(pose)
        joint = -here if wanted is None else wanted - here
        if task is None:
            return _Step(here, demand, joint, wanted, self._still)
        return _Step(here, demand - task[self._major], joint, wanted, -task[self._secondary])

    def _offset(self, pose: Pose) -> Array | None:
        """Task displacement (m,) in which actuators that are locked off centre stand; or None."""
        if not self._is_off_centre:
            return None
        # One has already moved the task by J[:, k] l_k.
        standing = self._follow.dot(self._standing)
        return self._model.twist(self._model.posture(pose), standing)

    def _left(self, step: _Step) -> tuple[Array, Array]:
        """Lower and upper limits (n',) of what the survivors may still move by."""
        assert self.limits is not None
        lower, upper = (self._of_survivors(limit) - step.here for limit in self.limits)
        return lower, upper

    def _moved(
        self, tick: Tick | None, posture: Pose, step: _Step, limits: tuple[Array, Array] | None
    ) -> Array | None:
        """What a step displaces all velocities by, (N,), in one compiled call; None: it cannot.

        `limits` are those of what is left of it.
        """
        if tick is None:
            return None
        given = step.major, step.joint, step.secondary
        along = step.along if self._weighs_secondary else None
        targets = np.concatenate(given if self._weighs_secondary else given[:2])
        return tick.at_jacobians(self._model.jacobians(posture), targets, limits, along)

    @cached_property
    def _tick(self) -> Tick | None:
        """The mapping at one pose after another; None where another optimum is sought."""
        of = self._at_nominal.mapping
        return of.tick() if isinstance(of, VelocityMapping) else None

    @cached_property
    def _limited_tick(self) -> Tick | None:
        """The same within limits."""
        of = self._at_nominal.limited
        return of.tick() if isinstance(of, VelocityMapping) else None

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
        now = self.at(self._model.posture(pose))
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

    def at(self, posture: Pose, /) -> LocalMapping:
        """The mapping at a posture of the geometry."""
        if posture is self._nominal:
            return self._at_nominal
        return self._local(self._failed.at_pose(self._model.jacobians(posture)).kinematics())

    def _local(self, kinematics: Kinematics) -> LocalMapping:
        mapping, limited = self._prepared.at(kinematics), None
        if self._limited is not None:
            limited = (self._allocate or self._limited.at)(kinematics)
        elif self._allocate is not None:
            mapping = self._allocate(kinematics)
        constraint = kinematics.active_constraint
        return LocalMapping(mapping, self._expand, kinematics.J, constraint, limited)

    def _of_survivors(self, displacements: Array) -> Array:
        return displacements if self._all_survive else displacements[self._surviving]

    def _on_all(self, displacements: Array) -> Array:
        """Displacements (n,) of all actuators, of those of the survivors."""
        if self._all_survive:
            return displacements
        every = np.zeros(self.actuators)
        every[self._surviving] = displacements
        return every


def _vector(name: str, value: Array, size: int) -> Array:
    """One vector; at every tick what is one already is passed on."""
    is_right = check.is_plain(value) and value.shape == (size,)
    return value if is_right else check.exactly(name, value, size)
