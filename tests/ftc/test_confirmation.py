"""How a named failure is revised, confirmed, contradicted and believed, under given verdicts."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from ftc.fdi import Fault, fault_model, monitor
from ftc.fdi.bank import believed_model, hypothesis_bank
from tests.scripted_monitor import (
    LOCKED,
    NOMINAL,
    SHOCK,
    TICKS,
    UNSURE,
    USUAL,
    WEAK,
    flown,
    named,
    verdict,
)


def test_none_is_named_before_a_period_of_the_dither_however_certain_it_seems():
    """At the alarm another actuator seems certain; 0.2 s later, after 20 samples, it does not."""
    other = verdict(Fault(1, "weak", 0.5))
    states = flown(
        lambda sample: other if sample < SHOCK + 19 else LOCKED, SHOCK + 40, dither_hz=5.0
    )
    assert set(named(states).values()) == {LOCKED.fault}
    assert SHOCK + 20 <= min(named(states)) < SHOCK + 22  # judged every 16 ms


def test_what_is_named_is_confirmed_after_the_time_of_confirmation():
    states = flown(lambda sample: LOCKED)
    assert min(named(states)) == SHOCK
    last = max(states)
    assert SHOCK + 100 <= last < SHOCK + 105  # judged every 48 ms by now
    found = states[last].diagnosis
    assert found is not None and found.confirmed


def test_the_time_of_confirmation_begins_when_an_actuator_is_named_not_at_the_alarm():
    states = flown(lambda sample: UNSURE if sample < SHOCK + 40 else LOCKED)
    assert max(states) >= min(named(states)) + 100 > SHOCK + 140


def test_onsets_that_hardly_matter_are_dropped_when_an_actuator_is_named():
    """Those whose likelihood is more than e^12 times smaller than the best one's."""
    steep = replace(LOCKED, best=np.array([0.0, -11.9, -12.1]))
    states = flown(lambda sample: UNSURE if sample < SHOCK + 4 else steep, SHOCK + 8)
    before, after = states[SHOCK].evidence, states[min(named(states))].evidence
    assert before is not None and after is not None
    kept = np.arange(len(before.onsets)) % 3 < 2
    np.testing.assert_array_equal(after.onsets, before.onsets[kept])


REVISIONS = {
    "actuator": (LOCKED, verdict(Fault(1, "locked"), kind=0.5), True),
    "kind unsure": (LOCKED, verdict(Fault(2, "free"), kind=0.9), False),
    "kind": (LOCKED, verdict(Fault(2, "free"), kind=0.9991), True),
    "actuator unsure": (LOCKED, verdict(Fault(1, "locked"), actuator=0.9), False),
    "little": (WEAK, verdict(Fault(2, "weak", 0.58)), False),
    "weaker": (WEAK, verdict(Fault(2, "weak", 0.38)), True),
    "stronger": (WEAK, verdict(Fault(2, "weak", 0.62)), True),
}


@pytest.mark.parametrize("name", REVISIONS)
def test_a_diagnosis_is_revised_when_another_is_certain(name):
    before, now, revised = REVISIONS[name]
    states = flown(lambda sample: before if sample < SHOCK + 10 else now, SHOCK + 30)
    assert states[SHOCK].diagnosis is not None
    found = states[SHOCK + 29].diagnosis
    assert found is not None and not found.confirmed
    assert found.fault == (now.fault if revised else before.fault)


def test_kinds_that_cannot_be_told_apart_are_said():
    """Those likelier than one in a thousand, the likeliest first, which need not be named."""
    alike = replace(LOCKED, kind_confidences=(0.3, 0.6995, 0.0005))
    found = flown(lambda sample: alike, SHOCK + 1)[SHOCK].diagnosis
    assert found is not None and found.kinds == ("free", "locked")
    assert found.kind_confidence == 0.3


@pytest.mark.parametrize("inflation", [1.0, 2.0])
@pytest.mark.parametrize(("part", "contradicts"), [(0.98, False), (1.02, True)])
def test_what_contradicts_a_named_failure_confirms_it(part, inflation, contradicts):
    """Its energy grows at once by more than five samples of three outputs make in 100 hours.

    Chance is as much larger as the residuals were before.
    """
    jump = part * inflation * chi2.isf(0.01 * 5 * 10e-3 / 3600, 5 * 3)
    said = replace(LOCKED, inflation=inflation)
    states = flown(
        lambda sample: replace(said, energy=0.0 if sample < SHOCK + 24 else jump), SHOCK + 40
    )
    found = states[max(states)].diagnosis
    assert found is not None and found.fault == LOCKED.fault
    assert found.confirmed == contradicts


def test_what_contradicts_a_name_does_not_make_the_watch_deaf_for_what_follows():
    """It is tested by the noise of the failed machine, not by the size of what came after."""
    after = replace(LOCKED, inflation=25.0, energy=1e6)
    states = flown(lambda sample: LOCKED if sample < SHOCK + 24 else after, SHOCK + 40)
    last = states[max(states)]
    assert last.diagnosis is not None and last.diagnosis.confirmed
    assert last.verdict is not None and last.verdict.inflation == LOCKED.inflation


def test_a_name_that_leaves_four_times_what_it_explains_is_taken_back():
    """However certain it is that no other actuator is it."""
    for left, back in ((0.79, False), (0.81, True)):
        later = replace(LOCKED, unexplained=left)
        states = flown(lambda sample, later=later: LOCKED if sample < SHOCK + 20 else later)
        assert states[max(states)].unexplained == back


@pytest.mark.parametrize(("inflation", "back"), [(29.0, True), (31.0, False)])
def test_a_name_is_taken_back_for_what_explains_better_and_for_nothing_else(inflation, back):
    """That nothing has failed is as likely as one likes where no hypothesis fits."""
    calm = replace(
        LOCKED, actuator_confidence=0.0, fault_free_confidence=1.0, inflation=inflation, energy=1e6
    )
    states = flown(lambda sample: LOCKED if sample < SHOCK + 20 else calm, SHOCK + 40)
    found = states[max(states)].diagnosis
    assert (found is None) == back
    assert found is None or found.confirmed  # something else has happened since


def test_one_that_works_again_and_stops_has_not_worked_for_the_time_of_a_confirmation():
    again = verdict(Fault(2, "weak", 1.0))
    said = replace(again, energy=1e6)
    states = flown(lambda sample: again if sample < SHOCK + 24 else said, SHOCK + 40)
    assert states[SHOCK + 20].diagnosis is not None
    last = states[max(states)]
    assert last.diagnosis is None and not last.unexplained


def test_a_named_failure_that_is_never_certain_again_is_given_up():
    """After twice the time of confirmation."""
    states = flown(lambda sample: LOCKED if sample < SHOCK + 10 else UNSURE)
    last = max(named(states))
    assert SHOCK + 200 <= last + 1 < SHOCK + 205
    assert states[last + 1].unexplained and states[last + 1].diagnosis is None


def test_a_confirmed_failure_is_believed_from_its_onset_on():
    """The watch goes on as if its model had been known: its states by that model, tick by tick."""
    states = flown(lambda sample: replace(LOCKED, inflation=4.0))
    last = states[max(states)]
    after, state = USUAL.believing(last)
    # What shook the failed plant with four times the variance shakes the one that is believed.
    np.testing.assert_allclose(2 * state.observer.whitening, last.observer.whitening)
    assert after.faults == (LOCKED.fault,)
    again = {fault for fault in after.bank.faults if fault.actuator == 2}
    assert again == {Fault(2, "weak", 1.0), Fault(2, "free")}
    assert (state.diagnosis, state.evidence, state.alarm_ticks) == (None, None, (282,))
    assert state.history[0].number == SHOCK - 1 and state.history[-1] is not last.history[-1]
    since = (TICKS * state.history[-1].number - last.named_tick + 1) // TICKS
    assert (np.abs(state.recent).max(axis=1) > 0).sum() == min(since, len(state.recent))
    model = fault_model(NOMINAL, [LOCKED.fault])
    begun = next(each for each in last.history if each.number == SHOCK - 1)
    x = model.onset @ begun.before.X[0]
    for moment in state.history:
        np.testing.assert_allclose(moment.before.X[0], x, atol=1e-15)
        for _ in range(TICKS):
            x = model.A @ x + model.B @ moment.v[:3]
    with pytest.raises(ValueError, match="must hold a confirmed diagnosis"):
        after.believing(state)


@pytest.mark.parametrize(
    ("found", "known"),
    [
        (verdict(Fault(2, "locked")), (Fault(0, "free"), Fault(2, "locked"))),
        (verdict(Fault(0, "locked")), (Fault(0, "locked"),)),
        (verdict(Fault(0, "weak", 1.0)), ()),
    ],
    ids=["another", "the same, further", "sound again"],
)
def test_what_was_known_of_other_actuators_stays_known(found, known):
    """A new name replaces what was known of its own actuator alone."""
    before = monitor(NOMINAL, [Fault(0, "free")], USUAL.config)
    states = flown(lambda _: found)
    after, _ = before.believing(states[max(states)])
    assert after.faults == known


@pytest.mark.parametrize("faults", [(), (Fault(0, "locked"),), (Fault(1, "weak", 0.4),)])
def test_the_believed_model_alone_is_that_of_all_hypotheses(faults):
    alone = believed_model(NOMINAL, faults, USUAL.config.uncertainty, TICKS)
    together = hypothesis_bank(NOMINAL, faults, USUAL.config.uncertainty, TICKS).believed
    for name in ("A", "M", "C", "N", "onset"):
        np.testing.assert_array_equal(getattr(alone, name), getattr(together, name))
