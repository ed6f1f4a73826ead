"""Which failures can be told apart, by a linear model that is not exact, before anything runs.

Two answers: :func:`separations_at` in the steady state of a dither, and :func:`isolability` in any
motion.
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

ALIKE = 6.18
"""Standard deviations, below which more than one of a thousand is mistaken: Phi(-d / 2) = 1e-3."""

ACCURACY = 1e-6
"""Part of a distance: the root of a difference of energies, maximized by an iteration."""

_ROUND_OFF = 1e-13
"""Part of an energy that is round-off: some hundred roundings of double precision."""

_HALF = 0.5
"""Effectiveness of a weak actuator whose failure is to be found: midway between sound and free."""

_LOST = 0.01, 0.95
"""Parts of its force between which a weak actuator has lost: with less lost it is as good as sound,
with more it is named free."""

_SERVO_PARTS = 0.25, 0.5, 0.75, 0.95, 1.0
"""Parts lost of a servo's force with a response each, linear in between: the quarters by which the
diagnosis looks for losses, and the end of :data:`_LOST`."""

_NEAR_S, _BACK_S, _STEP_S = 0.016, 0.24, 0.02
"""Onsets are tried at every sample that near the true one, and in these steps so long before it. Of
the hexapod's failures the least distance is the same, within 3 %, for twice and half of each; large
ones, of explanations that begin long before, change by a third."""


@dataclass(frozen=True)
class FaultResponses:
    """Frequency responses of F frequencies by which each of n failing actuators differs.

    Outputs are in units of their noise ("whitened").

    Attributes:
        frequencies_hz: Shape (F,).
        parts: Parts of its force that an actuator has lost, ascending to 1, shape (M,).
        change: Outputs per command, with the actuator locked, and with each of these parts lost,
            minus those of the plant without failures, shape (F, n, 1 + M, p, n).
        errors: Change of `change` by one standard deviation of each of E uncertain parameters,
            shape (F, n, 1 + M, E, p, n).
        variance: Of the real and of the imaginary part of a phasor, by the noise alone.
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
    """Compute the responses to all failures of one actuator, and their errors to first order.

    A change is against the phasor measured while nothing had failed, so that errors of the model
    count only as far as they change the difference. It is linear in the commands as they are sent,
    which a residual is formed with: the reaction of a closed loop is part of these. Constant parts,
    of loads that fall and of actuators locked off centre, are at frequency zero and not seen here.

    The F frequencies lie above zero and below half the control frequency. The length of the lock-in
    `time_s`, after what the failure excites has decayed, is at least a period of each.

    Raises:
        ValueError: Besides, a frequency is that of an undamped mode.
    """
    hz = checked_frequencies(nominal, "frequencies_hz", frequencies_hz)
    check.instance("uncertainty", uncertainty, Uncertainty)
    time_s = check.number("time_s", time_s, check.SMALLEST)
    if time_s < (1 - 1e-9) / hz.min():
        raise ValueError(
            "time_s must be at least a period of each frequency_hz, "
            f"{1 / hz.min():g} s, got {time_s}"
        )
    servo = any(each is not None and each.any() for each in (nominal.feedback, nominal.holding))
    parts = np.array(_SERVO_PARTS if servo else [1.0])  # no servo, no load: linear in the loss
    change = _changes(nominal, parts, hz)
    wrong = perturbed(nominal, uncertainty)
    errors = [(_changes(each, parts, hz) - change) / STEP for each in wrong]
    if uncertainty.delay_s:
        turn = 2j * np.pi * hz * uncertainty.delay_s
        errors.append(-turn[:, None, None, None, None] * change)
    stacked = np.array(errors, dtype=complex).reshape(-1, *change.shape)
    variance = 2 * nominal.period_s / time_s
    return FaultResponses(hz, parts, change, np.moveaxis(stacked, 0, 3).copy(), variance)


def checked_frequencies(nominal: NominalModel, name: str, value: ArrayLike) -> Array:
    """Frequencies (F,) between zero and half the control frequency, checked."""
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
    """Changes as in :class:`FaultResponses`, shape (F, n, 1 + M, p, n)."""
    faults = [
        (fault,)
        for k in range(nominal.actuators)
        for fault in (Fault(k, "locked"), *(Fault(k, "weak", 1 - part) for part in parts))
    ]
    models = [fault_model(nominal, each) for each in ((), *faults)]
    G = models[0].C @ steady_states(models, nominal.period_s, frequencies_hz)
    return (G[:, 1:] - G[:, :1]).reshape(len(G), nominal.actuators, -1, *G.shape[2:])


def steady_states(models: list[FaultModel], period_s: float, frequencies_hz: Array) -> Complex:
    """Phasors of the states of H models per command at F frequencies, shape (F, H, s, n)."""
    z = np.exp(2j * np.pi * frequencies_hz * period_s)[:, None, None, None]
    A, B = (np.array([getattr(each, name) for each in models]) for name in "AB")
    # Few frequencies of many models: solved at once, not each model brought to triangular form.
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
        faults: All 3 n: each actuator locked, free and half weak, as :data:`ftc.fdi.KINDS`.
        distance: Of what happens (rows) from each explanation (columns), a weak actuator's at its
            most similar loss of force, shape (3 n, 3 n).
        from_none: Of what happens from no failure, shape (3 n,).
    """

    faults: tuple[Fault, ...]
    distance: Array
    from_none: Array

    def __post_init__(self) -> None:
        check.lock(self)

    @property
    def between_actuators(self) -> Array:
        """Least distance of any failures of two actuators, shape (n, n), symmetric.

        On the diagonal: of any failure of the actuator from no failure.
        """
        n, kinds = len(self.faults) // len(KINDS), len(KINDS)
        both_ways = np.minimum(self.distance, self.distance.T)
        least = both_ways.reshape(n, kinds, n, kinds).min(axis=(1, 3))
        np.fill_diagonal(least, self.from_none.reshape(n, kinds).min(axis=1))
        return least

    @property
    def least(self) -> float:
        """The least of all failures from those of another actuator, and from no failure."""
        return float(self.between_actuators.min())

    def isolable(self) -> tuple[Fault, ...]:
        """Failures :data:`ALIKE` or more from no failure and any failure of another actuator."""
        number = np.array([fault.actuator for fault in self.faults])
        others = np.where(number[:, None] != number, self.distance, np.inf).min(axis=1)
        apart = np.minimum(others, self.from_none) >= ALIKE
        return tuple(self.faults[k] for k in np.flatnonzero(apart))

    def isolates(self, actuator: int, kind: str) -> bool:
        """Whether a failure is among those that are isolable; a loose actuator counts as free."""
        kind = "free" if kind == "loose" else kind
        return any((each.actuator, each.kind) == (actuator, kind) for each in self.isolable())

    def alike_actuators(self) -> tuple[tuple[int, ...], ...]:
        """Groups of two or more actuators, in one chain of pairs nearer than :data:`ALIKE`."""
        count, label = connected_components(self.between_actuators < ALIKE, directed=False)
        groups = [tuple(np.flatnonzero(label == k).tolist()) for k in range(count)]
        return tuple(group for group in groups if len(group) > 1)

    def undetected(self) -> tuple[Fault, ...]:
        """Failures that are nearer to no failure than :data:`ALIKE`."""
        return tuple(self.faults[k] for k in np.flatnonzero(self.from_none < ALIKE))


def separations_at(responses: FaultResponses, k: int, commanded: Array) -> Separations:
    """Distances of all failures of one actuator, driven with amplitudes (n,) at the k-th frequency.

    Each failure changes the outputs' phasor: its signature. Phasors are Gaussian about it, by the
    noise of a lock-in and by uncertain parameters, and two failures are apart by the Mahalanobis
    distance d of their signatures with the mean of both covariances. Two of equal covariance are
    mistaken for each other with probability Phi(-d / 2); in general with at most exp(-d^2 / 8) / 2
    (Bhattacharyya's bound; Fukunaga, Introduction to Statistical Pattern Recognition, 1990, section
    3.4).
    """
    change = _parts(responses.change[k] @ commanded)  # (n, 1 + M, 2 p)
    errors = _parts(responses.errors[k] @ commanded)  # (n, 1 + M, E, 2 p)
    C, S = errors.swapaxes(-1, -2) @ errors, responses.variance * np.eye(change.shape[-1])
    happens, happens_C = (_happening(each, responses.parts) for each in (change, C))
    first, last = _explanations(change, responses.parts)
    _, last_C = _explanations(C, responses.parts)  # errors of the larger loss, to be safe
    one = not errors.size
    if one:  # one covariance for all, factored once
        happens_C, last_C = np.zeros((2, 1, *S.shape))
    distance = np.empty((len(happens), len(first)))
    own, other = (_regular(S + each) / 2 for each in (happens_C, last_C))
    given = [pointer(each) for each in (happens, first, last - first, own, other)]
    room = pointer(np.empty(lib.segments_room(len(S))))
    lib.to_segments(*distance.shape, len(S), *given, one, room, pointer(distance))
    n, kinds = len(change), len(KINDS)
    by_actuator = distance[:, :-1].reshape(kinds * n, n, -1)
    weak = by_actuator[..., 2:].min(axis=-1, keepdims=True)
    full = np.concatenate([by_actuator[..., :2], weak], axis=-1).reshape(kinds * n, kinds * n)
    np.fill_diagonal(full, 0.0)
    noise = np.sqrt(_ROUND_OFF) * distance.max(initial=0.0)  # each the root of what cancels
    full, from_none = (np.where(d > noise, d, 0.0) for d in (full, distance[:, -1]))
    faults = (Fault(k, kind, _HALF * (kind == "weak")) for k in range(n) for kind in KINDS)
    return Separations(tuple(faults), full, from_none)


def _regular(C: Array) -> Array:
    """Covariances with so much more noise that round-off does not make them singular."""
    return C + _ROUND_OFF * np.trace(C, axis1=-2, axis2=-1)[..., None, None] * np.eye(C.shape[-1])


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
    """Of what (n, 1 + M, ...) is of each model, what is of each failure of `Separations`."""
    half = _lost(of, parts, np.array([1 - _HALF]))
    return np.concatenate([of[:, :1], of[:, -1:], half], axis=1).reshape(-1, *of.shape[2:])


def _explanations(of: Array, parts: Array) -> tuple[Array, Array]:
    """What is of the ends of each explanation: locked, free, intervals of loss; then no failure."""
    least, most = _LOST
    ends = np.array([least, *parts[(parts > least) & (parts < most)], most])
    weak, fixed, none = _lost(of, parts, ends), of[:, [0, -1]], np.zeros((1, *of.shape[2:]))
    first, last = (
        np.concatenate([fixed, each], axis=1).reshape(-1, *of.shape[2:])
        for each in (weak[:, :-1], weak[:, 1:])
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
    """Distances d of one failure in a motion from all hypotheses, and from no failure.

    A distance is that of the outputs, averaged over samples as the diagnosis averages them, in
    standard deviations of the noise, at the other explanation's best time of onset, loss of force
    and errors of the model. d^2 / 2 is then the Kullback-Leibler divergence (Basseville and
    Nikiforov, Detection of Abrupt Changes, 1993, ch. 4).

    Args:
        nominal: The plant without faults.
        fault: What happens.
        onset: At which tick, the first one of a sample.
        states: Of the plant in which it happens, without noise, shape (N, s): N ticks of evidence.
        commanded: Displacements from each tick on, shape (N, n).
        uncertainty: Of the model; what the motion before the onset shows of it is made use of.

    Returns:
        Distances by actuator and kind as :data:`KINDS`, shape (n, 3); the failure itself has 0. And
        the distance from no failure.
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
    """Distances as of :func:`isolability`, for a plant of any kind, from rest and without faults.

    What happens is a failure or a cause of the bank, which was made for this sampling (period of a
    tick [s], and ticks of a sample) and uncertainty. Outputs (N, p) are in units of their noise,
    but without noise.
    """
    (period_s, ticks), count = sampling, len(outputs) // sampling[1]
    near, back, step = (round(each / (period_s * ticks)) for each in (_NEAR_S, _BACK_S, _STEP_S))
    first = onset // ticks
    onsets = np.union1d(
        np.arange(max(0, first - near), min(count, first + near)),
        np.arange(max(0, first - back), count, max(1, step)),
    ).astype(int)
    rest = Observer(bank.believed, FdiConfig(uncertainty), period_s * ticks).start()
    evidence = bank.start(onsets, rest.parameters, rest.X, rest.memory[-1:])
    y, u = (
        part[: count * ticks].reshape(count, ticks, -1).mean(axis=1)
        for part in (outputs, commanded)
    )
    before = np.vstack([np.zeros_like(u[:1]), u[:-1]])
    white = np.full((1, y.shape[1]), np.sqrt(ticks))
    for sample in range(count):
        v = np.concatenate([u[sample], before[sample], [1.0]])
        evidence = bank.step(evidence, Sample(sample, v, y[sample], True, rest), 0.0, white)
    energy = evidence.marginal()[0]
    least = energy[1:-1].min(axis=1)
    others = np.full((len(bank.effectiveness), len(KINDS)), np.inf)
    for fault, its in zip(bank.faults, least, strict=False):  # causes come after the faults
        place = fault.actuator, KINDS.index(fault.kind)
        others[place] = min(others[place], its)
    own = (
        least[len(bank.faults) + bank.causes.index(truth)]
        if isinstance(truth, Cause)
        else others[truth.actuator, KINDS.index(truth.kind)]
    )
    return np.sqrt(np.maximum(others - own, 0)), float(np.sqrt(max(energy[0, 0] - own, 0)))
