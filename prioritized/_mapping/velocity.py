"""Velocity mapping: Problem 1 of the paper for all weights."""

from dataclasses import FrozenInstanceError
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike

import argument_checks as check
from argument_checks import Array, Indices
from prioritized._mapping.amplification import (
    as_sentence,
    closure_sentences,
    doubt_sentences,
    length_sentences,
    servo_sentences,
)
from prioritized._mapping.asked import Asked
from prioritized._mapping.levels import Level, damped, smallest_gap, velocity_levels
from prioritized._mapping.limited import Limiting, Optimum, optimum
from prioritized._mapping.problem import Problem
from prioritized._mapping.solution import VelocitySolution
from prioritized._mapping.solving import (
    Factors,
    Selected,
    Simple,
    Target,
    batched_rates,
    factors_of,
    factors_of_diagonals,
    problem_of,
    rates_by,
    rates_within,
    simple,
    target_of,
    thresholds,
    velocity_gains,
)
from prioritized._mapping.survivors import Survivors
from prioritized._mapping.task import Status
from prioritized._mapping.tasks import Task
from prioritized._mapping.tick import Tick
from prioritized._mechanism.elimination import Partition
from prioritized._mechanism.measure import Measure
from prioritized._mechanism.ordered import Stacked
from prioritized._solver.arrays import apply, joined, none, on_axes, read_only, respond, transposed
from prioritized._solver.limits import Limits, limits
from prioritized._solver.packed import Point, Rows
from prioritized._solver.rank import RankedSvd, basis_scale, largest, norm, ranked_svd


class Mechanism(Protocol):
    """What a mapping takes from :class:`prioritized.Kinematics`, whose module imports this one."""

    @property
    def J(self) -> Array: ...
    @property
    def scale(self) -> float: ...
    @property
    def actuators(self) -> Indices: ...
    @property
    def active_constraint(self) -> Array: ...
    @property
    def system(self) -> Partition: ...
    @property
    def task_units(self) -> Array: ...
    @property
    def rate_units(self) -> Array: ...
    @property
    def is_tied(self) -> bool: ...
    @property
    def clear(self) -> float: ...
    @property
    def closure_condition(self) -> float: ...
    @property
    def survivors(self) -> Survivors: ...
    def cleaned(self, S_m: Array, S_s: Array, metric: Array | None) -> tuple[Array, float]: ...
    def holds(self, S_m: Array) -> bool: ...
    def gap_of(self, S_m: Array, S_s: Array) -> float: ...
    def gain_uncertainty(self, S_m: Array) -> float: ...
    def measure(self, S_m: Array) -> Measure: ...
    def in_order(self, levels: Stacked) -> tuple[list[tuple[Array, float]], bool]: ...


class VelocityMapping:
    """The optimal active joint rates; made by :func:`velocity_mapping`.

    rates = major @ v_m + joint @ rates_desired + secondary @ v_s_desired

    A call solves for the rates alone, without a singular value decomposition where no rank is in
    doubt. Gains, ranks and gaps are computed when first used, and so is J at another pose.

    Attributes:
        damping: Of the major task.
        kinematics: The mechanism that J belongs to; None for a J given as a matrix.
    """

    damping: float
    kinematics: Mechanism | None

    def __init__(
        self,
        problem: Problem,
        damping: float = 0.0,
        kinematics: Mechanism | None = None,
        limiting: Limiting | None = None,
    ) -> None:
        """Take checked arguments; :func:`velocity_mapping` checks them."""
        parts = {"damping": damping, "kinematics": kinematics, "limiting": limiting}
        vars(self).update(parts, _problem=problem, _made=None)

    @staticmethod
    def of_factors(
        factors: Factors,
        rest: tuple[Selected, float, float],
        box: Array | None,
        limiting: Limiting | None = None,
    ) -> "VelocityMapping":
        """The mapping of one J with diagonal weights, all ranks clearly full.

        Args:
            factors: Of the problem.
            rest: Its tasks, the size of J (negative: its norm), and the rank tolerance.
            box: Its own limits of the rates, (2, n), or None.
            limiting: Other ones, or None.
        """
        mapping = object.__new__(VelocityMapping)
        parts = vars(mapping)
        parts["damping"], parts["kinematics"] = 0.0, None
        # What is not set follows from the other.
        if limiting is None:
            parts["_box"] = box
        if box is None:
            parts["limiting"] = limiting
        parts["_factors"], parts["_made"] = factors, (factors, rest)
        return mapping

    def __setattr__(self, name: str, value: object) -> None:
        raise FrozenInstanceError(f"cannot assign to field {name!r}")

    def __call__(
        self,
        v_major: ArrayLike,
        joint_velocity: ArrayLike | None = None,
        secondary_velocity: ArrayLike | None = None,
    ) -> Array:
        """Optimal active joint rates, shape (..., n); what is None counts as zero."""
        # Where J is known, no tick is made.
        factors = None if "_origin" in vars(self) else self._factors
        if factors is None:
            rates = self._by_tick(v_major, joint_velocity, secondary_velocity)
            if rates is not None:
                return rates
            factors = self._factors
        box = self._box
        if factors is not None and (box is not None or self.limiting is None):
            target = target_of(factors, v_major, joint_velocity, secondary_velocity)
            rates = rates_by(factors, target, box)
            if rates is not None:
                return rates
        if self.limiting is None:
            return self._unlimited(v_major, joint_velocity, secondary_velocity)
        return self.solve(v_major, joint_velocity, secondary_velocity).rates

    def _unlimited(
        self,
        v_major: ArrayLike,
        joint_velocity: ArrayLike | None,
        secondary_velocity: ArrayLike | None,
    ) -> Array:
        """Optimal rates without limits."""
        factors, rates = self._factors, None
        if factors is not None:
            target = target_of(factors, v_major, joint_velocity, secondary_velocity)
            rates = rates_by(factors, target)
        elif self.problem.lead and not self.damping and self.problem.is_unconstrained:
            rates = batched_rates(self.problem, v_major, joint_velocity, secondary_velocity)
        if rates is not None:
            return rates
        return respond(
            (self.major, self.joint, self.secondary),
            "v_major",
            v_major=v_major,
            joint_velocity=joint_velocity,
            secondary_velocity=secondary_velocity,
        )

    @cached_property
    def limiting(self) -> Limiting | None:
        """The limits of the rates; None is none."""
        assert self._box is not None
        return Limiting(read_only(self._box))

    @cached_property
    def _box(self) -> Array | None:
        """Limits of each rate (2, n), where nothing else limits them."""
        limiting: Limiting | None = vars(self)["limiting"]
        return np.array(limiting.box) if limiting is not None and limiting.is_box else None

    @property
    def _first(self) -> "VelocityMapping":
        """The mapping of which this one is another pose, or this one."""
        return vars(self).get("_origin", self)

    def _by_tick(
        self,
        v_major: ArrayLike,
        joint_velocity: ArrayLike | None,
        secondary_velocity: ArrayLike | None,
    ) -> Array | None:
        """Optimal rates for one target from J_T and J_C; None where J must be known, or is."""
        first, tick = self._first, self.tick()
        targets = (
            None if tick is None else first._targets(v_major, joint_velocity, secondary_velocity)
        )
        if tick is None or targets is None or self.kinematics is None:
            return None
        is_same = self.limiting is first.limiting and tick is first._tick
        limits = first._limits if is_same else tick.limits(_box(self.limiting))
        there = self.kinematics.system.geometry
        _, velocities = tick.of_plain(there.J_T, there.J_C, targets, limits, there.error_bound)
        return None if velocities is None else velocities[tick.basis.joints[0]]

    def _targets(self, v_major: ArrayLike, *others: ArrayLike | None) -> Array | None:
        """One target with the desired velocities after it; None where these are batches."""
        problem, names = self.problem, ("v_major", "joint_velocity", "secondary_velocity")
        sizes = len(problem.S_m), problem.J.shape[1], len(problem.S_s)
        rest = (none((k,)) if v is None else v for v, k in zip(others, sizes[1:], strict=True))
        given = [v_major, *rest]
        # What is not finite is found later; the checks would take as long as the arithmetic.
        if not all(map(check.is_plain, given)) or [v.shape for v in given] != [(k,) for k in sizes]:
            given = list(map(check.vector, names, given, sizes))
            if any(v.ndim > 1 for v in given):
                return None
        return np.concatenate(given if len(problem.secondary_weight) else given[:2])

    def tick(self) -> Tick | None:
        """The mapping at one pose after another, in one compiled call where nothing is in doubt.

        It is made once for a mechanism and its failures. Its targets are the major velocity (m1,)
        and the desired rates (n,), one after the other, and then the desired secondary velocity
        (m2,), if that has a weight. Where it does not answer, :meth:`at` does.

        Returns:
            The tick, or None where it could never answer, as of a J given as a matrix, with
            damping, `rate_rows`, springs, or a joint weight that is no diagonal.
        """
        tick = None if _system(self.kinematics) is None else self._first._tick
        return None if tick is None or self.kinematics is None else tick.at(self.kinematics)

    @cached_property
    def _tick(self) -> Tick | None:
        """The same where the mapping was made."""
        problem, limiting, kinematics = self.problem, self.limiting, self.kinematics
        is_box = limiting is None or limiting.is_box
        if kinematics is None or self.damping or problem.lead or not is_box:
            return None
        sizes = [norm(W) for W in (problem.weight, problem.secondary_weight) if W.any()]
        if any(not check.SMALLEST <= size < check.LARGEST for size in sizes):
            return None
        return Tick.of(_asked(problem, kinematics), kinematics)

    @cached_property
    def _limits(self) -> Limits:
        """Of all velocities, where the mapping was made."""
        assert self._tick is not None
        return self._tick.limits(_box(self.limiting))

    @cached_property
    def _made(self) -> tuple[Factors, tuple[Selected, float, float]] | None:
        """Factors at another pose and what is beside them; None where a rank is in doubt."""
        first, kinematics = self._first, self.kinematics
        simple = first._simple
        if simple is None or kinematics is None or kinematics.is_tied:
            return None
        selected = simple.selected._replace(clear=kinematics.clear)
        factors = factors_of_diagonals(kinematics.J, *simple.weights, kinematics.scale, selected)
        rest = selected, kinematics.scale, first.tolerance
        return None if factors is None else (factors, rest)

    @cached_property
    def _factors(self) -> Factors | None:
        """Of one problem without constraints and damping whose ranks are clearly full."""
        if self._made is not None:
            return self._made[0]
        problem = self.problem
        if self.damping or problem.lead or not problem.is_unconstrained:
            return None
        return factors_of(problem)

    @property
    def problem(self) -> Problem:
        """The checked arguments."""
        return self._problem

    @cached_property
    def _problem(self) -> Problem:
        """Made when it is needed, where the mapping was made of factors or is at another pose."""
        if self._made is not None:
            factors, rest = self._made
            return problem_of(factors, *rest)
        there, kinematics = self._first.problem, self.kinematics
        assert kinematics is not None
        J, scale = kinematics.cleaned(there.S_m, there.S_s, there.major_metric)
        C = kinematics.active_constraint
        return there._replace(J=J, scale=np.asarray(scale), active_constraint=C)

    def solve(
        self,
        v_major: ArrayLike,
        joint_velocity: ArrayLike | None = None,
        secondary_velocity: ArrayLike | None = None,
        *,
        start: VelocitySolution | None = None,
    ) -> VelocitySolution:
        """The optimal rates within the limits, what they cost, and which of them are active.

        Limits and constraints hold first, then the major task is met as far as they let it, then
        the weighted sum of :func:`velocity_mapping` is least.

        Args:
            v_major: Major velocity, shape (..., m1).
            joint_velocity: Desired rates, shape (..., n); None is zero.
            secondary_velocity: Desired secondary velocity, shape (..., m2); None is zero.
            start: Solution of a similar problem, such as that of the tick before.

        Raises:
            ValueError: A velocity of the wrong shape or not finite, by its name.
        """
        begun = None if start is None else check.instance("start", start, VelocitySolution).point
        answer = self._regardless_of_box(v_major, joint_velocity, secondary_velocity)
        if answer is not None:
            best = self._within_box(answer, begun)
            return VelocitySolution(self, np.array(v_major, dtype=float), answer[2], best)
        problem, limiting = self.problem, self.limiting
        m1, n = len(problem.S_m), problem.J.shape[-1]
        p = joined(
            problem.lead,
            "v_major",
            v_major=(v_major, m1),
            joint_velocity=(joint_velocity, n),
            secondary_velocity=(secondary_velocity, len(problem.S_s)),
        )
        unlimited = self._unlimited(*np.split(p, [m1, m1 + n], axis=-1))
        best = optimum(self.levels, p, unlimited, limiting, problem.tolerance, begun)
        return VelocitySolution(self, p[..., :m1], unlimited, best)

    def _regardless_of_box(
        self,
        v_major: ArrayLike,
        joint_velocity: ArrayLike | None,
        secondary_velocity: ArrayLike | None,
    ) -> tuple[Factors, Target, Array] | None:
        """Rates without limits for one target whose ranks are clearly full, and what made them.

        None where that is not so, or where anything but bounds of the rates limits them.
        """
        factors, limiting = self._factors, self.limiting
        if factors is None or limiting is None or not limiting.is_box:
            return None
        target = target_of(factors, v_major, joint_velocity, secondary_velocity)
        rates = rates_by(factors, target)
        return None if rates is None else (factors, target, rates)

    def _within_box(self, answer: tuple[Factors, Target, Array], start: Point | None) -> Optimum:
        """The optimum within bounds for the target of this answer."""
        box = self._box
        assert box is not None
        made = self._made
        metric = self.problem.major_metric if made is None else made[1][0].metric
        return rates_within(*answer, box, self.tolerance, metric, start)

    @property
    def rows(self) -> tuple[Rows, ...]:
        """Inequality rows of the rates."""
        return () if self.limiting is None else self.limiting.rows

    @property
    def tolerance(self) -> float:
        """Fraction of the scale below which a singular value is zero."""
        return self.problem.tolerance if self._made is None else self._made[1][2]

    @property
    def levels(self) -> list[Level]:
        """Problem 1 as levels of least squares."""
        levels = velocity_levels(self.problem, self.damping)
        if self.damping:
            return [*damped(levels[:2], self.problem.tolerance), *levels[2:]]
        return levels

    def at(
        self, kinematics: Mechanism, *, rate_limits: tuple[ArrayLike, ArrayLike] | None = None
    ) -> "VelocityMapping":
        """The same task, weights and metrics at another pose; these are not checked again.

        Args:
            kinematics: The mechanism at that pose.
            rate_limits: Lower and upper limits there, as for
                :meth:`prioritized.Kinematics.velocity_mapping`; None is those of this mapping.

        Raises:
            TypeError: `kinematics` is not a :class:`prioritized.Kinematics`.
            ValueError: It has another number of task rows or surviving actuators; or limits of a
                wrong length, or not in order.
        """
        if not hasattr(kinematics, "cleaned"):
            raise TypeError(f"kinematics must be a Kinematics, got {check.shown(kinematics)}")
        first, system = self._first, _system(kinematics)
        shape = first.problem.J.shape
        there = kinematics.J.shape if system is None else system.task.shape
        if there != shape:
            raise ValueError(f"kinematics must have a J of shape {shape}, got {there}")
        limiting = self.limiting
        if rate_limits is not None:
            box = limits("rate_limits", kinematics.survivors.pair(rate_limits), shape[1])
            limiting = _bounded_by(box, limiting)
        mapping = object.__new__(VelocityMapping)
        vars(mapping).update(
            damping=self.damping, kinematics=kinematics, limiting=limiting, _origin=first
        )
        return mapping

    @cached_property
    def _simple(self) -> Simple | None:
        """Tasks and weights, if there is nothing else and the weights are diagonal."""
        return None if self.damping else simple(self.problem)

    def within(self, rate_limits: tuple[ArrayLike, ArrayLike]) -> "VelocityMapping":
        """The same mapping with other limits of the n rates, as for :func:`velocity_mapping`.

        Limits of displacements are such limits: what is left of them changes from tick to tick.

        Raises:
            ValueError: As :func:`velocity_mapping`.
        """
        # Neither factors nor gains depend on limits, but those of all velocities do.
        box = limits("rate_limits", rate_limits, self._first.problem.J.shape[-1])
        mapping = object.__new__(VelocityMapping)
        vars(mapping).update(vars(self), limiting=_bounded_by(box, self.limiting))
        for name in ("_limits", "_box"):
            vars(mapping).pop(name, None)
        return mapping

    def belonging_to(self, kinematics: Mechanism) -> "VelocityMapping":
        """The same mapping, of this mechanism."""
        mapping = object.__new__(VelocityMapping)
        vars(mapping).update(vars(self), kinematics=kinematics)
        return mapping

    def __str__(self) -> str:
        sentences = (
            as_sentence(self.status.value),
            *doubt_sentences(float(self.largest_gain.max(initial=0.0)), self.gain_uncertainty),
            *servo_sentences(self.amplification),
            *length_sentences(self.characteristic_length),
            *closure_sentences(self.closure_condition),
        )
        return " ".join(sentences)

    def residual(self, v_major: ArrayLike) -> Array:
        """Part of the major velocity that the optimal rates do not reach, shape (..., m1)."""
        v_m = check.vector("v_major", v_major, self.achieved.shape[-1])
        return v_m - apply(self.achieved, "v_major", v_m)

    @property
    def major(self) -> Array:
        """Gain of the major velocity, shape (..., n, m1)."""
        return self._solution[0][0]

    @property
    def joint(self) -> Array:
        """Gain of the desired rates, shape (..., n, n)."""
        return self._solution[0][1]

    @property
    def secondary(self) -> Array:
        """Gain of the desired secondary velocity, shape (..., n, m2)."""
        return self._solution[0][2]

    @cached_property
    def achieved(self) -> Array:
        """Major velocity reached per major velocity commanded, shape (..., m1, m1)."""
        return check.frozen(on_axes(self.problem.major_jacobian @ self.major, self.problem.lead))

    @cached_property
    def largest_gain(self) -> Array:
        """Largest norm of the rates per unit norm of the major velocity alone, shape (...).

        In natural units where there are two kinds of either, see :attr:`characteristic_length`.
        """
        gain = self.major
        return read_only(largest(gain if self._measure is None else self._measure.of_gain(gain)))

    @property
    def characteristic_length(self) -> float | None:
        """Length with which angular and linear velocities, or rates, are measured in one norm.

        That of the mechanism; a stated `major_metric`, `joint_weight` or `tie_metric` goes before
        it. None where each is of one kind or nothing depends on it, and for a J given as a matrix.
        """
        if self._measure is None:
            return None
        is_met = self.status is Status.EXACT and self.limiting is None
        return self._measure.length(not is_met, self.problem.tie_metric.size > 0)

    @property
    def _measure(self) -> Measure | None:
        return None if self.kinematics is None else self.kinematics.measure(self.problem.S_m)

    @cached_property
    def amplification(self) -> Array:
        """Factor by which a relative error of the rates may become one of the major task, (...).

        It is the largest gain times the 2-norm of S_m J on the admissible rates, and at least 1
        where the major task is met. A servo that errs by 1 % of the rates moves the major task by
        up to this many percent of the motion commanded.
        """
        J = transposed(self.problem.S_m @ self.problem.admissible_jacobian)
        if self._measure is not None:
            J = self._measure.inverse.of_gain(J)
        return read_only(np.asarray(largest(J) * self.largest_gain))

    @property
    def gain_uncertainty(self) -> float:
        """Relative error that the accuracy of the geometry allows the largest gain.

        0 for a J given as a matrix, and where part of the major task is out of reach.
        """
        return (
            0.0 if self.kinematics is None else self.kinematics.gain_uncertainty(self.problem.S_m)
        )

    @property
    def closure_condition(self) -> float:
        """As in :class:`Manipulability`; 1 for a J given as a matrix."""
        return 1.0 if self.kinematics is None else self.kinematics.closure_condition

    @property
    def rank(self) -> Indices:
        """Rank of the major task on the admissible rates, shape (...)."""
        return np.broadcast_to(self._solution[1][1].rank, self.problem.lead)

    @cached_property
    def gap(self) -> Array:
        """Factor by which the rank threshold could change before any rank would, shape (...)."""
        gap = smallest_gap(self._solution[1])
        if self.kinematics is not None:
            gap = np.minimum(gap, self.kinematics.gap_of(self.problem.S_m, self.problem.S_s))
        return np.broadcast_to(gap, self.problem.lead)

    @property
    def status(self) -> Status:
        """What holds for every problem of the batch."""
        S_m = self.problem.S_m
        if not self._is_held:
            return Status.SELF_MOTION
        if not np.all(self.rank == len(S_m)):
            return Status.LEAST_SQUARES
        return Status.DAMPED if self.damping else Status.EXACT

    @property
    def _is_held(self) -> bool:
        """Whether no self-motion moves the major task, in any problem of the batch."""
        S_m, Q, tolerance = self.problem.S_m, self.problem.self_motion, self.problem.tolerance
        if self.kinematics is not None:
            return self.kinematics.holds(S_m)
        moved = ranked_svd(S_m @ Q, largest(S_m) * basis_scale(Q), tolerance)
        return not np.any(moved.rank > 0)

    @cached_property
    def _solution(self) -> tuple[tuple[Array, ...], list[RankedSvd]]:
        """Gains of the major velocity, the rates and the secondary velocity; rank decisions."""
        X, decisions = velocity_gains(self.problem, self.damping)
        X, m1, n = check.frozen(X), len(self.problem.S_m), X.shape[-2]
        return (X[..., :m1], X[..., m1 : m1 + n], X[..., m1 + n :]), decisions

    @property
    def ready(self) -> "Ready | None":
        """What compiled code takes to solve the same at another J; None where it does not apply."""
        problem = self.problem
        if self.damping or self.limiting or problem.lead or not problem.is_unconstrained:
            return None
        return Ready(problem[1:5], thresholds(problem.tolerance)[1])


class Ready(NamedTuple):
    """Arguments of `single_solve` in kernels.h.

    Attributes:
        weighed: Directions and weights.
        exact: Part of the rank tolerance for weights.
    """

    weighed: tuple[Array, ...]
    exact: float


def _bounded_by(box: Limits, limiting: Limiting | None) -> Limiting:
    """The same limits with another box of the rates."""
    return Limiting(box) if limiting is None else limiting._replace(box=box)


def _box(limiting: Limiting | None) -> Limits | None:
    return None if limiting is None else limiting.box


def _system(kinematics: Mechanism | None) -> Partition | None:
    """The mechanism by joints, where J follows from it; a subclass may know J alone."""
    return None if kinematics is None else vars(kinematics).get("system")


def _asked(problem: Problem, kinematics: Mechanism) -> Asked:
    """Problem 1 as levels: the major task, then rates and secondary task beside each other."""
    _, S_m, S_s, W1, W2, *_, M, T = problem[:9]
    if M is not None and len(M) > len(S_m):
        M = np.linalg.qr(M, mode="r")
    rates = Task.joints(W1 if len(W1) else np.zeros(W1.shape[1]))
    beside = [Task(S_s, W2)] if len(W2) else []
    levels = (Task(S_m, M),), (rates, *beside)
    return Asked.of(kinematics, levels, T if len(T) else None)
