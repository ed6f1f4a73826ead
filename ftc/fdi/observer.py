"""Observer: the nominal model beside the plant, its residuals, and the test that raises alarms.

While the plant is as the model has it, the innovations are white noise of unit variance; a failure
adds a mean, and under a dither a sinusoid of its frequency.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.special import chdtri

from argument_checks import Array
from argument_checks.records import changed
from ftc.fdi.diagnosis import FdiConfig
from ftc.fdi.fault_model import Fault
from ftc.fdi.uncertainty import UncertainModel, Uncertainty
from kernels import ffi, lib, pointer

LEARNING_S = 0.8
"""So long after the start the plant is taken for healthy, and the spectrum of its residuals
measured: 200 samples of 4 ms, twenty for each coefficient."""

# Halved or doubled, each of the next six names the same 18 of 18 failures of the hexapod, on plants
# drawn by their uncertainty, after 72 ms; of 24 flights of carts in which no failure fits it names
# none, but for one with twice the slow input.

MEMORY_S = 5.0
"""After so long e^-1 of a residual is left in the spectrum."""

ORDER = 10
"""Coefficients of the autoregression, two for each of five resonances of the noise; what is slower
is learned as offsets that drift. A count: with as much time instead, at slow sampling, it has too
few coefficients for a hum, and nine of fifty forces that hum as the dither name an actuator; about
half of them so."""

LONGEST_S = 0.5
"""The longest mean that is tested: a shift that needs a longer one is learned as an offset that
drifts, a standard deviation of noise in a second."""

_RIDGE = 1e-2
"""White noise that is added to the residuals, in their standard deviations, so that a spectrum
which is singular (a constant, a sinusoid) is weighed at most a hundredfold."""

_SLOW_INPUT = 50.0
"""Slow unknown inputs, in standard deviations of noise: so large that nothing is inferred from
what is slow."""

_SLOWER_THAN_DITHER = 40.0
"""Such inputs are so many times slower than the dither: half a hertz beside one of 20 Hz."""

_FORCE_MEMORY_S, _FORCE_JUMP = 2.0, 0.5
"""The remaining force of a weak actuator is a random walk: two standard deviations after so long
without motion that shows it, and one at an alarm, are half of the force of a healthy one."""

_LEAST_OFFSET = 1e-6
"""Of a sensor, in standard deviations of its noise: a root of the covariance has no zeros."""


class Parameters(NamedTuple):
    """J errors of the model, in standard deviations, then p offsets, in those of the noise.

    The last errors are those of limits of dry friction, where there are any. The covariance is kept
    as a lower triangular root: where the motion shows a parameter a billion times better than the
    noise, rounding would leave the covariance itself indefinite (Kailath, Sayed and Hassibi, Linear
    Estimation, 2000, section 12.1).
    """

    mean: Array
    root: Array

    @property
    def covariance(self) -> Array:
        """Covariance of the parameters, shape (J + p, J + p)."""
        return self.root @ self.root.T

    @classmethod
    def prior(cls, errors: int, outputs: int, uncertainty: Uncertainty) -> "Parameters":
        """Make the parameters before anything is measured."""
        offset = max(uncertainty.offset, _LEAST_OFFSET)
        spread = np.concatenate([np.ones(errors), np.full(outputs, offset)])
        return cls(np.zeros(errors + outputs), np.diag(spread))

    def spread(self, deviations: Array) -> "Parameters":
        """Add independent random steps of these standard deviations, shape (J + p,)."""
        k, after = len(deviations), np.empty_like(self.root)
        workspace = pointer(np.empty(2 * k * (k + 1)))
        lib.spread_root(pointer(self.root), pointer(deviations), k, workspace, pointer(after))
        return Parameters(self.mean, after)


class Spectrum(NamedTuple):
    """Autocovariances of residuals over q lags, with forgetting.

    Attributes:
        recent: Latest residuals, the newest last, shape (q + 1, p).
        covariance: Their mean products with the newest, by lag, shape (q + 1, p).
    """

    recent: Array
    covariance: Array
    samples: int

    def filter(
        self, fitted: float = 0.0, memory: float = np.inf, slow: float | None = None
    ) -> Array:
        """Weights (q + 1, p) of the newest to the oldest residual, whose sum is white.

        An autoregression for each output (Yule and Walker; Kay, Modern Spectral Estimation, 1988,
        chapter 7).

        Args:
            fitted: Parameters for each output that were fitted to the same residuals, beside the q
                of the autoregression. Both make them look smaller than new ones will be, by the
                final prediction error (Akaike, Annals Inst. Statistical Mathematics 21, 1969).
            memory: Samples after which residuals are forgotten.
            slow: Corner in radians a sample below which unknown inputs may act besides.
        """
        samples = min(self.samples, memory)
        freedom = min(len(self.covariance) - 1 + fitted, samples / 2)
        error = (samples + freedom) / max(samples - freedom, 1.0)
        weights = np.empty_like(self.covariance)
        disturbance = 0.0
        if slow is not None:
            lags = slow * np.arange(len(self.covariance))
            disturbance = _SLOW_INPUT**2 * (1 + lags) * np.exp(-lags)
        a = np.empty(len(self.covariance) - 1)
        for k, c in enumerate(self.covariance.T):
            ridged = c + disturbance
            ridged[0] *= 1 + _RIDGE**2
            lib.predict(pointer(ridged), len(a), pointer(a))
            variance = max(ridged[0] - a @ ridged[1:], _RIDGE**2 * ridged[0])
            weights[:, k] = np.concatenate([[1.0], -a]) / np.sqrt(error * variance)
        return weights


@dataclass(frozen=True)
class ResidualTest:
    """Alarm when a mean of the latest residuals, plain or demodulated, exceeds a threshold.

    Finite moving averages (Basseville and Nikiforov, Detection of Abrupt Changes, 1993, section
    2.1) over several numbers M of samples, as they are and demodulated by the dither (lock-in):
    of one sample, for a jump, to half a second, for a creeping change. Union bound: the rate of
    false alarms is at most that of all means together, each exact for Gaussian noise.

    Attributes:
        windows: All M, ascending powers of two.
        demodulated: The least M of a demodulated mean, half a period of the dither or more: in less
            its cosine and sine would be one and the same, and large twice as often as independent.
        swing: Cosine and sine of the dither at each of the latest samples, shape (max M, 2); its
            phase does not matter. None without a dither.
        threshold: Of chi-square variables with p degrees of freedom.
        demodulated_threshold: Likewise with 2 p.
    """

    outputs: int
    false_alarms_per_hour: float
    period_s: float
    dither_hz: float | None = None
    windows: tuple[int, ...] = field(init=False)
    demodulated: int = field(init=False)
    carrier: Array | None = field(init=False)
    threshold: float = field(init=False)
    demodulated_threshold: float = field(init=False)

    def __post_init__(self) -> None:
        p, period_s, hz = self.outputs, self.period_s, self.dither_hz or 0.0
        most = round(np.log2(max(LONGEST_S / period_s, 1.0)))
        windows = tuple(2**k for k in range(1 + most))
        demodulated = [M for M in windows if M * period_s * hz >= 0.5]
        angle = 2 * np.pi * hz * period_s * np.arange(windows[-1])
        means = len(windows) + len(demodulated)
        probability = self.false_alarms_per_hour * period_s / 3600 / means
        vars(self).update(
            windows=windows,
            demodulated=demodulated[0] if demodulated else windows[-1],
            carrier=np.column_stack([np.cos(angle), np.sin(angle)]) if demodulated else None,
            threshold=float(chdtri(p, probability)),
            demodulated_threshold=float(chdtri(2 * p, probability)),
        )

    def start(self) -> Array:
        """Residuals before the first sample, zero, shape (max M, p)."""
        return np.zeros((self.windows[-1], self.outputs))

    def alarm(self, recent: Array) -> int:
        """The smallest M for which the latest residuals (max M, p) are more than noise, or 0."""
        carrier = ffi.NULL if self.carrier is None else pointer(self.carrier)
        thresholds = self.threshold, self.demodulated_threshold
        arguments = carrier, self.demodulated, *thresholds, pointer(np.empty(3 * self.outputs))
        return lib.alarming(*recent.shape, pointer(recent), *arguments)


@dataclass(frozen=True)
class ObserverState:
    """State of an observer between two samples.

    Attributes:
        sample: Number of samples so far.
        X: State of the nominal model and of its errors, shape (1 + J, s).
        memory: Latest residuals and regressors, newest last, shape (q + 1, 1 + J, p).
        whitening: Filter of the residuals, shape (q + 1, p).
        decoupled: Their filter where slow unknown inputs act besides, much slower than the dither,
            which then is what shows a failure; without a dither it is `whitening`.
        residual: Latest innovation, shape (p,).
        measured: Samples since the last one in which nothing was measured.
    """

    sample: int
    X: Array
    memory: Array
    parameters: Parameters
    spectrum: Spectrum
    whitening: Array
    decoupled: Array
    residual: Array
    measured: int

    @property
    def filters(self) -> tuple[float, Array, Array]:
        """Root mean square of residuals before whitening, and both filters, for a bank."""
        return float(np.sqrt(self.spectrum.covariance[0].sum())), self.whitening, self.decoupled


class Sample(NamedTuple):
    """One sample, and the state before it.

    Attributes:
        number: How many samples were before it.
        v: Inputs, shape (r,).
        y: Mean outputs, in units of their noise, shape (p,); None: nothing was measured.
        is_whole: Whether it was measured, and all before it that its whitening needs.
    """

    number: int
    v: Array
    y: Array | None
    is_complete: bool
    before: ObserverState


@dataclass(frozen=True)
class Observer:
    """The nominal model beside the plant, with the failures that are known.

    Attributes:
        period_s: Of a sample.
        largest: Sum of squares of an innovation that is still learned from, once the spectrum is
            known: what an alarm is raised for would move the parameters.
        weak: Actuators known to be weak; what they have left is followed as the error of their
            gain, where the model has such errors.
    """

    model: UncertainModel
    config: FdiConfig
    period_s: float
    largest: float = np.inf
    weak: tuple[Fault, ...] = ()

    def start(self, calibration: ObserverState | None = None) -> ObserverState:
        """State at rest at the equilibrium, with what another run has learned of the machine.

        Zeros of sensors may be others than they were.
        """
        p, s = self.model.C.shape
        rows, q = len(self.model.M), ORDER
        white = np.zeros((q + 1, p))
        white[0] = 1.0
        state = ObserverState(
            sample=0,
            X=np.zeros((rows, s)),
            memory=np.zeros((q + 1, rows, p)),
            parameters=Parameters.prior(rows - 1, p, self.config.uncertainty),
            spectrum=Spectrum(np.zeros((q + 1, p)), np.zeros((q + 1, p)), 0),
            whitening=white,
            decoupled=white,
            residual=np.zeros(p),
            measured=q,
        )
        if calibration is None:
            return state
        zeros = np.repeat([0.0, self.config.uncertainty.offset], [rows - 1, p])
        parameters = calibration.parameters.spread(zeros)
        spectrum = calibration.spectrum._replace(recent=state.spectrum.recent)
        return self.with_spectrum(replace(state, parameters=parameters, spectrum=spectrum))

    def step(
        self,
        state: ObserverState,
        v: Array,
        y: Array | None,
        *,
        learns: bool = True,
        gated: bool = True,
    ) -> tuple[ObserverState, Sample]:
        """Take one sample: predict it, and with `learns` learn from it by a Kalman filter.

        With `gated` not from an innovation that is too large for noise. A sample that was not
        measured is as the model predicts it, whatever its parameters are, which drift meanwhile:
        they are random walks (recursive least squares that forgets what may have drifted; Ljung,
        System Identification, 1999, section 11.2).
        """
        measured = 0 if y is None else state.measured + 1
        sample = Sample(state.sample, v, y, measured >= len(state.memory), state)
        predicted, X = self.model.step(state.X, v)
        spectrum, parameters = state.spectrum, state.parameters
        now: dict[str, Any] = {"sample": state.sample + 1, "X": X, "measured": measured}
        if y is None:
            now["memory"] = np.concatenate([state.memory[1:], np.zeros_like(predicted)[None]])
            now["residual"] = np.zeros(predicted.shape[1])
            return changed(state, parameters=parameters.spread(self._drift), **now), sample
        tests = gated and spectrum.samples * self.period_s >= LEARNING_S
        share = 1 / min(spectrum.samples + 1, MEMORY_S / self.period_s)
        learned = parameters.mean, parameters.root, spectrum.recent, spectrum.covariance
        before = state.memory, *learned
        after = [np.empty_like(array) for array in before]
        p, k = len(y), len(self._drift)
        residual, workspace = np.empty(p), np.empty(k * (2 * k + p + 2) + p)
        largest = self.largest if tests else np.inf
        is_learned = lib.correct(
            *(len(state.memory), k - p, p),
            ffi.new("watched *", [pointer(array) for array in before]),
            *(pointer(array) for array in (predicted, y, state.whitening, self._drift)),
            *(share, largest, learns and sample.is_complete, pointer(workspace)),
            ffi.new("watched *", [pointer(array) for array in after]),
            pointer(residual),
        )
        now |= {"memory": after[0], "residual": residual}
        if is_learned:
            now["parameters"] = Parameters(after[1], after[2])
            now["spectrum"] = Spectrum(after[3], after[4], spectrum.samples + 1)
        return changed(state, **now), sample

    def replayed(
        self, state: ObserverState, past: Sequence[Sample]
    ) -> tuple[ObserverState, list[Sample], list[Array]]:
        """Take past samples again: state after them, the samples as seen now, and residuals."""
        history, residuals = [], []
        for earlier in past:
            state, sample = self.step(state, earlier.v, earlier.y)
            history.append(sample)
            residuals.append(state.residual)
        return state, history, residuals

    def learned(self, state: ObserverState, history: Sequence[Sample]) -> ObserverState:
        """Take the history again with the spectrum measured so far, as if known from the start."""
        new, first, whitening = self.start(), history[0].before, self.with_spectrum(state).whitening
        unknown = {"parameters": new.parameters, "spectrum": new.spectrum, "measured": new.measured}
        start = replace(first, whitening=whitening, **unknown)
        return self.with_spectrum(self.replayed(start, history)[0])

    def samples(self, time_s: float) -> int:
        """Number of samples that last so long."""
        return round(time_s / self.period_s)

    def drift(self, time_s: float) -> Array:
        """Standard deviations of the steps of all parameters in so long, shape (J + p,)."""
        rows, errors = len(self.model.M), self.model.first_limit - 1
        uncertainty = self.config.uncertainty
        rates = uncertainty.drift_rate, uncertainty.friction_rate, uncertainty.offset_rate
        counts = errors, rows - 1 - errors, len(self.model.C)
        return np.repeat(rates, counts) * np.sqrt(time_s)

    def with_larger_offsets(self, state: ObserverState) -> ObserverState:
        """The state whose offsets of the sensors may be as large as the residuals are."""
        largest = np.abs(state.memory[:, 0]).max(axis=0)
        spread = np.concatenate([np.zeros(len(state.parameters.mean) - len(largest)), largest])
        return replace(state, parameters=state.parameters.spread(spread))

    def relearning(self, state: ObserverState) -> ObserverState:
        """The state that takes what it sees from now on for the machine as it is.

        The spectrum is soon that of the residuals to come; until then the one known before is
        tested by: what is known counts as a quarter of the time of learning.
        """
        spectrum = state.spectrum._replace(samples=self.samples(LEARNING_S) // 4)
        return replace(self.with_larger_offsets(state), spectrum=spectrum)

    def after_alarm(self, state: ObserverState) -> ObserverState:
        """The state at an alarm: what weak actuators have left may be anything."""
        return replace(state, parameters=state.parameters.spread(self._force_steps(_FORCE_JUMP)))

    def strongest(self, state: ObserverState) -> list[tuple[int, float]]:
        """Weak actuators, and the most that each may have of its force: two standard deviations."""
        mean, root = state.parameters.mean, state.parameters.root
        most = 1 + self.config.uncertainty.gain * (mean + 2 * np.linalg.norm(root, axis=1))
        return [
            (fault.actuator, fault.effectiveness * float(most[fault.actuator]))
            for fault in self.weak
        ]

    def with_spectrum(self, state: ObserverState) -> ObserverState:
        """The state with the filters of the spectrum measured so far."""
        dither_hz, spectrum = self.config.dither_hz, state.spectrum
        arguments = len(state.parameters.mean) / len(state.residual), MEMORY_S / self.period_s
        whitening = decoupled = spectrum.filter(*arguments)
        if dither_hz:
            corner = 2 * np.pi * dither_hz / _SLOWER_THAN_DITHER * self.period_s
            decoupled = spectrum.filter(*arguments, corner)
        return replace(state, whitening=whitening, decoupled=decoupled)

    @cached_property
    def _drift(self) -> Array:
        force_steps = self._force_steps(0.25 * np.sqrt(self.period_s / _FORCE_MEMORY_S))
        return np.hypot(self.drift(self.period_s), force_steps)

    def _force_steps(self, part: float) -> Array:
        """Steps of the parameters (J + p,) by which weak actuators have this part more force."""
        steps = np.zeros(len(self.model.M) - 1 + len(self.model.C))
        for fault in self.weak:
            steps[fault.actuator] = part / (self.config.uncertainty.gain * fault.effectiveness)
        return steps
