"""Prioritized mapping of the control loop: from a major task to actuator displacements.

Displacements are absolute, from the nominal pose (eq. (41)). The incremental form of (41) drifts
when J is re-evaluated; docs/jacobian.md compares the forms.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
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
    induced_displacements,
    without_springs,
    without_unneeded_springs,
)
from prioritized import Kinematics, Tick, VelocityMapping, WhenLimited

MOST_ACTUATORS = 10_000
"""Largest number of actuators of a goal: a larger index is a mistake."""


@dataclass(frozen=True)
class Goal:
    """Weights of the secondary goal and the failures known to the controller.

    Actuators are numbered 0..n-1; their displacements are in [m] or [rad].

    Attributes:
        joint_weight: W1, diagonal over the n actuators; None is zero.
        secondary_weight: W2, diagonal over the secondary rows; None is zero.
        locked_at: Displacement of each actuator known to be locked.
        free: Actuators known to exert no force, with intact springs.
        spring_lost: Actuators known to have lost force and spring.
        effectiveness: Remaining fraction of the force, above zero and up to one, of each actuator
            known to be weakened.
    """

    joint_weight: tuple[float, ...] | None = None
    secondary_weight: tuple[float, ...] | None = None
    locked_at: dict[int, float] = field(default_factory=dict)
    free: tuple[int, ...] = ()
    spring_lost: tuple[int, ...] = ()
    effectiveness: dict[int, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("joint_weight", "secondary_weight"):
            if (weight := getattr(self, name)) is not None:
                diagonal = check.array(name, check.array(name, weight, None), least=0.0)
                vars(self)[name] = tuple(diagonal.tolist())
        for name in ("free", "spring_lost"):
            numbers = check.indices(name, getattr(self, name), MOST_ACTUATORS)
            vars(self)[name] = tuple(numbers.tolist())
        for name in ("locked_at", "effectiveness"):
            given = check.instance(name, getattr(self, name), dict)
            actuators = check.indices(name, list(given), MOST_ACTUATORS).tolist()
            pairs = zip(actuators, given.values(), strict=True)
            vars(self)[name] = {k: check.number(name, value) for k, value in pairs}
        for part in self.effectiveness.values():
            check.number("effectiveness", part, check.SMALLEST, 1.0)

    @property
    def failed(self) -> set[int]:
        """Actuators known to have failed, completely or partly."""
        return {*self.locked_at, *self.free, *self.spring_lost, *self.effectiveness}

    def of(self, actuators: int) -> "Goal":
        """Check that the goal refers to actuators 0..n-1 only, and return it."""
        check.integer("actuators", actuators)
        for name in ("free", "spring_lost", "locked_at", "effectiveness"):
            check.indices(name, list(getattr(self, name)), actuators)
        return self


DisplacementForm = Literal["absolute", "incremental", "gauss_newton"]
"""Forms of eq. (41): displacement from the nominal pose; increment from the last command; or one
Gauss-Newton step of the nonlinear problem from the present actuator displacements."""

_ROUND_OFF = 1e-9
"""Residual of a limited task, relative to the task, that counts as round-off."""


class PreviousCommand(NamedTuple):
    """Last demand and result of a mapping, from which the incremental form continues.

    `demand` (m1,) is the demanded major task, `displacements` (n,) are the actuator displacements
    before the converters, and `secondary_reference` (n,) is the reference of the secondary goal.
    """

    demand: Array
    displacements: Array
    secondary_reference: Array


class LocalMapping(NamedTuple):
    """Mapping at one pose, section 2.3.

    Attributes:
        mapping: Rates of the n' surviving actuators, eqs. (28) and (30): a
            :class:`prioritized.VelocityMapping`, or the result of `allocate`.
        kinematics: Kinematics of the failed mechanism at the pose, with n' actuators.
        limited: Mapping with limits, whose `solve` returns `rates`; None without limits.
    """

    mapping: Any
    kinematics: Kinematics
    limited: Any = None


class _Step(NamedTuple):
    """Remaining motion from the displacements `here` (n',) of the survivors to the optimum.

    The major task has to move by `major` (m1,) and the survivors by `joint` (n',). The secondary
    task has to move by the effect of survivor displacements `along` (n',) plus `secondary` (m2,).
    """

    here: Array
    major: Array
    joint: Array
    along: Array
    secondary: Array

    def targets(self, J_s: Array) -> tuple[Array, Array, Array]:
        """Return the targets of a velocity mapping with the secondary Jacobian rows (m2, n')."""
        return self.major, self.joint, J_s.dot(self.along) + self.secondary


class PrioritizedMapping(Generic[Pose]):
    """Mapping from a demanded major task to optimal actuator displacements, eqs. (28) and (30).

    It is reconfigured for the failed actuators of the goal as in section 2.3.

    Attributes:
        nominal: Pose from which displacements are measured.
        actuators: Number n of actuators, failed ones included.
        unused: Mask (n,) of failed actuators, which get no command.
        limits: Lower and upper displacements, shape (n,) each; None without limits.
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
        """Prepare the mapping at the nominal pose of a mechanism.

        Args:
            geometry: Mechanism without failures.
            goal: Weights and known failures.
            major: Task rows of the major task.
            secondary: Task rows of the secondary task, in the order of its weights.
            form: Form of eq. (41).
            task: Function that returns the task coordinates (m,) of a pose; required by the
                Gauss-Newton form.
            limits: Lower and upper displacements of the actuators from the nominal pose, shape
                (n,) or one number each; those of failed actuators are ignored. A weakened
                actuator needs limits that it can hold with its remaining force. Must be None in
                incremental form.
            when_limited: Treatment of a major task beyond the limits.
            allocate: Alternative to eqs. (28) and (30), for comparisons: a function from the
                kinematics of the failed mechanism to an object that maps velocities to rates of
                the survivors. It replaces `limited` of
                :class:`ftc.control.mapping.LocalMapping` if there are limits, else `mapping`.

        Raises:
            ValueError: An actuator is locked off centre in incremental form, whose increments do
                not contain its displacement.
        """
        check.attributes("geometry", geometry, "jacobians", "twist", "moved")
        check.choice("form", form, get_args(DisplacementForm))
        check.choice("when_limited", when_limited, get_args(WhenLimited))
        self._task = task if task is None else check.function("task", task)
        self._allocate = allocate if allocate is None else check.function("allocate", allocate)
        self.actuators = n = len(geometry.system.active)
        check.instance("goal", goal, Goal).of(n)
        if form == "gauss_newton" and task is None:
            raise ValueError('task must be given with form "gauss_newton", got None')
        if form == "incremental" and any(goal.locked_at.values()):
            raise ValueError(
                f'form must be "absolute" or "gauss_newton" with an actuator locked off centre, '
                f"got {form} with locked_at = {goal.locked_at}"
            )
        if form == "incremental" and limits is not None:
            raise ValueError(
                'form must be "absolute" or "gauss_newton" with limits, got incremental'
            )
        self.goal, self.form, self.nominal, self._model = goal, form, geometry.nominal, geometry
        rows = len(geometry.system.J_T)
        self._major = check.indices("major", major, rows)
        self._secondary = check.indices("secondary", secondary, rows)
        without_lost = without_springs(geometry.system, goal.spring_lost)
        released = without_lost.with_failures(free=[*goal.free, *goal.spring_lost])
        self._failed = without_unneeded_springs(released.with_failures(locked=list(goal.locked_at)))
        kinematics = self._failed.kinematics()
        self._surviving = kinematics.actuators
        self.unused: Mask = ~np.isin(np.arange(n), self._surviving)
        self._has_failed = bool(self.unused.any())
        self._velocities = self._failed.active[self._surviving]
        self._expand = np.eye(n)[:, self._surviving]

        self._locked = np.isin(np.arange(n), list(goal.locked_at))
        self._locked_at = np.zeros(n)
        self._locked_at[list(goal.locked_at)] = list(goal.locked_at.values())
        self._follow = free_actuators_follow(released)
        self._some_follow = bool((self._follow != np.eye(n)).any())
        self._free_follow = np.isin(np.arange(n), goal.free)[:, None] * self._follow
        # Closed loops displace the other actuators if a locked one is off centre.
        induced = induced_displacements(released, self._locked_at, self._surviving)
        self._induced = induced[self._surviving]
        self._known_displacements = self._follow.dot(self._locked_at + induced)
        self._is_off_centre = bool(self._locked_at.any())

        weights = goal.joint_weight, goal.secondary_weight
        prepared = partial(kinematics.velocity_mapping, self._major, self._secondary, *weights)
        self._prepared, self.limits, self._limited = prepared(), None, None
        if limits is not None:
            self.limits = lower, upper = check.limits("limits", limits, n)
            box = lower - induced, upper - induced
            self._limited = prepared(rate_limits=box, when_limited=when_limited)
        self._at_nominal = self._local(kinematics)
        self._still = check.read_only(np.zeros(n))
        self._still_secondary = np.zeros(len(self._secondary))

    def initial_command(self) -> PreviousCommand:
        """Return the command that precedes the first demand: zero."""
        return PreviousCommand(np.zeros(len(self._major)), self._still, self._still)

    def major_gain(self) -> Array:
        """Return the displacements per demanded major task at the nominal pose, shape (n, m1)."""
        return self._expand @ self._at_nominal.mapping.major

    def secondary_gain(self) -> Array:
        """Return the displacements per secondary reference at the nominal pose, shape (n, n).

        Its columns span the motions of a reference in the null space of the major task.
        """
        now, still = self._at_nominal, np.zeros(len(self._major))
        secondary = now.kinematics.J[self._secondary]
        rates = [now.mapping(still, unit, secondary @ unit) for unit in self._expand]
        return self._expand @ np.array(rates).T

    def displacements(
        self,
        demand: Array,
        pose: Pose,
        commanded: Array | None = None,
        last: PreviousCommand | None = None,
        secondary_reference: Array | None = None,
    ) -> Array:
        """Return the displacements (n,) for a demanded major task, ignoring `limits`.

        Args:
            demand: Demanded major task, shape (m1,).
            pose: Present pose of the mechanism.
            commanded: Displacements (n,) that hold the mechanism there; required by the
                Gauss-Newton form, which starts from them.
            last: Previous command; required by the incremental form, which starts from it.
            secondary_reference: Reference of the secondary goal, displacements (n,), followed in
                the null space of the major task. None is the nominal pose.
        """
        step = self._step(demand, pose, commanded, last, secondary_reference)
        velocities = self._moved(self._ticks[0], pose, step, None)
        if velocities is not None:
            return self._on_all(step.here + velocities[self._velocities])
        now = self.at(pose)
        targets = step.targets(now.kinematics.J[self._secondary])
        return self._on_all(step.here + now.mapping(*targets))

    def tick(
        self,
        demand: Array,
        pose: Pose,
        commanded: Array | None = None,
        last: PreviousCommand | None = None,
        secondary_reference: Array | None = None,
    ) -> tuple[Array, Array | None]:
        """Return displacements (n,) within `limits` and the residual (m1,) of the major task.

        The limits have priority over the major task, and this over the secondary goals. Without
        limits the residual is None. The arguments are those of :meth:`displacements`.
        """
        if self.limits is None:
            return self.displacements(demand, pose, commanded, last, secondary_reference), None
        step = self._step(demand, pose, commanded, last, secondary_reference)
        lower, upper = (limit[self._surviving] - step.here for limit in self.limits)
        remaining = lower, upper
        velocities = self._moved(self._ticks[1], pose, step, remaining)
        if velocities is not None:
            moved = self._model.jacobians(pose).J_T.dot(velocities).take(self._major)
            residual = step.major - moved
            if _norm(residual) <= _ROUND_OFF * (_norm(step.major) + _norm(moved)):
                return self._on_all(step.here + velocities[self._velocities]), residual
        # The residual may depend on singular values that `Tick` treats as zero.
        now = self.at(pose)
        J, limited = now.kinematics.J, now.limited
        limited = limited.with_limits(remaining) if self.form == "gauss_newton" else limited
        rates = limited.solve(*step.targets(J[self._secondary])).rates
        return self._on_all(step.here + rates), step.major - J[self._major].dot(rates)

    def _on_all(self, displacements: Array) -> Array:
        """Expand displacements (n',) of the survivors to all actuators (n,)."""
        return self._expand.dot(displacements) if self._has_failed else displacements

    def _step(
        self,
        demand: Array,
        pose: Pose,
        commanded: Array | None,
        last: PreviousCommand | None,
        secondary_reference: Array | None,
    ) -> _Step:
        """Return the remaining motion of this tick for the form of the mapping."""
        demand = _vector("demand", demand, len(self._major))
        if secondary_reference is None:
            secondary_reference = self._still
        reference = _vector("secondary_reference", secondary_reference, self.actuators)
        target = reference[self._surviving]
        if self.form == "incremental":
            if last is None:
                raise ValueError('last must be given with form "incremental", got None')
            change = target - last.secondary_reference[self._surviving]
            here = last.displacements[self._surviving]
            return _Step(here, demand - last.demand, change, change, self._still_secondary)
        if self.form == "absolute":
            here, task = self._induced, None
            if self._is_off_centre:  # a locked actuator displaces the task by J[:, k] l_k
                task = self._model.twist(pose, self._known_displacements)
        elif commanded is None or self._task is None:
            raise ValueError('commanded must be given with form "gauss_newton", got None')
        else:
            here = _vector("commanded", commanded, self.actuators)[self._surviving]
            task = self._task(pose)
        if task is None:
            return _Step(here, demand, target - here, target, self._still_secondary)
        secondary = -task[self._secondary]
        return _Step(here, demand - task[self._major], target - here, target, secondary)

    def _moved(
        self, tick: Tick | None, pose: Pose, step: _Step, limits: tuple[Array, Array] | None
    ) -> Array | None:
        """Return the displacements (N,) of all joints for a step, by one compiled call.

        `limits` are relative to `step.here`. None: the compiled call does not apply or not succeed.
        """
        if tick is None:
            return None
        parts, along = [step.major, step.joint], None
        if self.goal.secondary_weight is not None:
            parts, along = [*parts, step.secondary], step.along
        return tick.at_jacobians(self._model.jacobians(pose), np.concatenate(parts), limits, along)

    @cached_property
    def _ticks(self) -> list[Tick | None]:
        """Compiled mappings at any pose, without and with limits; None for other allocations."""
        both = self._at_nominal.mapping, self._at_nominal.limited
        return [of.tick() if isinstance(of, VelocityMapping) else None for of in both]

    def followed(self, displacements: Array) -> Array:
        """Return the displacements (n,) of free actuators that follow from those of the others.

        They are of first order about the nominal pose, and zero for actuators that are not free.
        """
        return self._free_follow.dot(displacements + self._locked_at)

    def major_motion(self, displacements: Array, pose: Pose) -> Array:
        """Return the major task (m1,) for displacements (n,) of all actuators, failed ones too."""
        return self._model.twist(pose, displacements)[self._major]

    def reached(self, pose: Pose) -> Array:
        """Return the major task (m1,) at a pose; requires the mapping's argument `task`."""
        if self._task is None:
            raise ValueError("task must be given for the task at a pose, got None")
        return self._task(pose)[self._major]

    def split(self, displacements: Array, pose: Pose) -> tuple[Array, Array, Array]:
        """Split displacements (n,) of the surviving actuators into three parts.

        Returns:
            Their effect on the major task, shape (m1,); the secondary motion that remains after
            subtracting the mapping's displacements for this effect, shape (n,); and the part that
            closed loops do not admit as a motion, shape (n,).
        """
        mapping, kinematics, _ = self.at(pose)
        surviving, C = displacements[self._surviving], kinematics.active_constraint
        internal = np.linalg.pinv(C) @ (C @ surviving)
        surviving = surviving - internal
        demand = kinematics.J[self._major] @ surviving
        return demand, self._expand.dot(surviving - mapping(demand)), self._expand.dot(internal)

    def estimate(self, displacements: Array, pose: Pose) -> Pose:
        """Return the pose for commanded displacements (n,), starting from the pose a tick before.

        The secondary task has no sensor; the major task is estimated from the commands as well, so
        that the estimate contains no sensor noise.
        """
        if self.goal.locked_at:  # the previous mapping may still have commanded it
            displacements = np.where(self._locked, self._locked_at, displacements)
        if self._some_follow:
            displacements = self._follow.dot(displacements)
        return self._model.moved(pose, displacements)

    def at(self, pose: Pose, /) -> LocalMapping:
        """Return the mapping at a pose."""
        jacobians = self._model.jacobians(pose)
        if pose is self.nominal or jacobians is self._model.system:
            return self._at_nominal
        return self._local(self._failed.at_pose(jacobians).kinematics())

    def _local(self, kinematics: Kinematics) -> LocalMapping:
        mapping, limited = self._prepared.at(kinematics), None
        if self._limited is not None:
            limited = (self._allocate or self._limited.at)(kinematics)
        elif self._allocate is not None:
            mapping = self._allocate(kinematics)
        return LocalMapping(mapping, kinematics, limited)


def _vector(name: str, value: Array, size: int) -> Array:
    """Check a vector; return a valid float64 vector unchanged, since this runs at every tick."""
    is_valid = check.is_plain(value) and value.shape == (size,)
    return value if is_valid else check.array(name, value, size)
