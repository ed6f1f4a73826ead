"""Watch: residuals of the believed model, with its parameters and their spectrum tracked."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from argument_checks import Array
from ftc._records import changed
from ftc.fdi.detection.parameter_filter import Parameters, drift
from ftc.fdi.detection.whitening import Spectrum
from ftc.fdi.diagnosis import FdiConfig
from ftc.fdi.fault_model import Fault
from ftc.fdi.uncertainty import UncertainModel
from kernels import ffi, lib, pointer

_FORGOTTEN_S, _JUMP = 2.0, 0.5
"""What an actuator that is weak has left of its force is a random walk: two standard deviations
after so long without motion that shows it, and one at an alarm, are half of the force of a sound
one."""

_SLOWER = 40.0
"""Times slower than the dither are inputs that no failure is inferred from."""


@dataclass(frozen=True)
class Moment:
    """What was known before a sample, and the sample.

    Attributes:
        sample: Its number.
        X: State of the believed model and of its errors, shape (1 + J, s).
        memory: Residuals and regressors before it, newest last, shape (q + 1, 1 + J, p).
        parameters: As tracked so far.
        v: Inputs of the sample, shape (r,).
        y: Mean outputs, in units of their noise, shape (p,); None: nothing was measured.
        is_whole: Whether it was measured, and all before it that its whitening needs.
    """

    sample: int
    X: Array
    memory: Array
    parameters: Parameters
    v: Array
    y: Array | None
    is_whole: bool


class Calibration(NamedTuple):
    """What a watch has learned of a machine."""

    parameters: Parameters
    spectrum: Spectrum


@dataclass(frozen=True)
class WatchState:
    """State after a sample; the fields are those of a :class:`Moment`.

    Attributes:
        spectrum: Of the residuals.
        whitening: Their filter, shape (q + 1, p).
        decoupled: The same where slow unknown inputs act besides, much slower than the dither,
            which then is what shows a failure; without a dither it is that filter.
        residual: Latest innovation, shape (p,); before the spectrum is known, zero.
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
    def shaken(self) -> float:
        """Root mean square of the residuals before whitening, in standard deviations of noise."""
        return float(np.sqrt(self.spectrum.covariance[0].sum()))


@dataclass(frozen=True)
class Watch:
    """The believed model beside the plant.

    Attributes:
        model: As it is believed to be.
        config: Settings.
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

    def start(self, calibration: Calibration | None = None) -> WatchState:
        """At rest at the equilibrium, with what is known of the machine already.

        Zeros of sensors may be others than they were.
        """
        p, s = self.model.C.shape
        rows, q = len(self.model.M), self.config.order
        white = np.zeros((q + 1, p))
        white[0] = 1.0
        state = WatchState(
            sample=0,
            X=np.zeros((rows, s)),
            memory=np.zeros((q + 1, rows, p)),
            parameters=Parameters.prior(rows - 1, p, self.config.uncertainty),
            spectrum=Spectrum.start(q, p),
            whitening=white,
            decoupled=white,
            residual=np.zeros(p),
            measured=q,
        )
        if calibration is None:
            return state
        known = calibration.parameters
        zeros = np.zeros(len(known.mean))
        zeros[-p:] = self.config.uncertainty.offset
        spectrum = replace(calibration.spectrum, recent=state.spectrum.recent)
        return self.with_spectrum(replace(state, parameters=known.spread(zeros), spectrum=spectrum))

    def step(
        self,
        state: WatchState,
        v: Array,
        y: Array | None,
        *,
        learns: bool = True,
        gated: bool = True,
    ) -> tuple[WatchState, Moment]:
        """One sample; with `learns` the parameters and the spectrum are updated.

        With `gated` not by an innovation that is too large for noise. A sample that was not
        measured is as the model predicts it, whatever its parameters are, which drift meanwhile.
        """
        config, before = self.config, state.parameters
        measured = 0 if y is None else state.measured + 1
        whole = measured > config.order
        moment = Moment(state.sample, state.X, state.memory, before, v, y, whole)
        predicted, X = self.model.step(state.X, v)
        if y is None:
            memory = np.concatenate([state.memory[1:], np.zeros_like(predicted)[None]])
            parameters, spectrum = before.spread(self._drift), state.spectrum
            residual = np.zeros(predicted.shape[1])
        else:
            spectrum = state.spectrum
            known = spectrum.samples * self.period_s >= config.learning_s
            memory, residual, parameters, spectrum = corrected(
                *(state.memory, predicted, y, state.whitening, before, self._drift, spectrum),
                1 / min(spectrum.samples + 1, config.memory_s / self.period_s),
                self.largest if gated and known else np.inf,
                learns=learns and whole,
            )
        after = {"X": X, "memory": memory, "parameters": parameters, "spectrum": spectrum}
        seen = {"residual": residual, "measured": measured}
        return changed(state, sample=state.sample + 1, **after, **seen), moment

    def samples(self, time_s: float) -> int:
        """So many samples last so long."""
        return round(time_s / self.period_s)

    def following(self, state: WatchState) -> WatchState:
        """The state whose offsets of the sensors may be as large as the residuals are."""
        seen = np.abs(state.memory[:, 0]).max(axis=0)
        spread = np.concatenate([np.zeros(len(state.parameters.mean) - len(seen)), seen])
        return replace(state, parameters=state.parameters.spread(spread))

    def relearning(self, state: WatchState) -> WatchState:
        """The state that takes what it sees from now on for the machine as it is.

        The spectrum is soon that of the residuals to come; until then the one known before is
        tested by.
        """
        learning = self.samples(self.config.learning_s)
        spectrum = replace(state.spectrum, samples=learning // 4)
        return replace(self.following(state), spectrum=spectrum)

    @cached_property
    def _drift(self) -> Array:
        p, errors = len(self.model.C), len(self.model.M) - 1
        given = self.period_s, p, self.config.uncertainty, self.model.limits
        rate = 0.25 / np.sqrt(_FORGOTTEN_S)
        return np.hypot(
            drift(errors + p, *given), self._strength_steps(rate * np.sqrt(self.period_s))
        )

    def _strength_steps(self, part: float) -> Array:
        """Steps of the parameters (J + p,) by which weak actuators have this part more force."""
        steps = np.zeros(len(self.model.M) - 1 + len(self.model.C))
        for fault in self.weak:
            steps[fault.actuator] = part / (self.config.uncertainty.gain * fault.effectiveness)
        return steps

    def doubting(self, state: WatchState) -> WatchState:
        """The state at an alarm: what weak actuators have left may be anything."""
        return replace(state, parameters=state.parameters.spread(self._strength_steps(_JUMP)))

    def strongest(self, state: WatchState) -> list[tuple[int, float]]:
        """Weak actuators, and the most that each may have of its force: two standard deviations."""
        mean, root = state.parameters.mean, state.parameters.root
        return [
            (fault.actuator, fault.effectiveness * (1 + self.config.uncertainty.gain * float(most)))
            for fault in self.weak
            for most in [mean[fault.actuator] + 2 * np.linalg.norm(root[fault.actuator])]
        ]

    def observed(self, state: WatchState) -> Array:
        """Part of each parameter's prior variance that the motion so far has removed, (J + p,).

        One: known exactly; zero: not observable by these sensors under these commands.
        """
        p = len(state.residual)
        prior = Parameters.prior(len(self.model.M) - 1, p, self.config.uncertainty)
        left = np.diag(state.parameters.covariance) / np.diag(prior.covariance)
        return np.clip(1 - left, 0.0, 1.0)

    def with_spectrum(self, state: WatchState) -> WatchState:
        """With the filters of the spectrum measured so far."""
        config, spectrum = self.config, state.spectrum
        fitted = len(state.parameters.mean) / len(state.residual)
        memory = config.memory_s / self.period_s
        whitening = decoupled = spectrum.filter(fitted, memory)
        if config.dither_hz is not None:
            corner = 2 * np.pi * config.dither_hz / _SLOWER * self.period_s
            decoupled = spectrum.filter(fitted, memory, corner)
        return replace(state, whitening=whitening, decoupled=decoupled)


def corrected(
    memory: Array,
    predicted: Array,
    y: Array,
    whitening: Array,
    parameters: Parameters,
    drift: Array,
    spectrum: Spectrum,
    rate: float,
    largest: float,
    *,
    learns: bool,
) -> tuple[Array, Array, Parameters, Spectrum]:
    """What a sample makes of a state: the second half of :meth:`Watch.step`.

    Args:
        memory: Residuals and regressors before it, shape (q + 1, 1 + J, p).
        predicted: Outputs of the model, and what each error adds to them, shape (1 + J, p).
        y: Mean outputs, shape (p,).
        whitening: Shape (q + 1, p).
        parameters: Before it.
        drift: Standard deviations of their steps, shape (J + p,).
        spectrum: Before it.
        rate: Weight of this sample in the spectrum's covariance.
        largest: Sum of squares of an innovation that is still learned from.
        learns: Whether anything is.

    Returns:
        Memory, innovation (p,), parameters and spectrum after it; the last two as they were if it
        was not learned from.
    """
    before = memory, parameters.mean, parameters.root, spectrum.recent, spectrum.covariance
    after = [np.empty_like(each) for each in before]
    p, k = len(y), len(drift)
    residual, room = np.empty(p), np.empty(k * (2 * k + p + 2) + p)
    is_learned = lib.correct(
        *(len(memory), k - p, p, ffi.new("watched *", [pointer(each) for each in before])),
        *(pointer(each) for each in (predicted, y, whitening, drift)),
        *(rate, largest, learns, pointer(room)),
        *(ffi.new("watched *", [pointer(each) for each in after]), pointer(residual)),
    )
    if is_learned:
        parameters = Parameters(after[1], after[2])
        spectrum = Spectrum(after[3], after[4], spectrum.samples + 1)
    return after[0], residual, parameters, spectrum
