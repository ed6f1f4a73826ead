"""Separability of failures by an uncertain linear model, predicted before any run.

:func:`separations_at` applies to the steady state of a dither, :func:`isolability` to any motion.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse.csgraph import connected_components

import argument_checks as check
from argument_checks import Array
from ftc.fdi.bank import Cause, HypothesisBank, hypothesis_bank
from ftc.fdi.diagnosis import DEFAULT_CONFIG, FdiConfig
from ftc.fdi.fault_model import KINDS, Fault, FaultModel, NominalModel, fault_model
from ftc.fdi.observer import Observer, Sample
from ftc.fdi.uncertainty import CERTAIN, STEP, Uncertainty, perturbed
from kernels import lib, pointer

Complex = NDArray[np.complex128]

SEPARATION_THRESHOLD = 6.18
"""Smallest distance [standard deviations] with one confusion in a thousand: Phi(-d / 2) = 1e-3."""

ACCURACY = 1e-6
"""Relative accuracy of a distance: root of a difference of energies, maximized iteratively."""

_ROUND_OFF = 1e-13
"""Relative round-off of an energy: some hundred roundings of double precision."""

_HALF = 0.5
"""Effectiveness of the weak actuator of each failure: midway between healthy and free."""

_LOST = 0.01, 0.95
"""Range of the lost fraction of a weak actuator: with less it counts as healthy, with more as
free."""

_SERVO_PARTS = 0.25, 0.5, 0.75, 0.95, 1.0
"""Lost fractions of a servo's force with computed responses, interpolated linearly in between:
those of the hypotheses, and the end of :data:`_LOST`."""

_NEAR_S, _BACK_S, _STEP_S = 0.016, 0.24, 0.02
"""Candidate onsets [s]: every sample within the first time of the true onset, and in steps of the
third time within the second before it. Half and twice of each change the least distances of the
hexapod's failures by at most 3 %, and large ones, of much earlier onsets, by a third."""


@dataclass(frozen=True)
class FaultResponses:
    """Changes of the frequency response by failures of each of n actuators, at F frequencies.

    Outputs are in units of their noise ("whitened").

    Attributes:
        frequencies_hz: Frequencies, shape (F,).
        parts: Lost fractions of the force, ascending to 1, shape (M,).
        change: Outputs per command with the actuator locked, and with each lost fraction, minus
            those of the plant without failures, shape (F, n, 1 + M, p, n).
        errors: Change of `change` by one standard deviation of each of E uncertain parameters,
            shape (F, n, 1 + M, E, p, n).
        variance: Variance of the real and of the imaginary part of a phasor due to noise.
    """

    frequencies_hz: Array
    parts: Array
    change: Complex
    errors: Complex
    variance: float


def fault_responses(
    nominal: NominalModel,
    frequencies_hz: ArrayLike,
    time_s: float,
    uncertainty: Uncertainty = CERTAIN,
) -> FaultResponses:
    """Compute the responses to all single failures, and their errors to first order.

    A change is relative to the phasor measured without a failure, so model errors count only as far
    as they change the difference. It is linear in the actual commands, which include the reaction
    of a closed loop. Constant effects of loads and of actuators locked off centre have frequency
    zero and are not included.

    The F frequencies lie above zero and below half the control frequency. The lock-in lasts
    `time_s`, at least a period of each, and starts after the transient of the failure.

    Raises:
        ValueError: An argument is invalid, or a frequency is that of an undamped mode.
    """
    hz = checked_frequencies(nominal, "frequencies_hz", frequencies_hz)
    check.instance("uncertainty", uncertainty, Uncertainty)
    time_s = check.number("time_s", time_s, check.SMALLEST)
    if time_s < (1 - 1e-9) / hz.min():
        raise ValueError(
            "time_s must be at least a period of each frequency_hz, "
            f"{1 / hz.min():g} s, got {time_s}"
        )
    servo = any(part is not None and part.any() for part in (nominal.feedback, nominal.holding))
    parts = np.array(_SERVO_PARTS if servo else [1.0])  # no servo, no load: linear in the loss
    change = _changes(nominal, parts, hz)
    perturbed_models = perturbed(nominal, uncertainty)
    errors = [(_changes(model, parts, hz) - change) / STEP for model in perturbed_models]
    if uncertainty.delay_s:
        turn = 2j * np.pi * hz * uncertainty.delay_s
        errors.append(-turn[:, None, None, None, None] * change)
    stacked = np.array(errors, dtype=complex).reshape(-1, *change.shape)
    variance = 2 * nominal.period_s / time_s
    return FaultResponses(hz, parts, change, np.moveaxis(stacked, 0, 3).copy(), variance)


def checked_frequencies(nominal: NominalModel, name: str, value: ArrayLike) -> Array:
    """Check frequencies (F,) between zero and half the control frequency, and return them."""
    check.instance("nominal", nominal, NominalModel)
    hz = check.array(name, value, copy=True)
    nyquist_hz = 0.5 / nominal.period_s
    if hz.ndim != 1 or not hz.size or not (hz > 1e-9 * nyquist_hz).all() or hz.max() >= nyquist_hz:
        raise ValueError(
            f"{name} must lie between zero and half the control frequency, {nyquist_hz:g} Hz, got "
            f"{check.short_repr(value)}"
        )
    return hz


def _changes(nominal: NominalModel, parts: Array, frequencies_hz: Array) -> Complex:
    """Return `FaultResponses.change`, shape (F, n, 1 + M, p, n)."""
    faults = [
        (fault,)
        for k in range(nominal.actuators)
        for fault in (Fault(k, "locked"), *(Fault(k, "weak", 1 - part) for part in parts))
    ]
    models = [fault_model(nominal, fault_set) for fault_set in ((), *faults)]
    G = models[0].C @ steady_states(models, nominal.period_s, frequencies_hz)
    return (G[:, 1:] - G[:, :1]).reshape(len(G), nominal.actuators, -1, *G.shape[2:])


def steady_states(models: list[FaultModel], period_s: float, frequencies_hz: Array) -> Complex:
    """Return the state phasors of H models per command at F frequencies, (F, H, s, n)."""
    z = np.exp(2j * np.pi * frequencies_hz * period_s)[:, None, None, None]
    A, B = (np.array([getattr(model, name) for model in models]) for name in "AB")
    # Few frequencies, many models: direct solutions are faster than a Schur form of each.
    try:
        states = np.linalg.solve(z * np.eye(len(A[0])) - A, B.astype(complex))
    except np.linalg.LinAlgError:
        raise ValueError(
            "frequency_hz must not be that of an undamped mode, failures included, got "
            f"{check.short_repr(frequencies_hz.tolist())}"
        ) from None
    return states.astype(complex, copy=False)


@dataclass(frozen=True)
class Separations:
    """Distances between failures, in standard deviations.

    Attributes:
        faults: All 3 n failures: each actuator locked, free and half weak, in the order of
            :data:`ftc.fdi.KINDS`.
        distance: Distance of each failure (rows) from each explanation (columns), a weak actuator
            with its most similar loss of force, shape (3 n, 3 n).
        from_none: Distance of each failure from no failure, shape (3 n,).
    """

    faults: tuple[Fault, ...]
    distance: Array
    from_none: Array

    def __post_init__(self) -> None:
        check.lock(self)

    @property
    def between_actuators(self) -> Array:
        """Least distance between failures of two actuators, shape (n, n), symmetric.

        The diagonal has the least distance of a failure of the actuator from no failure.
        """
        n, kinds = len(self.faults) // len(KINDS), len(KINDS)
        symmetric = np.minimum(self.distance, self.distance.T)
        least = symmetric.reshape(n, kinds, n, kinds).min(axis=(1, 3))
        np.fill_diagonal(least, self.from_none.reshape(n, kinds).min(axis=1))
        return least

    @property
    def least(self) -> float:
        """Least distance of any failure from those of other actuators and from no failure."""
        return float(self.between_actuators.min())

    def isolable(self) -> tuple[Fault, ...]:
        """Return the failures separated from no failure and all failures of other actuators."""
        number = np.array([fault.actuator for fault in self.faults])
        others = np.where(number[:, None] != number, self.distance, np.inf).min(axis=1)
        separated = np.minimum(others, self.from_none) >= SEPARATION_THRESHOLD
        return tuple(self.faults[k] for k in np.flatnonzero(separated))

    def isolates(self, actuator: int, kind: str) -> bool:
        """Return whether a failure is isolable; a loose actuator counts as free."""
        kind = "free" if kind == "loose" else kind
        return any((fault.actuator, fault.kind) == (actuator, kind) for fault in self.isolable())

    def indistinguishable(self) -> tuple[tuple[int, ...], ...]:
        """Return groups of actuators linked by pairs below :data:`SEPARATION_THRESHOLD`."""
        is_linked = self.between_actuators < SEPARATION_THRESHOLD
        count, label = connected_components(is_linked, directed=False)
        groups = [tuple(np.flatnonzero(label == k).tolist()) for k in range(count)]
        return tuple(group for group in groups if len(group) > 1)

    def undetected(self) -> tuple[Fault, ...]:
        """Return the failures nearer to no failure than :data:`SEPARATION_THRESHOLD`."""
        return tuple(self.faults[k] for k in np.flatnonzero(self.from_none < SEPARATION_THRESHOLD))


def separations_at(responses: FaultResponses, k: int, commanded: Array) -> Separations:
    """Return the distances between single failures for amplitudes (n,) at the k-th frequency.

    Each failure changes the outputs' phasor: its signature. Phasors are Gaussian about it, due to
    the noise of a lock-in and uncertain parameters. The distance d of two failures is the
    Mahalanobis distance of their signatures with the mean of both covariances. Two of equal
    covariance are confused with probability Phi(-d / 2), in general with at most exp(-d^2 / 8) / 2
    (Bhattacharyya's bound; Fukunaga, Introduction to Statistical Pattern Recognition, 1990, section
    3.4).
    """
    change = _parts(responses.change[k] @ commanded)  # (n, 1 + M, 2 p)
    errors = _parts(responses.errors[k] @ commanded)  # (n, 1 + M, E, 2 p)
    C, S = errors.swapaxes(-1, -2) @ errors, responses.variance * np.eye(change.shape[-1])
    signatures, signature_C = (_failures(array, responses.parts) for array in (change, C))
    first, last = _explanations(change, responses.parts)
    _, last_C = _explanations(C, responses.parts)  # conservative: errors of the larger loss
    shared = not errors.size
    if shared:  # a common covariance, factored once
        signature_C, last_C = np.zeros((2, 1, *S.shape))
    distance = np.empty((len(signatures), len(first)))
    true_C, explanation_C = (_regular(S + array) / 2 for array in (signature_C, last_C))
    arguments = list(map(pointer, (signatures, first, last - first, true_C, explanation_C)))
    workspace = pointer(np.empty(lib.segments_room(len(S))))
    lib.to_segments(*distance.shape, len(S), *arguments, shared, workspace, pointer(distance))
    n, kinds = len(change), len(KINDS)
    by_actuator = distance[:, :-1].reshape(kinds * n, n, -1)
    weak = by_actuator[..., 2:].min(axis=-1, keepdims=True)
    full = np.concatenate([by_actuator[..., :2], weak], axis=-1).reshape(kinds * n, kinds * n)
    np.fill_diagonal(full, 0.0)
    noise = np.sqrt(_ROUND_OFF) * distance.max(initial=0.0)  # roots of differences that cancel
    full, from_none = (np.where(d > noise, d, 0.0) for d in (full, distance[:, -1]))
    faults = (Fault(k, kind, _HALF * (kind == "weak")) for k in range(n) for kind in KINDS)
    return Separations(tuple(faults), full, from_none)


def _regular(C: Array) -> Array:
    """Regularize covariances against round-off."""
    return C + _ROUND_OFF * np.trace(C, axis1=-2, axis2=-1)[..., None, None] * np.eye(C.shape[-1])


def _parts(phasors: Complex) -> Array:
    """Return the concatenated real and imaginary parts, (..., 2 p)."""
    return np.concatenate([phasors.real, phasors.imag], axis=-1)


def _lost(of: Array, parts: Array, amounts: Array) -> Array:
    """Interpolate values (n, 1 + M, ...), locked and at `parts`, linearly to other losses."""
    nodes = np.concatenate([np.zeros_like(of[:, :1]), of[:, 1:]], axis=1)
    places = np.interp(amounts, [0.0, *parts], np.arange(len(parts) + 1))
    low = np.minimum(places.astype(int), len(parts) - 1)
    part = (places - low).reshape(-1, *(1,) * (of.ndim - 2))
    return (1 - part) * nodes[:, low] + part * nodes[:, low + 1]


def _failures(of: Array, parts: Array) -> Array:
    """Select from values (n, 1 + M, ...) those of each failure of `Separations`."""
    half = _lost(of, parts, np.array([1 - _HALF]))
    return np.concatenate([of[:, :1], of[:, -1:], half], axis=1).reshape(-1, *of.shape[2:])


def _explanations(of: Array, parts: Array) -> tuple[Array, Array]:
    """Return values at both ends of each explanation: locked, free, loss intervals; no failure."""
    least, most = _LOST
    ends = np.array([least, *parts[(parts > least) & (parts < most)], most])
    weak, fixed, none = _lost(of, parts, ends), of[:, [0, -1]], np.zeros((1, *of.shape[2:]))
    first, last = (
        np.concatenate([fixed, bounds], axis=1).reshape(-1, *of.shape[2:])
        for bounds in (weak[:, :-1], weak[:, 1:])
    )
    return np.concatenate([first, none]), np.concatenate([last, none])


def isolability(
    nominal: NominalModel,
    fault: Fault,
    onset: int,
    states: Array,
    commanded: Array,
    uncertainty: Uncertainty = CERTAIN,
) -> tuple[Array, float]:
    """Return the distances of one failure in a motion from all other failures and from none.

    A distance d is that of the outputs, averaged over samples like those of the diagnosis, in
    standard deviations of the noise, for the best onset, loss of force and model errors of the
    other explanation. d^2 / 2 is the Kullback-Leibler divergence (Basseville and Nikiforov,
    Detection of Abrupt Changes, 1993, ch. 4).

    Args:
        nominal: Plant without faults.
        fault: True fault.
        onset: Tick of the onset, the first one of a sample.
        states: States of the faulty plant without noise, shape (N, s), for N ticks of evidence.
        commanded: Displacements from each tick on, shape (N, n).
        uncertainty: Uncertainty of the model, reduced by the motion before the onset.

    Returns:
        Distances by actuator and kind in the order of :data:`KINDS`, shape (n, 3), zero for the
        failure itself; and the distance from no failure.
    """
    ticks = max(1, round(DEFAULT_CONFIG.sample_s / nominal.period_s))
    alone = replace(uncertainty, command=0.0, supply=0.0, scale=0.0)
    bank = hypothesis_bank(nominal, (), alone, ticks)
    outputs = states @ fault_model(nominal).C.T
    sampling = nominal.period_s, ticks
    return distances(bank, fault, onset, outputs, commanded, sampling, uncertainty)


def distances(
    bank: HypothesisBank,
    truth: Fault | Cause,
    onset: int,
    outputs: Array,
    commanded: Array,
    sampling: tuple[float, int],
    uncertainty: Uncertainty = CERTAIN,
) -> tuple[Array, float]:
    """Return the distances of :func:`isolability` for any plant, initially at rest and healthy.

    The truth is a failure or a cause of the bank, which was made for this sampling (period of a
    tick [s], and ticks of a sample) and uncertainty. Outputs (N, p) are in units of their noise,
    but free of it.
    """
    (period_s, ticks), count = sampling, len(outputs) // sampling[1]
    near, back, step = (round(time / (period_s * ticks)) for time in (_NEAR_S, _BACK_S, _STEP_S))
    first = onset // ticks
    onsets = np.union1d(
        np.arange(max(0, first - near), min(count, first + near)),
        np.arange(max(0, first - back), count, max(1, step)),
    ).astype(int)
    resting = Observer(bank.base_model, FdiConfig(uncertainty), period_s * ticks).start()
    evidence = bank.start(onsets, resting.parameters, resting.X, resting.memory[-1:])
    y, u = (
        part[: count * ticks].reshape(count, ticks, -1).mean(axis=1)
        for part in (outputs, commanded)
    )
    previous = np.vstack([np.zeros_like(u[:1]), u[:-1]])
    white = np.full((1, y.shape[1]), np.sqrt(ticks))
    for sample in range(count):
        v = np.concatenate([u[sample], previous[sample], [1.0]])
        evidence = bank.step(evidence, Sample(sample, v, y[sample], True, resting), 0.0, white)
    energy = evidence.marginal()[0]
    least = energy[1:-1].min(axis=1)
    others = np.full((len(bank.effectiveness), len(KINDS)), np.inf)
    for fault, value in zip(bank.faults, least, strict=False):  # the causes follow the faults
        place = fault.actuator, KINDS.index(fault.kind)
        others[place] = min(others[place], value)
    if isinstance(truth, Cause):
        true_energy = least[len(bank.faults) + bank.causes.index(truth)]
    else:
        true_energy = others[truth.actuator, KINDS.index(truth.kind)]
    from_none = float(np.sqrt(max(energy[0, 0] - true_energy, 0)))
    return np.sqrt(np.maximum(others - true_energy, 0)), from_none
