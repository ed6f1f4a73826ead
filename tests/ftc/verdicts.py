"""A monitor whose verdicts are given, in flights of noise with a shock."""

from collections.abc import Callable
from dataclasses import fields, replace
from functools import cache
from unittest.mock import patch

import numpy as np

from ftc.fdi import CERTAIN, Fault, monitor
from ftc.fdi.bank import HypothesisBank
from ftc.fdi.decision import Verdict
from ftc.fdi.diagnosis import FdiConfig
from ftc.fdi.monitor import Monitor, MonitorState
from tests.ftc.carts import carts

CONFIG = FdiConfig(uncertainty=replace(CERTAIN, offset=3.0, offset_rate=1.0), sample_s=10e-3)
TICKS = 2  # of a sample
SHOCK = 140  # sample
STATE = np.linspace(1, 2, 6) * 1e-3


@cache
def usual() -> Monitor:
    """Of three carts, 5 ms a tick."""
    return monitor(carts(0, n=3), config=CONFIG)


class Guarded(HypothesisBank):
    """A bank that knows when the shock was."""

    def start(self, onsets, prior, X, memory):
        """The bank's; residuals before the first onset are noise, without the known offset."""
        assert np.abs(memory[:, 0]).max() < 6 or onsets[0] > SHOCK
        return super().start(onsets, prior, X, memory)


def verdict(fault: Fault, actuator: float = 1.0, kind: float = 1.0) -> Verdict:
    kinds = {"locked": (kind, 1 - kind, 0.0), "free": (1 - kind, kind, 0.0)}
    return Verdict(
        fault=fault,
        actuator_confidence=actuator,
        kind_confidences=kinds.get(fault.kind, (0.0, 1 - kind, kind)),
        fault_free_confidence=0.0,
        cause=None,
        inflation=1.0,
        unexplained=0.0,
        energy=0.0,
        strain=0.0,
        onset=SHOCK - 1,
        x=STATE,
        best=np.zeros(1),
    )


LOCKED, WEAK = verdict(Fault(2, "locked")), verdict(Fault(2, "weak", 0.5))
UNSURE = replace(LOCKED, actuator_confidence=0.9)
MISFIT = replace(LOCKED, inflation=31.0, unexplained=0.02)


@cache
def noise(ticks: int) -> np.ndarray:
    return np.random.default_rng(0).standard_normal((ticks, 3))


@cache
def quiet(samples: int, offset: float) -> tuple[Monitor, list]:
    """A monitor, and its states at the ticks of so many samples of noise alone."""
    watch = replace(usual())
    own = {each.name: getattr(usual().bank, each.name) for each in fields(HypothesisBank)}
    vars(watch)["bank"], states = Guarded(**own), [watch.start()]
    for y in noise(TICKS * samples):
        states.append(watch.step(states[-1], watch.nominal.noise * (y + offset), np.zeros(3)))
    return watch, states


def judged(
    says: Callable[[int], Verdict], samples: int = 360, shock: int = SHOCK, offset: float = 0.0
) -> dict[int, MonitorState]:
    """States of the monitor after each sample, of noise with a shock, to the confirmation."""
    watch, before = quiet(min(samples, shock), offset)
    states = {tick // TICKS - 1: before[tick + 1] for tick in range(TICKS, len(before) - 1, TICKS)}
    state = before[-1]

    def said(bank, evidence, sample, *, disturbed):
        """What is given, with as many likelihoods as there are onsets."""
        return replace(says(sample), best=np.resize(says(sample).best, len(evidence.onsets)))

    for tick in range(len(before) - 1, TICKS * samples + 1):
        y = noise(TICKS * samples + 1)[tick] + 50.0 * (tick // TICKS == shock) + offset
        with patch("ftc.fdi.monitor.verdict", said):
            state = watch.step(state, watch.nominal.noise * y, np.zeros(3))
        if tick and tick % TICKS == 0:
            states[tick // TICKS - 1] = state
            if state.diagnosis is not None and state.diagnosis.confirmed:
                break
    return states


def changes_at(sample: int, before: Verdict, after: Verdict, samples: int = 360):
    """States where the verdict becomes another so many samples after the shock."""
    return judged(lambda now: before if now < SHOCK + sample else after, samples)


def named(states: dict[int, MonitorState]) -> dict[int, Fault]:
    return {
        sample: state.diagnosis.fault
        for sample, state in states.items()
        if state.diagnosis is not None
    }
