"""The prioritized mapping in the loop: from a major task to displacements of the actuators.

Displacements are absolute, from the nominal pose: eq. (41) taken whole. Its incremental form drifts
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
    without_idle_springs,
    without_springs,
    yielded,
)
from prioritized import Kinematics, Tick, VelocityMapping, WhenLimited

MOST_ACTUATORS = 10_000


@dataclass(frozen=True)
class Goal:
    """Weights of the secondary goal, and the failures known to the controller.

    Actuators are numbered 0..n-1; displacements are in their own units, [m] or [rad].

    Attributes:
        joint_weight: W1, diagonal over the n actuators; None is zero.
        secondary_weight: W2, diagonal over the secondary rows; None is zero.
        locked_at: Actuators known to be locked, and the displacement at which each stands.
        free: Actuators known to exert no force, their springs intact.
        spring_lost: Actuators known to have lost force and spring.
        effectiveness: Actuators known to be weakened, and the part of the force that each has left,
            above zero and up to one.
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
            vars(self)[name] = tuple(
                check.indices(name, getattr(self, name), MOST_ACTUATORS).tolist()
            )
        for name in ("locked_at", "effectiveness"):
            known = check.instance(name, getattr(self, name), dict)
            actuators = check.indices(name, list(known), MOST_ACTUATORS).tolist()
            vars(self)[name] = {
                k: check.number(name, value)
                for k, value in zip(actuators, known.values(), strict=True)
            }
        for left in self.effectiveness.values():
            check.number("effectiveness", left, check.SMALLEST, 1.0)

    @property
    def failed(self) -> set[int]:
        """Actuators known to have failed, all or in part."""
        return {*self.locked_at, *self.free, *self.spring_lost, *self.effectiveness}

    def of(self, actuators: int) -> "Goal":
        """The goal itself, checked to name no other than these actuators."""
        check.integer("actuators", actuators)
        for name in ("free", "spring_lost", "locked_at", "effectiveness"):
            check.indices(name, list(getattr(self, name)), actuators)
        return self


DisplacementForm = Literal["absolute", "incremental", "gauss_newton"]
"""How eq. (41) becomes a displacement: from the nominal pose; from what was commanded a tick
before; or, from where the actuators are, one Gauss-Newton step towards the optimum of the curved
problem."""

_MET = 1e-9
"""Part of a task up to which what limits leave of it is round-off."""


class PreviousCommand(NamedTuple):
    """Last demand and displacements of a mapping, from which the incremental form continues.

    `demand` (m1,) is the demanded major task; `displacements` (n,) those of the actuators, before
    the converters; `secondary_reference` (n,) the reference of the secondary goal.
    """

    demand: Array
    displacements: Array
    secondary_reference: Array


class LocalMapping(NamedTuple):
    """The mapping at one pose, section 2.3.

    Attributes:
        mapping: Rates of the n' surviving actuators, eqs. (28) and (30): a
            :class:`prioritized.VelocityMapping`, or what `allocate` gives in its place.
        kinematics: Of the failed mechanism there, with n' actuators.
        limited: The mapping with limits, whose `solve` gives `rates`; None without.
    """

    mapping: Any
    kinematics: Kinematics
    limited: Any = None


class _Step(NamedTuple):
    """What is left to do from the displacements `here` (n',) of the survivors.

    The major task is to move by `major` (m1,), the survivors by `joint` (n',), and the secondary
    task by what the survivors' displacements `along` (n',) do, and by `secondary` (m2,) beside.
    """

    here: Array
    major: Array
    joint: Array
    along: Array
    secondary: Array

    def targets(self, J_s: Array) -> tuple[Array, Array, Array]:
        """Arguments of a velocity mapping, for the secondary rows (m2, n') of the Jacobian."""
        return self.major, self.joint, J_s.dot(self.along) + self.secondary


class PrioritizedMapping(Generic[Pose]):
    """Optimal displacements of the actuators for a demanded major task, eqs. (28) and (30).

    Actuators that the goal says have failed are reconfigured as in section 2.3.

    Attributes:
        nominal: The pose that displacements are measured from.
        actuators: Their number n, failed ones included.
        unused: Which of them are commanded nothing, because they have failed, shape (n,).
        limits: Lower and upper displacements, shape (n,) each; None without.
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
            task: Task coordinates (m,) of a pose; the Gauss-Newton form needs them.
            limits: Lower and upper displacements of the actuators from the nominal pose, shape
                (n,) or one number each; those of failed actuators do not count. A weakened
                actuator needs limits that it can hold with the force left. None in incremental
                form.
            when_limited: What becomes of a major task beyond them.
            allocate: What is to be compared with eqs. (28) and (30): for kinematics of the failed
                mechanism, what maps velocities to rates of the survivors as
                :class:`ftc.control.mapping.LocalMapping` says, in the place of the mapping
                within limits if there are any, or else of the mapping.

        Raises:
            ValueError: An actuator locked off centre in incremental form: its displacement is in no
                increment.
        """
        check.attributes("geometry", geometry, "jacobians", "twist", "moved")
        check.choice("form", form, get_args(DisplacementForm))
        check.choice("when_limited", when_limited, get_args(WhenLimited))
        self._task = task if task is None else check.function("task", task)
        self._allocate = allocate if allocate is None else check.function("allocate", allocate)
        self.actuators = n = len(geometry.system.active)
        check.instance("goal", goal, Goal).of(n)
        if form == "gauss_newton" and task is None:
            raise ValueError("task must be given in gauss_newton form, got None")
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
        loose = without_springs(geometry.system, goal.spring_lost)
        released = loose.with_failures(free=[*goal.free, *goal.spring_lost])
        self._failed = without_idle_springs(released.with_failures(locked=list(goal.locked_at)))
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
        # Where closed loops tie the actuators together, the others yield to one that is off centre.
        others = yielded(released, self._locked_at, self._surviving)
        self._yielded = others[self._surviving]
        self._standing = self._follow.dot(self._locked_at + others)
        self._is_off_centre = bool(self._locked_at.any())

        weights = goal.joint_weight, goal.secondary_weight
        prepared = partial(kinematics.velocity_mapping, self._major, self._secondary, *weights)
        self._prepared, self.limits, self._limited = prepared(), None, None
        if limits is not None:
            self.limits = lower, upper = check.limits("limits", limits, n)
            box = lower - others, upper - others
            self._limited = prepared(rate_limits=box, when_limited=when_limited)
        self._at_nominal = self._local(kinematics)
        self._still = check.read_only(np.zeros(n))
        self._still_secondary = np.zeros(len(self._secondary))

    def nothing(self) -> PreviousCommand:
        """State before the first demand."""
        return PreviousCommand(np.zeros(len(self._major)), self._still, self._still)

    def major_gain(self) -> Array:
        """Displacements per demanded major task at the nominal pose, shape (n, m1)."""
        return self._expand @ self._at_nominal.mapping.major

    def secondary_gain(self) -> Array:
        """Displacements per secondary reference, at the nominal pose, shape (n, n).

        Its columns span the motions that a reference can ask for without a part in the major task.
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
        """Displacements (n,) for a demanded major task, whatever `limits` are.

        Args:
            demand: Demanded major task, shape (m1,).
            pose: Where the mechanism is.
            commanded: Displacements (n,) that hold it there; the Gauss-Newton form goes on from
                them, and needs them.
            last: What was demanded before; the incremental form goes on from it, and needs it.
            secondary_reference: Reference of the secondary goal, displacements (n,); it is
                followed as far as the major task leaves the actuators free. None is the nominal
                pose.
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
        """Displacements (n,) within `limits`, and what these leave of the major task, (m1,).

        Limits come first, then the major task, then the secondary goals with what is left. Without
        limits nothing is left: None. The arguments are those of :meth:`displacements`.
        """
        if self.limits is None:
            return self.displacements(demand, pose, commanded, last, secondary_reference), None
        step = self._step(demand, pose, commanded, last, secondary_reference)
        lower, upper = (limit[self._surviving] - step.here for limit in self.limits)
        left = lower, upper
        velocities = self._moved(self._ticks[1], pose, step, left)
        if velocities is not None:
            moved = self._model.jacobians(pose).J_T.dot(velocities).take(self._major)
            residual = step.major - moved
            if _norm(residual) <= _MET * (_norm(step.major) + _norm(moved)):
                return self._on_all(step.here + velocities[self._velocities]), residual
        # What limits leave of a task may hang on singular values that a tick takes for zero.
        now = self.at(pose)
        J, limited = now.kinematics.J, now.limited
        limited = limited.with_limits(left) if self.form == "gauss_newton" else limited
        rates = limited.solve(*step.targets(J[self._secondary])).rates
        return self._on_all(step.here + rates), step.major - J[self._major].dot(rates)

    def _on_all(self, displacements: Array) -> Array:
        """Displacements (n',) of the survivors on all actuators, (n,)."""
        return self._expand.dot(displacements) if self._has_failed else displacements

    def _step(
        self,
        demand: Array,
        pose: Pose,
        commanded: Array | None,
        last: PreviousCommand | None,
        secondary_reference: Array | None,
    ) -> _Step:
        """What the form of the mapping leaves to do."""
        demand = _vector("demand", demand, len(self._major))
        if secondary_reference is None:
            secondary_reference = self._still
        reference = _vector("secondary_reference", secondary_reference, self.actuators)
        wanted = reference[self._surviving]
        if self.form == "incremental":
            if last is None:
                raise ValueError("last must be given in incremental form, got None")
            change = wanted - last.secondary_reference[self._surviving]
            here = last.displacements[self._surviving]
            return _Step(here, demand - last.demand, change, change, self._still_secondary)
        if self.form == "absolute":
            here, task = self._yielded, None
            if self._is_off_centre:  # one has already moved the task by J[:, k] l_k
                task = self._model.twist(pose, self._standing)
        elif commanded is None or self._task is None:
            raise ValueError("commanded must be given in gauss_newton form, got None")
        else:
            here = _vector("commanded", commanded, self.actuators)[self._surviving]
            task = self._task(pose)
        if task is None:
            return _Step(here, demand, wanted - here, wanted, self._still_secondary)
        beside = -task[self._secondary]
        return _Step(here, demand - task[self._major], wanted - here, wanted, beside)

    def _moved(
        self, tick: Tick | None, pose: Pose, step: _Step, limits: tuple[Array, Array] | None
    ) -> Array | None:
        """What a step displaces all velocities by, (N,), in one compiled call; None: it cannot.

        `limits` are those of what is left of it.
        """
        if tick is None:
            return None
        parts, along = [step.major, step.joint], None
        if self.goal.secondary_weight is not None:
            parts, along = [*parts, step.secondary], step.along
        jacobians = self._model.jacobians(pose)
        return tick.at_jacobians(jacobians, np.concatenate(parts), limits, along)

    @cached_property
    def _ticks(self) -> list[Tick | None]:
        """The mapping at one pose after another, without and within limits.

        None where another optimum is sought.
        """
        both = self._at_nominal.mapping, self._at_nominal.limited
        return [of.tick() if isinstance(of, VelocityMapping) else None for of in both]

    def followed(self, displacements: Array) -> Array:
        """Where displacements (n,) of the others take actuators known to be free, shape (n,).

        To first order about the nominal pose; zero for actuators that are not free.
        """
        return self._free_follow.dot(displacements + self._locked_at)

    def major_motion(self, displacements: Array, pose: Pose) -> Array:
        """Major task (m1,) of displacements (n,) of all actuators, failed ones too, at the pose."""
        return self._model.twist(pose, displacements)[self._major]

    def reached(self, pose: Pose) -> Array:
        """Major task (m1,) at a pose, by the task coordinates, which the mapping must have."""
        if self._task is None:
            raise ValueError("task must be given for the task at a pose, got None")
        return self._task(pose)[self._major]

    def split(self, displacements: Array, pose: Pose) -> tuple[Array, Array, Array]:
        """Displacements (n,) of the surviving actuators in three parts.

        Returns:
            Their effect on the major task, shape (m1,), which the mapping's own displacements would
            have too; less these, what is secondary motion alone, shape (n,); and what no motion
            follows, because closed loops tie the actuators together, shape (n,).
        """
        mapping, kinematics, _ = self.at(pose)
        surviving, C = displacements[self._surviving], kinematics.active_constraint
        internal = np.linalg.pinv(C) @ (C @ surviving)
        surviving = surviving - internal
        demand = kinematics.J[self._major] @ surviving
        secondary_reference = self._expand.dot(surviving - mapping(demand))
        return demand, secondary_reference, self._expand.dot(internal)

    def estimate(self, displacements: Array, pose: Pose) -> Pose:
        """The pose to which commanded displacements (n,) lead, from the pose one tick before.

        There is no sensor for the secondary task; the major task comes from the same commands, so
        that the estimate carries no sensor noise.
        """
        if self.goal.locked_at:  # a former mapping may still have commanded it
            displacements = np.where(self._locked, self._locked_at, displacements)
        if self._some_follow:
            displacements = self._follow.dot(displacements)
        return self._model.moved(pose, displacements)

    def at(self, pose: Pose, /) -> LocalMapping:
        """The mapping at a pose."""
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
    """One vector; at every tick what is one already is passed on."""
    is_right = check.is_plain(value) and value.shape == (size,)
    return value if is_right else check.array(name, value, size)
