"""When a diagnosis is named, revised, settled or given up: the rules, under given verdicts."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest

from experiments.hexapod.testbed import Bench
from ftc.controller import Sensed
from ftc.fdi.config import Rules
from ftc.fdi.diagnosis import MonitorState
from ftc.fdi.fault_model import Fault, sound_machine
from ftc.fdi.hypotheses import Bank, Verdict
from ftc.fdi.monitor import Monitor, monitor
from ftc.fdi.sensing import sensing
from sim import load_model

BENCH = Bench()
SOUND = sound_machine(load_model(), BENCH)
RULES = Rules(look_back_s=0.03, confirmation_s=0.01)
ALARM = 5
STATE = np.linspace(1, 2, 12) * 1e-9


@dataclass(frozen=True)
class Script(Bank):
    """A bank whose verdict on each tick is given."""

    says: Callable[[int], Verdict]

    def verdict(self, state, tick, x):
        """What is given."""
        return self.says(tick)


def verdict(fault: Fault, strut=1.0, kind=1.0, sound=0.0, misfit=1.0) -> Verdict:
    return Verdict(fault, strut, kind, sound, misfit, onset=ALARM - 1, x=STATE)


LOCKED, WEAK = verdict(Fault(2, "locked")), verdict(Fault(2, "weak", 0.5))
UNSURE = replace(LOCKED, strut_confidence=0.9)


def watched(says: Callable[[int], Verdict], shocks=(ALARM,)) -> list[MonitorState]:
    """The monitor's states over 60 ticks at rest, the pointing shaken once or twice."""
    usual = monitor((), SOUND, sensing(SOUND, BENCH, strut_sensors=False), RULES)
    watch: Monitor = replace(usual, bank=Script(**vars(usual.bank), says=says))
    states = [watch.start()]
    for tick in range(60):
        shaken = np.full(2, 1e-3 if tick in shocks else 0.0)
        # The state that the verdict claims explains what is seen after it is named.
        pointing = watch.sensing.C @ STATE * watch.sensing.noise if tick > ALARM else 0.0
        states.append(watch.step(states[-1], Sensed(shaken + pointing, np.zeros(0)), np.zeros(6)))
        if (found := states[-1].diagnosis) is not None and found.settled:
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
    assert (found.onset_tick, found.settled) == (ALARM - 1, False)
    assert found.displacement_m == pytest.approx(SOUND.linear.C_active[2] @ STATE)


def test_what_is_named_is_settled_after_the_time_of_confirmation():
    states = watched(lambda tick: LOCKED)
    found = [state.diagnosis for state in states[ALARM:]]
    assert [each is not None and each.settled for each in found] == [False] * 10 + [True]
    assert None not in found


def test_a_strut_whose_residuals_noise_does_not_explain_is_not_named():
    """An alarm of that kind is given up when onsets are no longer looked for so far back."""
    states = watched(lambda tick: replace(LOCKED, misfit=1e-7))
    assert all(state.diagnosis is None for state in states)
    given_up = [state.unexplained for state in states].index(True)
    assert given_up == ALARM + 30
    assert states[given_up].evidence is None


def test_an_alarm_is_dismissed_when_soundness_is_certain():
    states = watched(lambda tick: UNSURE if tick < 9 else replace(UNSURE, sound_confidence=0.9991))
    assert states[8].evidence is not None and states[9].evidence is None
    last = states[-1]
    assert (last.diagnosis, last.unexplained, last.alarm_ticks) == (None, False, (ALARM,))


@pytest.mark.parametrize(
    ("before", "now", "revised"),
    [
        (LOCKED, verdict(Fault(3, "locked"), kind=0.5), True),
        (LOCKED, verdict(Fault(2, "free"), kind=0.9), False),
        (LOCKED, verdict(Fault(2, "free"), kind=0.9991), True),
        (LOCKED, verdict(Fault(3, "locked"), strut=0.9), False),
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
    assert diagnosis is not None and not diagnosis.settled
    assert (diagnosis.fault, diagnosis.tick) == ((now.fault, 9) if revised else (before.fault, 5))
    if now.strut_confidence == 1.0:
        settled = states[-1].diagnosis
        assert settled is not None and settled.settled and settled.fault == now.fault
        assert settled.tick == (19 if revised else 15)


def test_what_contradicts_a_named_failure_settles_it_by_what_came_before():
    """Another shock, four ticks later: the first failure is settled at once."""
    states = watched(lambda tick: LOCKED, shocks=(ALARM, ALARM + 4))
    found = states[-1].diagnosis
    assert found is not None and found.settled and found.fault == LOCKED.fault
    assert found.tick == ALARM + 4


def test_a_contradicted_failure_that_was_not_certain_before_is_given_up():
    states = watched(lambda tick: LOCKED if tick == 8 else UNSURE, shocks=(ALARM, 20))
    assert states[19].diagnosis is not None
    assert states[20].diagnosis is None and states[20].unexplained


def test_a_settled_failure_is_believed_from_its_onset_on():
    last = watched(lambda tick: LOCKED)[-1]
    usual = monitor((), SOUND, sensing(SOUND, BENCH, strut_sensors=False), RULES)
    after, state = usual.believing(last)
    assert after.faults == (LOCKED.fault,) and 2 not in after.bank.struts
    assert [moment.tick for moment in state.history] == list(range(ALARM - 1, 16))
    assert (state.diagnosis, state.evidence, state.alarm_ticks) == (None, None, (ALARM,))
    with pytest.raises(ValueError, match="must hold a settled diagnosis"):
        after.believing(state)
