"""Which failures a dither tells apart after a measuring time, with a model that is not exact.

Each failure leaves a phasor, Gaussian about its signature: the noise of a lock-in of length T,
disturbances as measured, and errors of the signature by uncertain parameters. The separation of two
is their Mahalanobis distance with the mean of both covariances. Two of equal covariance are
mistaken for each other with probability Phi(-d / 2); in general with at most exp(-d^2 / 8) / 2
(Bhattacharyya's bound; Fukunaga, Introduction to Statistical Pattern Recognition, 1990, section
3.4).
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse.csgraph import connected_components

import argument_checks as check
from argument_checks import Array, Mask
from ftc.fdi.design.signatures import (
    HALF,
    Complex,
    FaultResponses,
    driven,
    fault_responses,
    single_faults,
)
from ftc.fdi.dither import Dither
from ftc.fdi.fault_model import KINDS, Fault, NominalModel
from ftc.fdi.uncertainty import CERTAIN, Uncertainty
from kernels import lib, pointer

ALIKE = 6.18
"""Below it more than one of a thousand is mistaken: Phi(-d / 2) = 1e-3."""

ACCURACY = 1e-6
"""Part of a distance: the root of a difference of energies, maximized by an iteration."""

_ROUND_OFF = 1e-13


_LOST = (0.01, 0.95)
"""A weak actuator has lost between these parts of its force."""


@dataclass(frozen=True)
class Conditions:
    """Under which failures are to be told apart.

    Attributes:
        time_s: Length of the lock-in, one period of the dither or more, after what the failure
            excites has decayed.
        uncertainty: Of the model.
        disturbance: One-sided power spectral density of the outputs at the dither's frequency, the
            sensors' white noise apart, real, in the outputs' units squared per Hz, shape (p, p), or
            (F, p, p) for F frequencies; None is none.

    Raises:
        ValueError, TypeError: Of another kind than that.
    """

    time_s: float
    uncertainty: Uncertainty = CERTAIN
    disturbance: Array | None = None

    def __post_init__(self) -> None:
        check.positive("time_s", self.time_s)
        check.instance("uncertainty", self.uncertainty, Uncertainty)
        if self.disturbance is not None:
            S = check.batch("disturbance", self.disturbance)
            if S.ndim > 3 or not S.size or S.shape[-1] != S.shape[-2]:
                raise ValueError(f"disturbance must be (p, p) or (F, p, p), got shape {S.shape}")
            for each in S if S.ndim == 3 else [S]:
                check.positive_semidefinite("disturbance", each, S.shape[-1])
            object.__setattr__(self, "disturbance", check.frozen(S))

    def noise(self, nominal: NominalModel, name: str, frequency_hz: Array) -> Array:
        """Covariance of real and imaginary parts of whitened outputs' phasors, shape (F, p, p).

        `name` is that of the frequencies, for errors.
        """
        p, frequencies, slowest = len(nominal.noise), len(frequency_hz), 1 / frequency_hz.min()
        if self.time_s < slowest * (1 - 1e-9):
            raise ValueError(
                f"time_s must be at least a period of {name}, {slowest:g} s, got {self.time_s}"
            )
        S = np.zeros((p, p)) if self.disturbance is None else self.disturbance
        if S.shape not in ((p, p), (frequencies, p, p)):
            expected = f"({p}, {p}) or ({frequencies}, {p}, {p})"
            raise ValueError(f"disturbance must have shape {expected}, got {S.shape}")
        white = 2 * nominal.period_s * np.eye(p)
        whitened = S / np.outer(nominal.noise, nominal.noise)
        return np.broadcast_to((white + whitened) / self.time_s, (frequencies, p, p))


@dataclass(frozen=True)
class Separations:
    """Distances between failures, in standard deviations.

    Attributes:
        faults: What may happen, 3 n of them; see :func:`ftc.fdi.design.signatures.single_faults`.
        distance: Of what happens (rows) from each explanation (columns), a weak actuator's at its
            most similar loss of force, shape (3 n, 3 n).
        from_none: Of what happens from no failure, shape (3 n,).
    """

    faults: tuple[Fault, ...]
    distance: Array
    from_none: Array

    def __post_init__(self) -> None:
        self.distance.setflags(write=False)
        self.from_none.setflags(write=False)

    @property
    def between_actuators(self) -> Array:
        """Least distance of any failures of two actuators, shape (n, n), symmetric.

        On the diagonal: of any failure of the actuator from no failure.
        """
        n, kinds = len(self.faults) // len(KINDS), len(KINDS)
        least = self._both_ways().reshape(n, kinds, n, kinds).min(axis=(1, 3))
        np.fill_diagonal(least, self.from_none.reshape(n, kinds).min(axis=1))
        return least

    @property
    def least(self) -> float:
        """The least of all failures from those of another actuator, and from no failure."""
        return float(self.between_actuators.min())

    def isolable(self, threshold: float = ALIKE) -> tuple[Fault, ...]:
        """Failures further than that from no failure and from any failure of another actuator."""
        number = np.array([fault.actuator for fault in self.faults])
        others = np.where(number[:, None] != number, self.distance, np.inf).min(axis=1)
        apart = np.minimum(others, self.from_none) >= check.positive("threshold", threshold)
        return tuple(self.faults[k] for k in np.flatnonzero(apart))

    def isolates(self, actuator: int, kind: str) -> bool:
        """Whether a failure is among those that are isolable; a loose actuator counts as free."""
        kind = "free" if kind == "loose" else kind
        return any((each.actuator, each.kind) == (actuator, kind) for each in self.isolable())

    def alike_actuators(self, threshold: float = ALIKE) -> tuple[tuple[int, ...], ...]:
        """Groups of two or more actuators, in one chain of pairs nearer than the threshold."""
        return _groups(self.between_actuators < check.positive("threshold", threshold))

    def alike_kinds(self, threshold: float = ALIKE) -> tuple[tuple[Fault, ...], ...]:
        """Groups of two or more failures of the same actuator, likewise."""
        close = self._both_ways() < check.positive("threshold", threshold)
        number = np.array([fault.actuator for fault in self.faults])
        found = _groups(close & (number[:, None] == number))
        return tuple(tuple(self.faults[k] for k in group) for group in found)

    def undetected(self, threshold: float = ALIKE) -> tuple[Fault, ...]:
        """Failures that are nearer to no failure than the threshold."""
        near = self.from_none < check.positive("threshold", threshold)
        return tuple(self.faults[k] for k in np.flatnonzero(near))

    def _both_ways(self) -> Array:
        return np.minimum(self.distance, self.distance.T)


def separations(nominal: NominalModel, dither: Dither, conditions: Conditions) -> Separations:
    """Distances of all failures of one actuator in the steady state of a dither.

    Args:
        nominal: The plant without failures, and what is measured of it.
        dither: With n directions and a frequency below half the control frequency. Below the
            bandwidth of a loop the commands that are sent differ from it after a failure.
        conditions: Measuring time, uncertainty, disturbance.

    Raises:
        ValueError, TypeError: An argument of the wrong shape or size, or an undamped mode at the
            frequency.
    """
    commanded, at_hz = driven(nominal, dither)
    noise = check.instance("conditions", conditions, Conditions).noise(
        nominal, "frequency_hz", at_hz
    )
    responses = fault_responses(nominal, at_hz, conditions.uncertainty)
    return separations_at(responses, 0, commanded, noise[0])


def separations_at(
    responses: FaultResponses, k: int, commanded: Array, noise: Array
) -> Separations:
    """The same from responses, at the k-th of their frequencies.

    Args:
        responses: Of the failures.
        k: Which frequency.
        commanded: Amplitudes (n,).
        noise: Covariance of each part of the whitened phasors, shape (p, p).
    """
    change = _parts(responses.change[k] @ commanded)  # (n, 1 + M, 2 p)
    errors = _parts(responses.errors[k] @ commanded)  # (n, 1 + M, E, 2 p)
    C = errors.swapaxes(-1, -2) @ errors
    S = np.kron(np.eye(2), noise)
    happens, happens_C = (_happening(each, responses.parts) for each in (change, C))
    first, last = _explanations(change, responses.parts)
    _, last_C = _explanations(C, responses.parts)  # errors of the larger loss, to be safe
    one = not errors.size
    if one:  # one covariance for all, factored once
        happens_C, last_C = np.zeros((2, 1, *S.shape))
    distance = np.empty((len(happens), len(first)))
    own, other = (_regular(S + each) / 2 for each in (happens_C, last_C))
    d = len(S)
    given = [pointer(each) for each in (happens, first, last - first, own, other)]
    lib.to_segments(
        *distance.shape, d, *given, one, pointer(np.empty(lib.segments_room(d))), pointer(distance)
    )
    n, kinds = len(change), len(KINDS)
    by_actuator = distance[:, :-1].reshape(kinds * n, n, -1)
    weak = by_actuator[..., 2:].min(axis=-1, keepdims=True)
    full = np.concatenate([by_actuator[..., :2], weak], axis=-1).reshape(kinds * n, kinds * n)
    np.fill_diagonal(full, 0.0)
    return Separations(single_faults(n), *_without_round_off(full, distance[:, -1]))


def _without_round_off(*distances: Array) -> list[Array]:
    """Zero where a distance is the root of what cancels."""
    noise = np.sqrt(_ROUND_OFF) * max(d.max(initial=0.0) for d in distances)
    return [np.where(d > noise, d, 0.0) for d in distances]


def _regular(C: Array) -> Array:
    """With so much more noise that round-off does not make it singular."""
    trace = np.trace(C, axis1=-2, axis2=-1)[..., None, None]
    return C + _ROUND_OFF * trace * np.eye(C.shape[-1])


def _parts(phasors: Complex) -> Array:
    """Real and imaginary parts beside each other, (..., 2 p)."""
    return np.concatenate([phasors.real, phasors.imag], axis=-1)


def _lost(of: Array, parts: Array, amounts: Array) -> Array:
    """What (n, 1 + M, ...), locked and after losses, is after other losses; linear in between."""
    nodes = np.concatenate([np.zeros_like(of[:, :1]), of[:, 1:]], axis=1)
    places = np.interp(amounts, [0.0, *parts], np.arange(len(parts) + 1))
    low = np.minimum(places.astype(int), len(parts) - 1)
    part = (places - low).reshape(-1, *(1,) * (of.ndim - 2))
    return (1 - part) * nodes[:, low] + part * nodes[:, low + 1]


def _happening(of: Array, parts: Array) -> Array:
    """Of what (n, 1 + M, ...) is of each model, what is of each of `single_faults`."""
    half = _lost(of, parts, np.array([1 - HALF]))
    return np.concatenate([of[:, :1], of[:, -1:], half], axis=1).reshape(-1, *of.shape[2:])


def _explanations(of: Array, parts: Array) -> tuple[Array, Array]:
    """The same at the two ends of each explanation: locked, free, intervals of loss; then none."""
    ends = np.array([_LOST[0], *parts[(parts > _LOST[0]) & (parts < _LOST[1])], _LOST[1]])
    weak, fixed, none = _lost(of, parts, ends), of[:, [0, -1]], np.zeros((1, *of.shape[2:]))
    first, last = (
        np.concatenate([fixed, each], axis=1).reshape(-1, *of.shape[2:])
        for each in (weak[:, :-1], weak[:, 1:])
    )
    return np.concatenate([first, none]), np.concatenate([last, none])


def _groups(alike: Mask) -> tuple[tuple[int, ...], ...]:
    """Connected components of two or more."""
    count, label = connected_components(alike, directed=False)
    groups = [tuple(np.flatnonzero(label == k).tolist()) for k in range(count)]
    return tuple(group for group in groups if len(group) > 1)
