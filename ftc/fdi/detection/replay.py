"""The watch over past samples: with another belief, or with a spectrum that is known by now."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from argument_checks import Array
from ftc.fdi.detection.watch import Moment, Watch, WatchState


def replayed(
    watch: Watch, state: WatchState, past: Sequence[Moment]
) -> tuple[WatchState, list[Moment], list[Array]]:
    """The state after past samples, these as the watch sees them, and its residuals."""
    history, residuals = [], []
    for each in past:
        state, moment = watch.step(state, each.v, each.y)
        history.append(moment)
        residuals.append(state.residual)
    return state, history, residuals


def learned(watch: Watch, state: WatchState, history: Sequence[Moment]) -> WatchState:
    """The state with the spectrum measured so far, as if it had been known from the start."""
    whitening, first = watch.with_spectrum(state).whitening, history[0]
    start = replace(
        watch.start(), sample=first.sample, X=first.X, memory=first.memory, whitening=whitening
    )
    return watch.with_spectrum(replayed(watch, start, history)[0])


def quieter(state: WatchState, inflation: float) -> WatchState:
    """With a spectrum as much larger as the residuals of a failed plant were.

    What shakes the plant goes another way through it after a failure.
    """
    spectrum = replace(state.spectrum, covariance=inflation * state.spectrum.covariance)
    filters = ("whitening", "decoupled")
    less = {name: getattr(state, name) / np.sqrt(inflation) for name in filters}
    return replace(state, spectrum=spectrum, **less)
