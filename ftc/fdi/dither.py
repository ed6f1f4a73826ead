"""Dither: a small motion in the null space of the task that separates similar failures.

It does not move the task while all actuators work; if one does not follow, its column of the task
Jacobian is not cancelled.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
import scipy.linalg
import scipy.optimize
from numpy.typing import ArrayLike

import argument_checks as check
from argument_checks import Array, Mask
from argument_checks.ties import ascending, exceeds, greatest
from ftc.fdi.fault_model import KINDS, NominalModel, fault_model
from ftc.fdi.separation import (
    ACCURACY,
    SEPARATION_THRESHOLD,
    Complex,
    FaultResponses,
    Separations,
    checked_frequencies,
    fault_responses,
    separations_at,
    steady_states,
)
from ftc.fdi.uncertainty import CERTAIN, Uncertainty
from prioritized import canonical_basis

_DEPENDENT, _ROUND_OFF = 1e-10, 1e-10
"""Relative tolerances for linearly dependent directions and for sums that cancel."""

_STARTS, _REFINED, _ITERATIONS = 16, 4, 30
"""Random directions per dimension, number of the best that are improved, and most steps of each. A
quarter and four times as many give the same dither for a platform and a hand, and one up to a tenth
worse or better for an arm with four free directions; more steps have no effect."""

_FAR = 1e3
"""Bound of the search variables in units of their start, against overflow."""


@dataclass(frozen=True)
class Dither:
    """Sinusoid along one direction of actuator displacements.

    Attributes:
        amplitude: Amplitude in units of `direction`.
        direction: Actuator displacements, shape (n,); the mapping keeps their null-space part.
        offset: Mean displacements, shape (n,), or one number for all.
    """

    amplitude: float
    frequency_hz: float
    direction: tuple[float, ...]
    offset: tuple[float, ...] | float = 0.0

    def __post_init__(self) -> None:
        check.number("amplitude", self.amplitude, 0.0)
        check.number("frequency_hz", self.frequency_hz, 0.0)
        direction = check.array("direction", self.direction, None)
        offset = check.array("offset", self.offset)
        if offset.ndim:
            offset = check.array("offset", offset, len(direction))
        swings_about = tuple(offset.tolist()) if offset.ndim else float(offset)
        vars(self).update(direction=tuple(direction.tolist()), offset=swings_about)

    def at(self, time_s: float) -> Array:
        """Return the desired actuator displacements (n,) at a time [s]."""
        angle = 2 * math.pi * self.frequency_hz * check.number("time_s", time_s)
        offset, sinusoid = self._arrays
        return offset + math.sin(angle) * sinusoid

    @cached_property
    def _arrays(self) -> tuple[Array, Array]:
        return np.array(self.offset), self.amplitude * np.array(self.direction)


def separations(
    nominal: NominalModel, dither: Dither, time_s: float, uncertainty: Uncertainty = CERTAIN
) -> Separations:
    """Return the distances between all single failures after `time_s` of a steady dither.

    Its frequency is below half the control frequency. Below the bandwidth of a loop the actual
    commands differ from the dither after a failure.

    Raises:
        ValueError: An argument is invalid, or the frequency is that of an undamped mode.
    """
    commanded, at_hz = _driven(nominal, dither)
    return separations_at(fault_responses(nominal, at_hz, time_s, uncertainty), 0, commanded)


def _driven(nominal: NominalModel, dither: Dither) -> tuple[Array, Array]:
    """Check a dither; return the amplitudes (n,) of its commands and its frequency, (1,)."""
    check.instance("nominal", nominal, NominalModel)
    check.instance("dither", dither, Dither)
    direction = check.array("dither.direction", dither.direction, nominal.actuators)
    commanded = check.array("dither", dither.amplitude * direction, nominal.actuators)
    hz = check.number("dither.frequency_hz", dither.frequency_hz, check.SMALLEST)
    return commanded, checked_frequencies(nominal, "dither.frequency_hz", [hz])


@dataclass(frozen=True)
class AddedSensor:
    """Separations with one more sensor.

    Attributes:
        separations: Distances between failures with this sensor.
        indistinguishable: Number of pairs of actuators, and of actuators with an undetected
            failure, below :data:`ftc.fdi.separation.SEPARATION_THRESHOLD`.
    """

    name: str
    separations: Separations
    indistinguishable: int


def ranked_sensors(
    nominal: NominalModel,
    candidates: Mapping[str, tuple[ArrayLike, float]],
    dither: Dither,
    time_s: float,
    uncertainty: Uncertainty = CERTAIN,
) -> tuple[AddedSensor, ...]:
    """Rank additional sensors by indistinguishable pairs, then by the least separation.

    The best sensor is first; equally good ones keep their order. A candidate is a pair of its
    output row per state (s,) and the standard deviation of one sample; the other arguments are
    those of :func:`ftc.fdi.separations`.
    """
    commanded, at_hz = _driven(nominal, dither)
    check.instance("candidates", candidates, Mapping)
    # The response of a sensor does not depend on the others: compute all at once.
    responses = fault_responses(_with_sensors(nominal, candidates), at_hz, time_s, uncertainty)
    measured, sensors = len(nominal.noise), []
    for k, name in enumerate(candidates):
        rows = [*range(measured), measured + k]
        change, errors = responses.change[..., rows, :], responses.errors[..., rows, :]
        separated = separations_at(replace(responses, change=change, errors=errors), 0, commanded)
        indistinguishable = int(np.triu(separated.between_actuators < SEPARATION_THRESHOLD).sum())
        sensors.append(AddedSensor(name, separated, indistinguishable))
    pairs = [sensor.indistinguishable for sensor in sensors]
    least = [-sensor.separations.least for sensor in sensors]
    return tuple(sensors[k] for k in ascending(pairs, least, accuracy=ACCURACY))


def _with_sensors(
    nominal: NominalModel, candidates: Mapping[str, tuple[ArrayLike, float]]
) -> NominalModel:
    """Return the plant with the outputs of all candidates after its own outputs."""
    rows, sigmas = [nominal.plant.C], [*nominal.noise]
    for candidate in candidates.values():
        try:
            row, noise = candidate
        except (TypeError, ValueError):
            raise ValueError(
                "candidates must be pairs of a row and its noise, got "
                + check.short_repr(candidate)
            ) from None
        rows.append(check.array("candidates", row, nominal.plant.nstates))
        sigmas.append(check.number("candidates", noise, check.SMALLEST))
    return nominal.measured(np.vstack(rows), sigmas)


@dataclass(frozen=True)
class Cost:
    """Largest motions that a dither may cause without a failure.

    Attributes:
        largest_displacement: Largest commanded and actual displacement of any actuator; for an
            actuator that works against a spring the command is also its force.
        task: Task that has to stand still, rows per state of the plant, shape (m, s).
        largest_task_motion: Largest motion of each row, a number or shape (m,). A direction in the
            null space moves the task by dynamics only.
    """

    largest_displacement: float
    task: Array
    largest_task_motion: ArrayLike

    def __post_init__(self) -> None:
        check.number("largest_displacement", self.largest_displacement, check.SMALLEST)
        task = check.frozen(check.array("task", self.task, None, None))
        most = check.array("largest_task_motion", self.largest_task_motion, copy=True)
        if most.shape not in ((), (len(task),)) or (most <= 1e-120).any():
            raise ValueError(
                f"largest_task_motion must be one positive number or {len(task)}, got "
                f"{check.short_repr(self.largest_task_motion)}"
            )
        object.__setattr__(self, "task", task)
        object.__setattr__(self, "largest_task_motion", check.frozen(most))

    def limits(self, nominal: NominalModel, frequencies_hz: Array) -> Complex:
        """Return rows per command whose absolute values may be at most one, (F, 2 n + m, n)."""
        n, s = nominal.displacement.shape
        rows = np.vstack([nominal.displacement, check.array("task", self.task, None, s)])
        states = steady_states([fault_model(nominal)], nominal.period_s, frequencies_hz)
        commanded = np.broadcast_to(np.eye(n), (len(frequencies_hz), n, n))
        task = np.broadcast_to(self.largest_task_motion, len(self.task))
        most = np.concatenate([np.full(2 * n, self.largest_displacement), task])
        return np.concatenate([commanded, rows @ states[:, 0]], axis=1) / most[:, None]


@dataclass(frozen=True)
class DitherDesign:
    """Designed dither and the separations that it achieves.

    Attributes:
        dither: Dither, with amplitude zero if the task has no null space.
        separations: Distances between failures with this dither.
        separable: Mask (n, n) of the pairs of actuators that some direction and frequency of the
            search separated, on the diagonal from no failure; their least separation was maximized.
            All pairs if there was none.
        task_motion: Amplitude of each row of the task without a failure, shape (m,).
        displacement: Amplitude of each actuator's motion, shape (n,).
    """

    dither: Dither
    separations: Separations
    separable: Mask
    task_motion: Array
    displacement: Array

    def __post_init__(self) -> None:
        check.lock(self)


def designed_dither(
    nominal: NominalModel,
    freedom: ArrayLike,
    frequencies_hz: ArrayLike,
    cost: Cost,
    time_s: float,
    uncertainty: Uncertainty = CERTAIN,
) -> DitherDesign:
    """Design the dither that maximizes the least separation between actuators.

    This is active fault diagnosis by an auxiliary input (Campbell and Nikoukhah, Auxiliary Signal
    Design for Failure Detection, 2004). The problem is not convex: the best of reproducible random
    directions at each frequency are improved by sequential quadratic programming, without a proof
    of optimality. The separation grows with the amplitude, which is the largest allowed.

    Args:
        nominal: Plant without failures, and its outputs.
        freedom: Directions in the null space of the major task that closed loops admit, the columns
            of a matrix (n, r); they may be dependent, such as a mapping's gain `joint`.
        frequencies_hz: Candidate frequencies, between zero and half the control frequency, (F,).
        cost: Largest motions that the dither may cause.
        time_s: Time in which failures have to be separated, at least a period of the dither.
        uncertainty: Uncertainty of the model.

    Raises:
        ValueError: An argument is invalid, or a frequency is that of an undamped mode.
    """
    responses = fault_responses(nominal, frequencies_hz, time_s, uncertainty)
    hz, n = responses.frequencies_hz, nominal.actuators
    limits = check.instance("cost", cost, Cost).limits(nominal, hz)
    k, u, separable = _Search(_basis(freedom, n), limits, responses).best()
    amplitude = float(np.abs(u).max())
    direction = u / amplitude if amplitude else u
    terms = limits[k] * u
    moved, parts = np.abs(terms.sum(axis=1)), np.abs(terms).sum(axis=1)
    moved = np.where(moved > _ROUND_OFF * parts, moved, 0.0)  # a sum that cancels is zero
    return DitherDesign(
        Dither(amplitude, float(hz[k]), tuple(direction.tolist())),
        separations_at(responses, k, u),
        separable,
        moved[2 * n :] * np.asarray(cost.largest_task_motion),
        moved[n : 2 * n] * cost.largest_displacement,
    )


def _basis(freedom: ArrayLike, n: int) -> Array:
    """Return the canonical orthonormal basis (n, r) of the span of the columns."""
    N = check.array("freedom", freedom, copy=True)
    if N.ndim != 2 or len(N) != n:
        raise ValueError(f"freedom must be a matrix with {n} rows, got shape {N.shape}")
    if not N.any():
        return np.zeros((n, 0))
    return canonical_basis(scipy.linalg.orth(N, rcond=_DEPENDENT))


@dataclass(frozen=True)
class _Search:
    """Search for a dither at one of F frequencies by random starts and local improvement.

    Commands are `basis` (n, r) x; the absolute values of `limits` (F, l, n) times them are at most
    one.
    """

    basis: Array
    limits: Complex
    responses: FaultResponses

    def best(self) -> tuple[int, Array, Mask]:
        """Return the index of the frequency, the commands (n,) and `DitherDesign.separable`."""
        n, r = self.basis.shape
        if not r:
            return 0, np.zeros(n), np.ones((n, n), dtype=bool)
        starts = np.random.default_rng(0).normal(size=(_STARTS * r, r))
        candidates = [(k, self._largest(k, x)) for k in range(len(self.limits)) for x in starts]
        values = [self._between(k, x) for k, x in candidates]
        separable = np.max(values, axis=0) >= SEPARATION_THRESHOLD
        if not separable.any():
            separable[:] = True
        least = np.array([pairs[separable].min() for pairs in values])
        chosen = [candidates[i] for i in ascending(-least, accuracy=ACCURACY)[:_REFINED]]
        refined = [self._improved(k, x, separable) for k, x in chosen]
        _, k, x = refined[greatest([separation for separation, *_ in refined], ACCURACY)]
        u = self.basis @ x
        return k, u * np.sign(u[greatest(np.abs(u), ACCURACY)]), separable

    def _between(self, k: int, x: Array) -> Array:
        """Return the least separations of two actuators (n, n) at the k-th frequency along x."""
        return separations_at(self.responses, k, self.basis @ x).between_actuators

    def _largest(self, k: int, x: Array) -> Array:
        """Scale x to the largest size within the limits."""
        return x / np.abs(self.limits[k] @ (self.basis @ x)).max()

    def _improved(self, k: int, x: Array, separable: Mask) -> tuple[float, int, Array]:
        """Return the improved least separation, k and x: maximize the minimum within the limits."""
        initial, size = self._between(k, x)[separable].min(), float(np.linalg.norm(x))
        if not initial:  # by symmetry: there is no direction of ascent
            return initial, k, x
        start = np.append(x / size, 1.0)
        end = scipy.optimize.minimize(
            lambda xt: -xt[-1],
            start,
            jac=lambda xt: -np.eye(len(xt))[-1],
            bounds=[(-_FAR, _FAR)] * len(start),
            constraints={"type": "ineq", "fun": self._slack(k, size, initial, separable)},
            method="SLSQP",
            options={"maxiter": _ITERATIONS},
        ).x[:-1]
        if not (np.isfinite(end).all() and end.any()):
            return initial, k, x
        improved = self._largest(k, end)
        separation = self._between(k, improved)[separable].min()
        is_better = exceeds(separation, initial, ACCURACY)
        return (separation, k, improved) if is_better else (initial, k, x)

    def _slack(
        self, k: int, size: float, initial: float, separable: Mask
    ) -> Callable[[Array], Array]:
        """Return the function of [x / size; t] whose components must not be negative.

        t is in units of `initial`. All distances are constraints, since the minimum of each pair is
        not smooth.
        """
        number = np.repeat(np.arange(len(separable)), len(KINDS))
        others = separable[number[:, None], number] & (number[:, None] != number)
        detected = separable.diagonal()[number]

        @lru_cache(maxsize=2)  # finite differences along t use the same x
        def distances_and_slacks(x: bytes) -> tuple[Array, Array]:
            u = size * self.basis @ np.nan_to_num(np.frombuffer(x))  # a failed step is NaN
            result = separations_at(self.responses, k, u)
            distances = np.concatenate([result.distance[others], result.from_none[detected]])
            return distances / initial, 1 - np.abs(self.limits[k] @ u) ** 2

        def slack(xt: Array) -> Array:
            distances, slacks = distances_and_slacks(xt[:-1].tobytes())
            return np.concatenate([distances - xt[-1], slacks])

        return slack
