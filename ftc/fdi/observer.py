"""Observer: residuals of the nominal model, and the test that raises alarms.

While the plant agrees with the model, the innovations are white noise of unit variance; a failure
adds a mean and, with a dither, a sinusoid of its frequency.
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
"""Time after the start in which the plant is assumed healthy and the spectrum of its residuals is
measured [s]: 200 samples of 4 ms, twenty for each coefficient."""

# With half or twice each of the next six constants the same 18 of 18 failures of the hexapod are
# isolated after 72 ms, on plants sampled by their uncertainty; of 24 runs of carts in which no
# failure fits none leads to an isolation, except one with twice the slow input.

MEMORY_S = 5.0
"""Time constant of the exponential forgetting of the spectrum [s]."""

ORDER = 10
"""Coefficients of the autoregression, two for each of five resonances of the noise; slower noise is
learned as drifting offsets. It is a count: a constant time has too few coefficients for a hum at
slow sampling, and about twice as many of fifty humming forces lead to a false isolation."""

LONGEST_S = 0.5
"""Longest mean of the residual test [s]: a shift that needs a longer one is learned as a drifting
offset, of a standard deviation of noise in a second."""

_RIDGE = 1e-2
"""White noise added to the residuals, in their standard deviations: the filter of a singular
spectrum (a constant, a sinusoid) amplifies at most a hundredfold."""

_SLOW_INPUT = 50.0
"""Slow unknown inputs, in standard deviations of noise: large enough to exclude slow residuals from
the evidence."""

_SLOWER_THAN_DITHER = 40.0
"""Ratio of the dither's frequency to the corner of slow unknown inputs: 20 Hz to 0.5 Hz."""

_FORCE_MEMORY_S, _FORCE_JUMP = 2.0, 0.5
"""Random walk of the remaining force of a weak actuator: time without excitation after which two
standard deviations are half the force of a healthy one [s], and one standard deviation at an alarm
as a fraction of that force."""

_LEAST_OFFSET = 1e-6
"""Smallest standard deviation of a sensor's offset, in units of its noise: roots are regular."""


class Parameters(NamedTuple):
    """Estimates of J model errors, in standard deviations, and p offsets, in those of the noise.

    The last errors are those of the limits of dry friction, if any. The covariance is stored as a
    lower triangular root: rounding could make the covariance itself indefinite if the motion
    determines a parameter a billion times better than the noise (Kailath, Sayed and Hassibi, Linear
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
        """Return the prior of the parameters, before any measurement."""
        offset = max(uncertainty.offset, _LEAST_OFFSET)
        spread = np.concatenate([np.ones(errors), np.full(outputs, offset)])
        return cls(np.zeros(errors + outputs), np.diag(spread))

    def spread(self, deviations: Array) -> "Parameters":
        """Return the parameters after independent random steps of standard deviations (J + p,)."""
        k, after = len(deviations), np.empty_like(self.root)
        workspace = pointer(np.empty(2 * k * (k + 1)))
        lib.spread_root(pointer(self.root), pointer(deviations), k, workspace, pointer(after))
        return Parameters(self.mean, after)


class Spectrum(NamedTuple):
    """Autocovariances of residuals over q lags, with forgetting.

    Attributes:
        recent: Latest residuals, the newest last, shape (q + 1, p).
        covariance: Mean products of the residuals with the newest, by lag, shape (q + 1, p).
    """

    recent: Array
    covariance: Array
    samples: int

    def filter(
        self, fitted: float = 0.0, memory: float = np.inf, slow: float | None = None
    ) -> Array:
        """Return the whitening filter: weights (q + 1, p) of the newest to the oldest residual.

        It is an autoregression for each output (Yule and Walker; Kay, Modern Spectral Estimation,
        1988, chapter 7).

        Args:
            fitted: Parameters for each output fitted to the same residuals, in addition to the q of
                the autoregression. The variance is corrected for both by the final prediction error
                (Akaike, Annals Inst. Statistical Mathematics 21, 1969).
            memory: Time constant of the forgetting, in samples.
            slow: Corner frequency [rad/sample] of additional slow unknown inputs; None: no inputs.
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
    """Detector that alarms when a plain or demodulated mean of residuals exceeds a threshold.

    It uses finite moving averages (Basseville and Nikiforov, Detection of Abrupt Changes, 1993,
    section 2.1) over several numbers M of samples, plain and demodulated by the dither (lock-in):
    from one sample, for a jump, to half a second, for a slow change. By the union bound the rate of
    false alarms is at most the sum of the rates of all means, exact for Gaussian noise.

    Attributes:
        windows: All M, ascending powers of two.
        demodulated: Smallest M of a demodulated mean, at least half a period of the dither: in less
            time its cosine and sine are not independent.
        carrier: Cosine and sine of the dither at the latest samples, shape (max M, 2), of any
            phase. None without a dither.
        threshold: Threshold of chi-square variables with p degrees of freedom.
        demodulated_threshold: Threshold of chi-square variables with 2 p degrees of freedom.
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
        """Return the residuals before the first sample: zeros of shape (max M, p)."""
        return np.zeros((self.windows[-1], self.outputs))

    def alarm(self, recent: Array) -> int:
        """Return the smallest M whose mean of residuals (max M, p) exceeds its threshold, or 0."""
        carrier = ffi.NULL if self.carrier is None else pointer(self.carrier)
        thresholds = self.threshold, self.demodulated_threshold
        arguments = carrier, self.demodulated, *thresholds, pointer(np.empty(3 * self.outputs))
        return lib.alarming(*recent.shape, pointer(recent), *arguments)


@dataclass(frozen=True)
class ObserverState:
    """State of an observer between two samples.

    Attributes:
        sample: Number of samples so far.
        X: State of the nominal model and its sensitivities to errors, shape (1 + J, s).
        memory: Latest residuals and regressors, newest last, shape (q + 1, 1 + J, p).
        whitening: Filter of the residuals, shape (q + 1, p).
        decoupled: Filter decoupled from unknown inputs much slower than the dither, which then
            reveals a failure; without a dither it is `whitening`.
        residual: Latest innovation, shape (p,).
        measured: Samples since the last unmeasured one.
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
        """RMS of the residuals before whitening, and both filters, for a bank."""
        return float(np.sqrt(self.spectrum.covariance[0].sum())), self.whitening, self.decoupled


class Sample(NamedTuple):
    """Inputs and mean outputs of one sample, and the observer state before it.

    Attributes:
        number: Number of samples before it.
        v: Inputs, shape (r,).
        y: Mean outputs, in units of their noise, shape (p,); None: not measured.
        is_complete: Whether this sample and all that its whitening needs were measured.
    """

    number: int
    v: Array
    y: Array | None
    is_complete: bool
    before: ObserverState


@dataclass(frozen=True)
class Observer:
    """Observer with the model of the plant with its known failures; it estimates model errors.

    Attributes:
        period_s: Sample period.
        largest: Largest squared innovation used for learning once the spectrum is known, so that
            failures do not change the parameters.
        weak: Actuators known to be weak, whose effectiveness is tracked as a gain error, if the
            model has gain errors.
    """

    model: UncertainModel
    config: FdiConfig
    period_s: float
    largest: float = np.inf
    weak: tuple[Fault, ...] = ()

    def start(self, calibration: ObserverState | None = None) -> ObserverState:
        """Return the state at rest at the equilibrium, calibrated by the state of another run.

        The sensor offsets may differ from those of the other run.
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
        """Predict one sample and, with `learns`, update the parameters by a Kalman filter.

        With `gated`, innovations too large for noise are not learned. An unmeasured sample is
        replaced by its prediction. The parameters are random walks, which also drift without
        measurements (recursive least squares with forgetting; Ljung, System Identification, 1999,
        section 11.2).
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
            ffi.new("observer_state *", [pointer(array) for array in before]),
            *(pointer(array) for array in (predicted, y, state.whitening, self._drift)),
            *(share, largest, learns and sample.is_complete, pointer(workspace)),
            ffi.new("observer_state *", [pointer(array) for array in after]),
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
        """Process past samples again; return the final state, the new samples and the residuals."""
        history, residuals = [], []
        for earlier in past:
            state, sample = self.step(state, earlier.v, earlier.y)
            history.append(sample)
            residuals.append(state.residual)
        return state, history, residuals

    def learned(self, state: ObserverState, history: Sequence[Sample]) -> ObserverState:
        """Return the state after processing the history again with the spectrum measured so far."""
        new, first, whitening = self.start(), history[0].before, self.with_spectrum(state).whitening
        unknown = {"parameters": new.parameters, "spectrum": new.spectrum, "measured": new.measured}
        start = replace(first, whitening=whitening, **unknown)
        return self.with_spectrum(self.replayed(start, history)[0])

    def samples(self, time_s: float) -> int:
        """Return the number of samples in a time [s]."""
        return round(time_s / self.period_s)

    def drift(self, time_s: float) -> Array:
        """Return the standard deviations (J + p,) of the drift of all parameters in a time [s]."""
        rows, errors = len(self.model.M), self.model.first_limit - 1
        uncertainty = self.config.uncertainty
        rates = uncertainty.drift_rate, uncertainty.friction_rate, uncertainty.offset_rate
        counts = errors, rows - 1 - errors, len(self.model.C)
        return np.repeat(rates, counts) * np.sqrt(time_s)

    def with_larger_offsets(self, state: ObserverState) -> ObserverState:
        """Return the state with sensor offsets as uncertain as the residuals are large."""
        largest = np.abs(state.memory[:, 0]).max(axis=0)
        spread = np.concatenate([np.zeros(len(state.parameters.mean) - len(largest)), largest])
        return replace(state, parameters=state.parameters.spread(spread))

    def relearning(self, state: ObserverState) -> ObserverState:
        """Return the state that learns the present residuals as those of the healthy machine.

        The known spectrum counts as a quarter of the learning time, so that new residuals soon
        replace it; until then it remains in use.
        """
        spectrum = state.spectrum._replace(samples=self.samples(LEARNING_S) // 4)
        return replace(self.with_larger_offsets(state), spectrum=spectrum)

    def after_alarm(self, state: ObserverState) -> ObserverState:
        """Return the state at an alarm, with an uncertain effectiveness of weak actuators."""
        return replace(state, parameters=state.parameters.spread(self._force_steps(_FORCE_JUMP)))

    def strongest(self, state: ObserverState) -> list[tuple[int, float]]:
        """Return each weak actuator and its effectiveness plus two standard deviations."""
        mean, root = state.parameters.mean, state.parameters.root
        most = 1 + self.config.uncertainty.gain * (mean + 2 * np.linalg.norm(root, axis=1))
        return [
            (fault.actuator, fault.effectiveness * float(most[fault.actuator]))
            for fault in self.weak
        ]

    def with_spectrum(self, state: ObserverState) -> ObserverState:
        """Return the state with the filters of the spectrum measured so far."""
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
        """Return parameter steps (J + p,) that add a fraction of the force to weak actuators."""
        steps = np.zeros(len(self.model.M) - 1 + len(self.model.C))
        for fault in self.weak:
            steps[fault.actuator] = part / (self.config.uncertainty.gain * fault.effectiveness)
        return steps
