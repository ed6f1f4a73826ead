"""Velocity mapping: Problem 1 of the paper for any weights."""

from dataclasses import FrozenInstanceError
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

import argument_checks as check
from argument_checks import Array, Indices
from prioritized._mapping.amplification import (
    as_sentence,
    closure_sentences,
    length_sentences,
    servo_sentences,
    uncertainty_sentences,
)
from prioritized._mapping.level_specs import LevelSpecs
from prioritized._mapping.levels import Level, smallest_gap, velocity_gains, velocity_levels
from prioritized._mapping.limited import Limiting, Optimum, optimum
from prioritized._mapping.plain import NAMES, Plain, plain_of
from prioritized._mapping.problem import Problem
from prioritized._mapping.solution import VelocitySolution
from prioritized._mapping.task import Status, status_of
from prioritized._mapping.tasks import Task
from prioritized._mapping.tick import Tick
from prioritized._mechanism.measure import Measure
from prioritized._solver.arrays import apply, joined, none, on_axes, ones, read_only
from prioritized._solver.limits import Limits, limits
from prioritized._solver.packed import Point, Rows
from prioritized._solver.rank import RankedSvd, basis_scale, largest, norm, ranked_svd

if TYPE_CHECKING:
    from prioritized._kinematics import Kinematics


class VelocityMapping:
    """Mapping from a major velocity to the optimal active joint rates, by :func:`velocity_mapping`.

    rates = major @ v_m + joint @ rates_desired + secondary @ v_s_desired

    A call computes the rates alone, without a singular value decomposition if the problem is
    well-conditioned. Gains, ranks and gaps are computed when first used.
    """

    _damping: float
    _kinematics: "Kinematics | None"  # that J belongs to; None for a J given as a matrix
    _limiting: Limiting | None
    _directions: tuple[Array, Array]  # of the major and of the secondary task

    def __init__(
        self, problem: Problem, damping: float = 0.0, limiting: Limiting | None = None
    ) -> None:
        """Store checked arguments; :func:`velocity_mapping` checks them."""
        parts = {"_damping": damping, "_limiting": limiting, "_kinematics": None}
        vars(self).update(parts, _directions=(problem.S_m, problem.S_s), _own=problem)

    @staticmethod
    def _of_plain(
        plain: Plain, directions: tuple[Array, Array], limiting: Limiting | None
    ) -> "VelocityMapping":
        """Return the mapping of one J, diagonal weights, major and secondary directions."""
        mapping = object.__new__(VelocityMapping)
        parts = {"_damping": 0.0, "_limiting": limiting, "_kinematics": None}
        vars(mapping).update(parts, _directions=directions, _plain=plain)
        return mapping

    def _of_mechanism(self, kinematics: "Kinematics") -> "VelocityMapping":
        """Return the mapping of a mechanism, with its J and constraints."""
        mapping = VelocityMapping(self._own, self._damping, self._limiting)
        vars(mapping).update(_kinematics=kinematics)
        return mapping

    def _in_natural_units(
        self, task_units: Array, rate_units: Array | None, **mechanism: Array | None
    ) -> "VelocityMapping":
        """Return the mapping of a J, its scale and constraints stated in natural units.

        Units are those of task rows (m,) and rates (n,), None for one common unit; `mechanism` are
        fields of :class:`Problem`.
        """
        problem = self._own.natural(task_units, 1.0 if rate_units is None else rate_units)
        mapping = VelocityMapping(problem._replace(**mechanism), self._damping, self._limiting)
        vars(mapping).update(_directions=self._directions, _rate_units=rate_units)
        return mapping

    def __setattr__(self, name: str, value: object) -> None:
        raise FrozenInstanceError(f"cannot assign to field {name!r}")

    def __call__(
        self,
        v_major: ArrayLike,
        joint_velocity: ArrayLike | None = None,
        secondary_velocity: ArrayLike | None = None,
    ) -> Array:
        """Return the optimal active joint rates, shape (..., n); None counts as zero."""
        targets, limiting = (v_major, joint_velocity, secondary_velocity), self._limiting
        if limiting is None or limiting.is_box:
            box = None if limiting is None else limiting.box
            if "_origin" in vars(self):
                rates = self._by_tick(targets, box)
            else:
                rates = None if self._plain is None else self._plain.rates(*targets, box)
            if rates is not None:
                return rates
        return self._own_rates(self._solved(*targets, None)[1].x)

    @cached_property
    def _rate_units(self) -> Array | None:
        """Natural units of the rates in the problem, (n,); None is those of J."""
        return None if self._kinematics is None else self._kinematics._reduced.mixed_units

    def _own_rates(self, rates: Array) -> Array:
        """Convert rates of the problem (..., n) to the units of J, within the limits exactly."""
        if self._rate_units is None:
            return rates
        scaled = rates * self._rate_units
        return scaled if self._limiting is None else scaled.clip(*self._limiting.box)

    def _by_tick(self, arguments: tuple[ArrayLike | None, ...], box: Limits | None) -> Array | None:
        """Return optimal rates for one target from J_T and J_C; None if not applicable."""
        tick, (major, *others), problem = self.tick(), arguments, self._first._own
        if tick is None or self._kinematics is None:
            return None
        sizes = len(problem.S_m), problem.J.shape[1], len(problem.S_s)
        desired = (none((k,)) if v is None else v for v, k in zip(others, sizes[1:], strict=True))
        targets = [major, *desired]
        # Non-finite numbers are found later; the checks would take as long as the arithmetic.
        if [v.shape if check.is_plain(v) else None for v in targets] != [(k,) for k in sizes]:
            targets = [
                check.array(name, v, ..., k)
                for name, v, k in zip(NAMES, targets, sizes, strict=True)
            ]
            if any(v.ndim > 1 for v in targets):
                return None
        targets = np.concatenate(targets if len(problem.secondary_weight) else targets[:2])
        velocities = tick.at_jacobians(self._kinematics.system.geometry, targets, box)
        return None if velocities is None else velocities[tick.basis.joints[0]]

    def _solved(
        self,
        v_major: ArrayLike,
        joint_velocity: ArrayLike | None,
        secondary_velocity: ArrayLike | None,
        start: Point | None,
    ) -> tuple[Array, Optimum]:
        """Return the checked targets (..., m1 + n + m2) and the optimum."""
        problem = self._problem
        p = joined(
            problem.lead,
            "v_major",
            v_major=(v_major, len(problem.S_m)),
            joint_velocity=(joint_velocity, problem.J.shape[-1]),
            secondary_velocity=(secondary_velocity, len(problem.S_s)),
        )
        if self._rate_units is not None:
            first, last = len(problem.S_m), p.shape[-1] - len(problem.S_s)
            p[..., first:last] /= self._rate_units
        return p, optimum(self._levels, p, self._within, problem.tolerance, start)

    @property
    def _within(self) -> Limiting | None:
        """Limits in the units of the problem."""
        units, limiting = self._rate_units, self._limiting
        return limiting if limiting is None or units is None else limiting.natural(units)

    @property
    def _first(self) -> "VelocityMapping":
        """Mapping from which this one was derived by `at()`; itself otherwise."""
        return vars(self).get("_origin", self)

    def tick(self) -> Tick | None:
        """Return a compiled solver of the mapping for successive well-conditioned poses.

        Construct it once for a mechanism and its failures. Its targets are, one after the other,
        the major velocity (m1,), the desired rates (n,) and, if it has a weight, the desired
        secondary velocity (m2,). At poses where the solver returns None, use :meth:`at`.

        Returns:
            The solver; None for a J given as a matrix, with `rate_rows`, or with springs.
        """
        if self._kinematics is None:
            return None
        tick = self._first._tick
        return None if tick is None else tick.at(self._kinematics)

    @cached_property
    def _tick(self) -> Tick | None:
        """Tick of the mechanism that the mapping was created for; see :meth:`tick`."""
        problem, limiting, kinematics = self._own, self._limiting, self._kinematics
        is_box = limiting is None or limiting.is_box
        if kinematics is None or problem.lead or not is_box:
            return None
        sizes = [norm(W) for W in (problem.weight, problem.secondary_weight) if W.any()]
        if any(not check.SMALLEST <= size < check.LARGEST for size in sizes):
            return None
        T = problem.tie_metric
        specs = LevelSpecs.of(kinematics, _tasks_of(self, problem), T if len(T) else None)
        return Tick.of(specs, kinematics)

    @cached_property
    def _plain(self) -> Plain | None:
        """J and weights for one call of a kernel; None if there are further arguments."""
        kinematics = self._kinematics
        is_tied = kinematics is not None and kinematics._reduced.is_tied
        if self._damping or is_tied or self._rate_units is not None or "_origin" in vars(self):
            return None
        return plain_of(self._stated, 0.0 if kinematics is None else kinematics._reduced.threshold)

    @cached_property
    def _problem(self) -> Problem:
        """Checked arguments with J truncated to its decided rank."""
        kinematics, stated = self._kinematics, self._stated
        if kinematics is None:
            return stated
        J, scale = kinematics._reduced.truncated_jacobian(*self._directions, stated.major_metric)
        return stated._replace(J=J, scale=np.asarray(scale))

    @cached_property
    def _stated(self) -> Problem:
        """Problem in natural units, before any rank of J is decided."""
        kinematics, stated = self._kinematics, self._first._own
        if kinematics is None:
            return stated
        reduced = kinematics._reduced
        units, (J, scale) = self._rate_units, reduced.measured
        M = stated.major_metric
        if M is None:
            M = reduced.measure(self._directions[0]).metric
        natural = stated.natural(reduced.task_units, 1.0 if units is None else units)
        parts = {"J": J, "scale": np.asarray(scale), "active_constraint": reduced.constraint}
        return natural._replace(**parts, major_metric=M)

    @cached_property
    def _own(self) -> Problem:
        """Checked arguments in the units of J, without the constraints of a mechanism."""
        assert self._plain is not None
        return self._plain.problem(*self._directions)

    def solve(
        self,
        v_major: ArrayLike,
        joint_velocity: ArrayLike | None = None,
        secondary_velocity: ArrayLike | None = None,
        *,
        start: VelocitySolution | None = None,
    ) -> VelocitySolution:
        """Return the optimal rates within the limits, with residual, active limits and status.

        Limits and constraints hold first, then the error of the major task is least, then the
        weighted sum of :func:`velocity_mapping`.

        Args:
            v_major: Major velocity, shape (..., m1).
            joint_velocity: Desired rates, shape (..., n); None is zero.
            secondary_velocity: Desired secondary velocity, shape (..., m2); None is zero.
            start: Solution of a similar problem, such as that of the previous tick.
        """
        warm = None if start is None else check.instance("start", start, VelocitySolution).point
        p, best = self._solved(v_major, joint_velocity, secondary_velocity, warm)
        return VelocitySolution(self, p, best)

    @property
    def _rows(self) -> tuple[Rows, ...]:
        """Inequality rows of the rates of the problem."""
        limiting = self._within
        return () if limiting is None else limiting.rows

    @cached_property
    def _levels(self) -> list[Level]:
        """Problem 1 as levels of least squares."""
        return velocity_levels(self._problem, self._damping)

    def at(
        self, kinematics: "Kinematics", *, rate_limits: tuple[ArrayLike, ArrayLike] | None = None
    ) -> "VelocityMapping":
        """Return the mapping with the same task, weights and metrics, unchecked, at another pose.

        Args:
            kinematics: Mechanism at that pose.
            rate_limits: New limits, as for :meth:`prioritized.Kinematics.velocity_mapping`; None is
                those of this mapping.
        """
        if not hasattr(kinematics, "hierarchy"):
            raise TypeError(f"kinematics must be a Kinematics, got {check.short_repr(kinematics)}")
        first, other_shape = self._first, kinematics.system.shape
        shape = first._own.J.shape
        if other_shape != shape:
            raise ValueError(f"kinematics must have a J of shape {shape}, got {other_shape}")
        limiting = self._limiting
        if rate_limits is not None:
            box = limits("rate_limits", kinematics._survivors.pair(rate_limits), shape[1])
            limiting = self._bounded_by(box)
        mapping, parts = object.__new__(VelocityMapping), {"_directions": self._directions}
        parts |= {"_damping": self._damping, "_kinematics": kinematics, "_limiting": limiting}
        vars(mapping).update(parts, _origin=first)
        return mapping

    def with_limits(self, rate_limits: tuple[ArrayLike, ArrayLike]) -> "VelocityMapping":
        """Return the mapping with other limits of the n rates, as for :func:`velocity_mapping`.

        Limits of displacements can be imposed by rate limits that change from tick to tick.

        Raises:
            ValueError: The limits are invalid.
        """
        box = limits("rate_limits", rate_limits, self._first._own.J.shape[-1])
        mapping = object.__new__(VelocityMapping)
        vars(mapping).update(vars(self), _limiting=self._bounded_by(box))
        return mapping

    def _bounded_by(self, box: Limits) -> Limiting:
        """Return the limits of this mapping with another box of the rates."""
        return Limiting(box) if self._limiting is None else self._limiting._replace(box=box)

    def __str__(self) -> str:
        gain, uncertainty = float(self.largest_gain.max(initial=0.0)), 0.0
        if self._kinematics is not None:
            uncertainty = self._kinematics._reduced.major(self._directions[0]).gain_uncertainty
        sentences = (
            as_sentence(self.status.value),
            *uncertainty_sentences(gain, uncertainty),
            *servo_sentences(self.amplification),
            *length_sentences(self.characteristic_length),
            *closure_sentences(self.closure_condition),
        )
        return " ".join(sentences)

    def residual(self, v_major: ArrayLike) -> Array:
        """Return the part of the major velocity that is not achieved, shape (..., m1)."""
        v_m = check.array("v_major", v_major, ..., self.achieved.shape[-1])
        return v_m - apply(self.achieved, "v_major", v_m)

    @property
    def major(self) -> Array:
        """Gain of the major velocity, shape (..., n, m1)."""
        return self._gains[..., : len(self._problem.S_m)]

    @property
    def joint(self) -> Array:
        """Gain of the desired rates, shape (..., n, n)."""
        first = len(self._problem.S_m)
        return self._gains[..., first : first + self._problem.J.shape[-1]]

    @property
    def secondary(self) -> Array:
        """Gain of the desired secondary velocity, shape (..., n, m2)."""
        return self._gains[..., len(self._problem.S_m) + self._problem.J.shape[-1] :]

    @cached_property
    def achieved(self) -> Array:
        """Major velocity achieved per major velocity commanded, shape (..., m1, m1)."""
        gain = self._solution[0][..., : len(self._problem.S_m)]
        return check.frozen(on_axes(self._problem.major_jacobian @ gain, self._problem.lead))

    @cached_property
    def largest_gain(self) -> Array:
        """Largest norm of the rates per unit norm of the major velocity alone, shape (...).

        If angular and linear quantities are mixed, lengths are in units of the mechanism's length.
        """
        gain = self.major
        return read_only(largest(gain if self._measure is None else self._measure.of_gain(gain)))

    @property
    def characteristic_length(self) -> float | None:
        """Length that relates angular and linear velocities, or rates, in one norm.

        It is that of the mechanism, unless a `major_metric`, `joint_weight` or `tie_metric` is
        given. None if no norm mixes angular and linear quantities, and for a J given as a matrix.
        """
        if self._measure is None:
            return None
        is_exact = self.status is Status.EXACT and self._limiting is None
        return self._measure.length(not is_exact, self._problem.has_ties)

    @property
    def _measure(self) -> Measure | None:
        if self._kinematics is None:
            return None
        return self._kinematics._reduced.measure(self._directions[0])

    @cached_property
    def amplification(self) -> Array:
        """Factor from relative errors of the rates to those of the major task, shape (...).

        It is the largest gain times the 2-norm of S_m J on the admissible rates, and at least 1
        where the major task is achieved. A servo error of 1 % of the rates moves the major task by
        up to this many percent of the commanded motion.
        """
        J, X = self._problem.S_m @ self._problem.admissible_jacobian, self._solution[0]
        units = ones(J.shape[-2]) if self._measure is None else self._measure.major
        gain = largest(X[..., : len(units)] * units)
        return read_only(np.asarray(largest(J / units[:, None]) * gain))

    @property
    def closure_condition(self) -> float:
        """Condition number of J_Cp, the passive columns of J_C; 1 for a J given as a matrix."""
        return 1.0 if self._kinematics is None else self._kinematics.closure_condition

    @property
    def rank(self) -> Indices:
        """Rank of the major task on the admissible rates, shape (...)."""
        return np.broadcast_to(self._solution[1][1].rank, self._problem.lead)

    @cached_property
    def gap(self) -> Array:
        """Factor by which the rank threshold could change before any rank would, shape (...)."""
        gap = smallest_gap(self._solution[1])
        if self._kinematics is not None:
            gap = np.minimum(gap, self._kinematics._reduced.major(*self._directions).gap)
        return np.broadcast_to(gap, self._problem.lead)

    @property
    def status(self) -> Status:
        """Status that holds for every problem of the batch."""
        conditions = {
            Status.SELF_MOTION: lambda: not self._is_determined,
            Status.LEAST_SQUARES: lambda: not np.all(self.rank == len(self._problem.S_m)),
            Status.DAMPED: lambda: self._damping,
        }
        return status_of(conditions, Status.EXACT)

    @property
    def _is_determined(self) -> bool:
        """Return whether no self-motion moves the major task, in any problem of the batch."""
        S_m, Q, tolerance = self._problem.S_m, self._problem.self_motion, self._problem.tolerance
        if self._kinematics is not None:
            return self._kinematics._reduced.determines(self._directions[0])
        return not np.any(ranked_svd(S_m @ Q, largest(S_m) * basis_scale(Q), tolerance).rank > 0)

    @cached_property
    def _solution(self) -> tuple[Array, list[RankedSvd]]:
        """Gains of the problem, and its rank decisions."""
        return velocity_gains(self._problem, self._damping)

    @cached_property
    def _gains(self) -> Array:
        return check.frozen(self._own_gains(self._solution[0]))

    def _own_gains(self, X: Array) -> Array:
        """Convert gains X of the problem (..., n, m1 + n + m2) to the units of J."""
        if self._rate_units is None:
            return X
        m1, m2 = len(self._problem.S_m), len(self._problem.S_s)
        inputs = np.concatenate([ones(m1), self._rate_units, ones(m2)])
        return self._rate_units[:, None] * X / inputs


def _tasks_of(mapping: VelocityMapping, problem: Problem) -> tuple[tuple[Task, ...], ...]:
    """Return Problem 1 as two levels: the major task, then rates and secondary task together."""
    (S_m, S_s), M, W1 = mapping._directions, problem.major_metric, problem.weight
    if M is not None and len(M) > len(S_m):
        M = np.linalg.qr(M, mode="r")
    rates = Task.joints(W1 if len(W1) else np.zeros(W1.shape[1]))
    secondary = [Task(S_s, problem.secondary_weight)] if len(problem.secondary_weight) else []
    return (Task(S_m, M, damping=mapping._damping),), (rates, *secondary)
