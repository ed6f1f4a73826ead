"""A diagnosis is one of the machine, not of its control rate: carts on springs at three rates."""

from dataclasses import replace

import numpy as np
import pytest

from ftc.fdi import CERTAIN, DEFAULT_CONFIG, Fault, monitor
from ftc.fdi.decision import CONFIRMATION_S
from ftc.fdi.monitor import JUDGED_S, REVISED_S, MonitorState
from tests.cart_runs import carts
from tests.cart_runs import flown as run_of_carts

PERIODS_S = {"half": 20e-3, "nominal": 10e-3, "twice": 5e-3}
"""Longer than the samples of the diagnosis, which then are of one tick."""

DITHER_HZ, FAILS_S = 5.0, 1.5
CONFIG = replace(
    DEFAULT_CONFIG,
    uncertainty=replace(CERTAIN, offset=3.0, offset_rate=1.0),
    dither_hz=DITHER_HZ,
)


def flown(rate: str, seed: int, fault: Fault | None, duration_s: float) -> list[MonitorState]:
    """States of a monitor at each tick at this rate, to a confirmation."""
    nominal = replace(carts(0, n=3), period_s=PERIODS_S[rate])
    ticks, fails = (round(time_s / nominal.period_s) for time_s in (duration_s, FAILS_S))
    return run_of_carts(monitor(nominal, config=CONFIG), seed, ticks, fault=fault, fails=fails)


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("fault", [Fault(1, "locked"), Fault(2, "free")])
def test_a_failure_is_named_and_confirmed_after_the_same_time_at_each_rate(fault, seed):
    """An alarm within a tenth of a second; a name a period of the dither later; then a second.

    Beside what the next verdict takes to come, and a sample or two.
    """
    alarms_s = []
    for rate, period_s in PERIODS_S.items():
        states = flown(rate, seed, fault, duration_s=3.5)
        named = [state.diagnosis for state in states if state.diagnosis is not None]
        assert {each.fault for each in named} == {fault}
        first, last = named[0], named[-1]
        alarms_s.append(first.alarm_tick * period_s - FAILS_S)
        waited_s = (first.tick - first.alarm_tick) * period_s
        assert 1 / DITHER_HZ <= waited_s + period_s / 2 < 1 / DITHER_HZ + JUDGED_S + 2 * period_s
        assert last.confirmed
        confirmed_s = (last.tick - first.tick) * period_s - CONFIRMATION_S
        assert -1.5 * period_s < confirmed_s < REVISED_S + 2 * period_s
    assert min(alarms_s) >= 0 and max(alarms_s) < min(alarms_s) + 0.1


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("rate", PERIODS_S)
def test_a_healthy_plant_raises_no_alarm_at_any_rate(rate, seed):
    last = flown(rate, seed, None, duration_s=8.0)[-1]
    assert last.alarm_ticks == () and last.diagnosis is None


@pytest.mark.parametrize("rate", PERIODS_S)
def test_what_is_tested_learned_and_remembered_lasts_as_long_at_each_rate(rate):
    """Half a second of residuals; an autoregression of as many coefficients, of as many samples."""
    period_s = PERIODS_S[rate]
    states = flown(rate, 0, None, duration_s=4.0)
    assert len(states[-1].recent) * period_s == pytest.approx(0.5, rel=0.3)
    assert len(states[-1].observer.whitening) - 1 == 10
    filters = [state.observer.whitening for state in states]
    made = [tick for tick in range(1, len(filters)) if filters[tick] is not filters[tick - 1]]
    assert (np.diff(made[-2:]) == 50).all()
