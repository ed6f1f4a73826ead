"""A small motion in the null space of the task, which distinguishes similar failures.

While all actuators work, the task does not see it; an actuator that does not follow leaves its own
column of the task Jacobian uncancelled.
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
    ALIKE,
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
"""Parts of the largest: directions that depend on others, and sums that cancel."""

_STARTS, _REFINED, _ITERATIONS = 16, 4, 30
"""Random directions per dimension, how many of the best are improved, and most steps of each. A
quarter of them and four times as many find the same dither for a platform and a hand, and one up to
a tenth worse or better for an arm with four free directions; more steps change nothing."""

_FAR = 1e3
"""How far a step of the search may go, in sizes of its start, so that nothing overflows."""


@dataclass(frozen=True)
class Dither:
    """A sinusoid along one direction of actuator displacements.

    Attributes:
        amplitude: In units of `direction`.
        direction: Shape (n,); the mapping keeps the part that leaves the task alone.
        offset: Displacements about which it swings, shape (n,), or one for all.
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
        """Desired actuator displacements at a time, shape (n,)."""
        angle = 2 * math.pi * self.frequency_hz * check.number("time_s", time_s)
        offset, swing = self._arrays
        return offset + math.sin(angle) * swing

    @cached_property
    def _arrays(self) -> tuple[Array, Array]:
        return np.array(self.offset), self.amplitude * np.array(self.direction)


def separations(
    nominal: NominalModel, dither: Dither, time_s: float, uncertainty: Uncertainty = CERTAIN
) -> Separations:
    """Distances of all failures of one actuator in so much time of a dither's steady state.

    Its frequency is below half the control frequency. Below the bandwidth of a loop the commands
    that are sent differ from the dither after a failure.

    Raises:
        ValueError: Besides, the frequency is that of an undamped mode.
    """
    commanded, at_hz = _driven(nominal, dither)
    return separations_at(fault_responses(nominal, at_hz, time_s, uncertainty), 0, commanded)


def _driven(nominal: NominalModel, dither: Dither) -> tuple[Array, Array]:
    """Amplitudes (n,) of the commands of a dither, and its frequency, shape (1,); checked."""
    check.instance("nominal", nominal, NominalModel)
    check.instance("dither", dither, Dither)
    direction = check.array("dither.direction", dither.direction, nominal.actuators)
    commanded = check.array("dither", dither.amplitude * direction, nominal.actuators)
    hz = check.number("dither.frequency_hz", dither.frequency_hz, check.SMALLEST)
    return commanded, checked_frequencies(nominal, "dither.frequency_hz", [hz])


@dataclass(frozen=True)
class AddedSensor:
    """What is separated with one more sensor, and how many are left alike.

    These are pairs of actuators, and actuators with a failure that stays undetected, below
    :data:`ftc.fdi.separation.ALIKE`.
    """

    name: str
    separations: Separations
    alike: int


def ranked_sensors(
    nominal: NominalModel,
    candidates: Mapping[str, tuple[ArrayLike, float]],
    dither: Dither,
    time_s: float,
    uncertainty: Uncertainty = CERTAIN,
) -> tuple[AddedSensor, ...]:
    """Rank further sensors by what each leaves alike, then by the least separation; best first.

    Those that are equally good, as by symmetry, stay in their order. Of each candidate: what it
    measures, a row per state (s,), and the standard deviation of one sample; the plant and the
    dither are as of :func:`ftc.fdi.separations`.
    """
    commanded, at_hz = _driven(nominal, dither)
    check.instance("candidates", candidates, Mapping)
    # What a sensor shows depends on no other: of all of them at once.
    every = _with_sensors(nominal, candidates)
    responses = fault_responses(every, at_hz, time_s, uncertainty)
    own, found = len(nominal.noise), []
    for k, name in enumerate(candidates):
        seen = [*range(own), own + k]
        change, errors = responses.change[..., seen, :], responses.errors[..., seen, :]
        apart = separations_at(replace(responses, change=change, errors=errors), 0, commanded)
        alike = int(np.triu(apart.between_actuators < ALIKE).sum())
        found.append(AddedSensor(name, apart, alike))
    alike, least = [each.alike for each in found], [-each.separations.least for each in found]
    return tuple(found[k] for k in ascending(alike, least, accuracy=ACCURACY))


def _with_sensors(
    nominal: NominalModel, candidates: Mapping[str, tuple[ArrayLike, float]]
) -> NominalModel:
    """The plant with all candidates measured, after what is measured already."""
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
    """What a dither may cost while nothing has failed.

    Attributes:
        largest_displacement: Of any actuator, commanded and made; for an actuator that works
            against a spring the command is also its force.
        task: What is to stand still, rows per state of the plant, shape (m, s).
        largest_task_motion: Of each row, a number or shape (m,). A direction in the null space
            moves the task by dynamics alone.
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
        """Rows per command that may reach one, shape (F, 2 n + m, n)."""
        n, s = nominal.displacement.shape
        rows = np.vstack([nominal.displacement, check.array("task", self.task, None, s)])
        states = steady_states([fault_model(nominal)], nominal.period_s, frequencies_hz)
        commanded = np.broadcast_to(np.eye(n), (len(frequencies_hz), n, n))
        task = np.broadcast_to(self.largest_task_motion, len(self.task))
        most = np.concatenate([np.full(2 * n, self.largest_displacement), task])
        return np.concatenate([commanded, rows @ states[:, 0]], axis=1) / most[:, None]


@dataclass(frozen=True)
class DitherDesign:
    """A dither, and what it separates.

    Attributes:
        dither: Of amplitude zero where the task leaves no freedom.
        separable: Pairs of actuators that some direction and frequency of the search separated, and
            on the diagonal actuators that one separated from no failure, shape (n, n); the least
            separation of these was maximized. All, where none was.
        task_motion: Amplitude of each row of the task while nothing has failed, shape (m,).
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
    """Design the dither of the largest least separation between actuators.

    Active fault diagnosis by an auxiliary input (Campbell and Nikoukhah, Auxiliary Signal Design
    for Failure Detection, 2004). The problem is not convex. Random directions at each frequency,
    always the same, are compared, and the best of all improved by sequential quadratic programming:
    a good dither, without a proof that there is no better. The separation grows with the amplitude,
    which is therefore the largest allowed.

    Args:
        nominal: The plant without failures, and what is measured of it.
        freedom: Directions that the major task leaves, and closed loops allow, the columns of a
            matrix (n, r); they may depend on each other, as those of a mapping's gain `joint` do.
        frequencies_hz: To choose from, above zero and below half the control frequency, shape (F,).
        cost: What the dither may cost.
        time_s: In which failures are to be told apart, a period of the dither or more.
        uncertainty: Of the model.

    Raises:
        ValueError: Besides, a frequency is that of an undamped mode.
    """
    responses = fault_responses(nominal, frequencies_hz, time_s, uncertainty)
    hz, n = responses.frequencies_hz, nominal.actuators
    limits = check.instance("cost", cost, Cost).limits(nominal, hz)
    k, u, separable = _Search(_basis(freedom, n), limits, responses).best()
    amplitude = float(np.abs(u).max())
    direction = u / amplitude if amplitude else u
    terms = limits[k] * u
    moved, parts = np.abs(terms.sum(axis=1)), np.abs(terms).sum(axis=1)
    moved = np.where(moved > _ROUND_OFF * parts, moved, 0.0)  # where they cancel to round-off
    return DitherDesign(
        Dither(amplitude, float(hz[k]), tuple(direction.tolist())),
        separations_at(responses, k, u),
        separable,
        moved[2 * n :] * np.asarray(cost.largest_task_motion),
        moved[n : 2 * n] * cost.largest_displacement,
    )


def _basis(freedom: ArrayLike, n: int) -> Array:
    """Orthonormal basis (n, r) of the span of columns, the same however that is given."""
    N = check.array("freedom", freedom, copy=True)
    if N.ndim != 2 or len(N) != n:
        raise ValueError(f"freedom must be a matrix with {n} rows, got shape {N.shape}")
    if not N.any():
        return np.zeros((n, 0))
    return canonical_basis(scipy.linalg.orth(N, rcond=_DEPENDENT))


@dataclass(frozen=True)
class _Search:
    """Search for a dither at one of F frequencies: random directions, the best improved.

    Commands are `basis` (n, r) x; no row per command in `limits` (F, l, n) may exceed one.
    """

    basis: Array
    limits: Complex
    responses: FaultResponses

    def best(self) -> tuple[int, Array, Mask]:
        """Number of the frequency, commands (n,), and pairs as `DitherDesign.separable`."""
        n, r = self.basis.shape
        if not r:
            return 0, np.zeros(n), np.ones((n, n), dtype=bool)
        starts = np.random.default_rng(0).normal(size=(_STARTS * r, r))
        tried = [(k, self._largest(k, x)) for k in range(len(self.limits)) for x in starts]
        found = [self._between(k, x) for k, x in tried]
        separable = np.max(found, axis=0) >= ALIKE
        if not separable.any():
            separable[:] = True
        least = np.array([each[separable].min() for each in found])
        chosen = [tried[i] for i in ascending(-least, accuracy=ACCURACY)[:_REFINED]]
        refined = [self._improved(k, x, separable) for k, x in chosen]
        _, k, x = refined[greatest([reached for reached, *_ in refined], ACCURACY)]
        u = self.basis @ x
        return k, u * np.sign(u[greatest(np.abs(u), ACCURACY)]), separable

    def _between(self, k: int, x: Array) -> Array:
        """Least separations of two actuators (n, n) at the k-th frequency along x."""
        return separations_at(self.responses, k, self.basis @ x).between_actuators

    def _largest(self, k: int, x: Array) -> Array:
        """As far along x as the limits allow."""
        return x / np.abs(self.limits[k] @ (self.basis @ x)).max()

    def _improved(self, k: int, x: Array, separable: Mask) -> tuple[float, int, Array]:
        """Least separation, and where: max t with all separations t or more, within the limits."""
        before, size = self._between(k, x)[separable].min(), float(np.linalg.norm(x))
        if not before:  # by symmetry: nothing tells where to go
            return before, k, x
        start = np.append(x / size, 1.0)
        end = scipy.optimize.minimize(
            lambda xt: -xt[-1],
            start,
            jac=lambda xt: -np.eye(len(xt))[-1],
            bounds=[(-_FAR, _FAR)] * len(start),
            constraints={"type": "ineq", "fun": self._room(k, size, before, separable)},
            method="SLSQP",
            options={"maxiter": _ITERATIONS},
        ).x[:-1]
        if not (np.isfinite(end).all() and end.any()):
            return before, k, x
        after = self._largest(k, end)
        reached = self._between(k, after)[separable].min()
        return (reached, k, after) if exceeds(reached, before, ACCURACY) else (before, k, x)

    def _room(
        self, k: int, size: float, before: float, separable: Mask
    ) -> Callable[[Array], Array]:
        """What is not to become negative, of [x / size; t], with t in units of `before`.

        All distances, not the least of each pair, which would have kinks.
        """
        number = np.repeat(np.arange(len(separable)), len(KINDS))
        others = separable[number[:, None], number] & (number[:, None] != number)
        detected = separable.diagonal()[number]

        @lru_cache(maxsize=2)  # differences along t, and of the point before, are of the same x
        def apart_and_within(x: bytes) -> tuple[Array, Array]:
            u = size * self.basis @ np.nan_to_num(np.frombuffer(x))  # a step that failed is NaN
            found = separations_at(self.responses, k, u)
            apart = np.concatenate([found.distance[others], found.from_none[detected]])
            return apart / before, 1 - np.abs(self.limits[k] @ u) ** 2

        def room(xt: Array) -> Array:
            apart, within = apart_and_within(xt[:-1].tobytes())
            return np.concatenate([apart - xt[-1], within])

        return room
