"""Watch: residuals of the believed model, with its parameters and their spectrum tracked."""

from dataclasses import dataclass, replace

import numpy as np

from argument_checks import Array
from ftc.fdi.detection.parameter_filter import Parameters
from ftc.fdi.detection.whitening import Spectrum
from ftc.fdi.diagnosis import FdiConfig
from ftc.fdi.uncertainty import UncertainModel


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


@dataclass(frozen=True)
class WatchState:
    """State after a sample; the fields are those of a :class:`Moment`.

    Attributes:
        spectrum: Of the residuals.
        whitening: Their filter, shape (q + 1, p).
        residual: Latest innovation, shape (p,); before the spectrum is known, zero.
        measured: Samples since the last one in which nothing was measured.
    """

    sample: int
    X: Array
    memory: Array
    parameters: Parameters
    spectrum: Spectrum
    whitening: Array
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
    """

    model: UncertainModel
    config: FdiConfig
    period_s: float
    largest: float = np.inf

    def start(self) -> WatchState:
        """At rest at the equilibrium."""
        p, s = self.model.C.shape
        rows, q = len(self.model.M), self.config.order
        white = np.zeros((q + 1, p))
        white[0] = 1.0
        return WatchState(
            sample=0,
            X=np.zeros((rows, s)),
            memory=np.zeros((q + 1, rows, p)),
            parameters=Parameters.prior(rows - 1, p, self.config.uncertainty),
            spectrum=Spectrum.start(q, p),
            whitening=white,
            residual=np.zeros(p),
            measured=q,
        )

    def step(
        self, state: WatchState, v: Array, y: Array | None, *, learns: bool = True
    ) -> tuple[WatchState, Moment]:
        """One sample; with `learns` the parameters and the spectrum are updated.

        One that was not measured is as the model predicts it, whatever its parameters are, which
        drift meanwhile.
        """
        config = self.config
        measured = 0 if y is None else state.measured + 1
        whole = measured > config.order
        moment = Moment(state.sample, state.X, state.memory, state.parameters, v, y, whole)
        Y, X = self.model.step(state.X, v)
        state = replace(state, sample=state.sample + 1, X=X, measured=measured)
        if y is None:
            memory = np.concatenate([state.memory[1:], np.zeros((1, *Y.shape))])
            residual = np.zeros(Y.shape[1])
            drifted = self._drifted(state.parameters, len(residual))
            state = replace(state, memory=memory, parameters=drifted, residual=residual)
            return state, moment
        Y[0] = y - Y[0]
        memory = np.concatenate([state.memory[1:], Y[None]])
        white = np.einsum("qp,qcp->cp", state.whitening[::-1], memory)
        regressors = np.vstack([white[1:], np.diag(state.whitening.sum(axis=0))])
        parameters, p = state.parameters, len(y)
        residual, parameters = parameters.measured(white[0], regressors)
        state = replace(state, memory=memory, residual=residual)
        known = state.spectrum.samples * self.period_s >= config.learning_s
        if not (learns and whole) or (known and residual @ residual > self.largest):
            return state, moment
        left = Y[0] - parameters.mean[:-p] @ Y[1:] - parameters.mean[-p:]
        spectrum = state.spectrum.with_residual(left, config.memory_s / self.period_s)
        state = replace(state, parameters=self._drifted(parameters, p), spectrum=spectrum)
        return state, moment

    def _drifted(self, parameters: Parameters, p: int) -> Parameters:
        return parameters.drifted(self.period_s, p, self.config.uncertainty, self.model.limits)

    def observed(self, state: WatchState) -> Array:
        """Part of each parameter's prior variance that the motion so far has removed, (J + p,).

        One: known exactly; zero: not observable by these sensors under these commands.
        """
        p = len(state.residual)
        prior = Parameters.prior(len(self.model.M) - 1, p, self.config.uncertainty)
        left = np.diag(state.parameters.covariance) / np.diag(prior.covariance)
        return np.clip(1 - left, 0.0, 1.0)

    def with_spectrum(self, state: WatchState) -> WatchState:
        """With the filter of the spectrum measured so far."""
        fitted = len(state.parameters.mean) / len(state.residual)
        memory = self.config.memory_s / self.period_s
        return replace(state, whitening=state.spectrum.filter(fitted, memory))
