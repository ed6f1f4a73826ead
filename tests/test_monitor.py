"""When a diagnosis is named, revised, confirmed or given up, under given verdicts."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest

from experiments.hexapod.fault_tolerance import nominal_model
from experiments.hexapod.testbed import TestbedConfig
from ftc.fdi.diagnosis import FdiConfig, MonitorState
from ftc.fdi.fault_model import Fault, fault_model
from ftc.fdi.hypotheses import HypothesisBank, Verdict
from ftc.fdi.monitor import Monitor, monitor
from sim import load_model

NOMINAL = nominal_model(load_model(), TestbedConfig())
CONFIG = FdiConfig(look_back_s=0.03, confirmation_s=0.01)
USUAL = monitor(NOMINAL, config=CONFIG)
ALARM = 5
STATE = np.linspace(1, 2, 12) * 1e-9


@dataclass(frozen=True)
class Script(HypothesisBank):
    """A bank whose verdict on each tick is given."""

    says: Callable[[int], Verdict]

    def verdict(self, state, tick, x):
        """What is given."""
        return self.says(tick)


def verdict(fault: Fault, actuator=1.0, kind=1.0, fault_free=0.0, p_value=1.0) -> Verdict:
    return Verdict(fault, actuator, kind, fault_free, p_value, onset=ALARM - 1, x=STATE)


LOCKED, WEAK = verdict(Fault(2, "locked")), verdict(Fault(2, "weak", 0.5))
UNSURE = replace(LOCKED, actuator_confidence=0.9)


def watched(says: Callable[[int], Verdict], shocks=(ALARM,)) -> list[MonitorState]:
    """The monitor's states over 60 ticks at rest, the pointing shaken once or twice."""
    watch: Monitor = replace(USUAL, bank=Script(**vars(USUAL.bank), says=says))
    states = [watch.start()]
    for tick in range(60):
        shaken = np.full(2, 1e-3 if tick in shocks else 0.0)
        # The state that the verdict claims explains what is seen after it is named.
        pointing = NOMINAL.plant.C @ STATE if tick > ALARM else 0.0
        states.append(watch.step(states[-1], shaken + pointing, np.zeros(6)))
        if (found := states[-1].diagnosis) is not None and found.confirmed:
            break
    return states[1:]


def test_an_alarm_is_looked_into_until_a_strut_is_certain_and_then_it_is_named():
    states = watched(lambda tick: UNSURE if tick < 12 else LOCKED)
    assert all(state.evidence is None for state in states[:ALARM])
    assert all(state.diagnosis is None for state in states[:12])
    assert states[ALARM].alarm_ticks == states[-1].alarm_ticks == (ALARM,)
    found = states[12].diagnosis
    assert found is not None
    assert (found.fault, found.alarm_tick, found.tick) == (LOCKED.fault, ALARM, 12)
    assert (found.onset_tick, found.confirmed) == (ALARM - 1, False)
    assert found.displacement == pytest.approx(NOMINAL.displacement[2] @ STATE)


def test_what_is_named_is_confirmed_after_the_time_of_confirmation():
    states = watched(lambda tick: LOCKED)
    found = [state.diagnosis for state in states[ALARM:]]
    assert [each is not None and each.confirmed for each in found] == [False] * 10 + [True]
    assert None not in found


def test_a_strut_whose_residuals_noise_does_not_explain_is_not_named():
    """An alarm of that kind is given up when onsets are no longer looked for so far back."""
    states = watched(lambda tick: replace(LOCKED, p_value=1e-7))
    assert all(state.diagnosis is None for state in states)
    given_up = [state.unexplained for state in states].index(True)
    assert given_up == ALARM + 30
    assert states[given_up].evidence is None


def test_an_alarm_is_dismissed_when_soundness_is_certain():
    states = watched(
        lambda tick: UNSURE if tick < 9 else replace(UNSURE, fault_free_confidence=0.9991)
    )
    assert states[8].evidence is not None and states[9].evidence is None
    last = states[-1]
    assert (last.diagnosis, last.unexplained, last.alarm_ticks) == (None, False, (ALARM,))


@pytest.mark.parametrize(
    ("before", "now", "revised"),
    [
        (LOCKED, verdict(Fault(3, "locked"), kind=0.5), True),
        (LOCKED, verdict(Fault(2, "free"), kind=0.9), False),
        (LOCKED, verdict(Fault(2, "free"), kind=0.9991), True),
        (LOCKED, verdict(Fault(3, "locked"), actuator=0.9), False),
        (WEAK, verdict(Fault(2, "weak", 0.54)), False),
        (WEAK, verdict(Fault(2, "weak", 0.44)), True),
        (WEAK, verdict(Fault(2, "weak", 0.56)), True),
    ],
    ids=["strut", "kind unsure", "kind", "strut unsure", "little", "weaker", "stronger"],
)
def test_a_diagnosis_is_revised_when_another_is_certain(before, now, revised):
    """And its time of confirmation begins anew."""
    states = watched(lambda tick: before if tick < 9 else now)
    diagnosis = states[9].diagnosis
    assert diagnosis is not None and not diagnosis.confirmed
    assert (diagnosis.fault, diagnosis.tick) == ((now.fault, 9) if revised else (before.fault, 5))
    if now.actuator_confidence == 1.0:
        confirmed = states[-1].diagnosis
        assert confirmed is not None and confirmed.confirmed and confirmed.fault == now.fault
        assert confirmed.tick == (19 if revised else 15)


def test_what_contradicts_a_named_failure_confirms_it_by_what_came_before():
    """Another shock, four ticks later: the first failure is confirmed at once."""
    states = watched(lambda tick: LOCKED, shocks=(ALARM, ALARM + 4))
    found = states[-1].diagnosis
    assert found is not None and found.confirmed and found.fault == LOCKED.fault
    assert found.tick == ALARM + 4


def test_a_contradicted_failure_that_was_not_certain_before_is_given_up():
    states = watched(lambda tick: LOCKED if tick == 8 else UNSURE, shocks=(ALARM, 20))
    assert states[19].diagnosis is not None
    assert states[20].diagnosis is None and states[20].unexplained


def test_a_confirmed_failure_is_believed_from_its_onset_on():
    last = watched(lambda tick: LOCKED)[-1]
    after, state = USUAL.believing(last)
    assert after.faults == (LOCKED.fault,) and 2 not in after.bank.actuators
    assert [moment.tick for moment in state.history] == list(range(ALARM - 1, 16))
    assert (state.diagnosis, state.evidence, state.alarm_ticks) == (None, None, (ALARM,))
    with pytest.raises(ValueError, match="must hold a confirmed diagnosis"):
        after.believing(state)


def test_after_a_confirmation_each_moments_residual_is_that_of_its_own_outputs():
    """From the naming on, the history recomputed with the faulty model under the commands."""
    last = watched(lambda tick: LOCKED)[-1]
    rng = np.random.default_rng(0)
    history = tuple(
        replace(moment, commanded=1e-6 * rng.standard_normal(6), y=rng.standard_normal(2))
        for moment in last.history
    )
    _, state = USUAL.believing(replace(last, history=history))
    model = fault_model(NOMINAL, [LOCKED.fault])
    expected, x = [], model.onset @ history[ALARM].x
    for moment in history[ALARM + 1 :]:
        x = model.A @ x + model.B @ moment.commanded
        if moment.tick > last.named_tick:
            expected.append(moment.y - model.C @ x)
    assert history[ALARM].tick == ALARM - 1 and len(expected) == 10
    np.testing.assert_allclose(state.recent[-10:], expected, rtol=1e-12)
    assert not state.recent[:-10].any()
    np.testing.assert_allclose(state.history[-1].x, x, rtol=1e-12)
