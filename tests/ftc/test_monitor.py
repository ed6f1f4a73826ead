"""When an alarm is raised, looked into, dismissed or given up, under given verdicts."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from tests.scripted_monitor import (
    LOCKED,
    MISFIT,
    NOMINAL,
    SHOCK,
    STATE,
    TICKS,
    UNSURE,
    USUAL,
    flown,
    named,
)


def test_an_alarm_is_looked_into_until_an_actuator_is_certain_and_then_it_is_named():
    states = flown(lambda sample: UNSURE if sample < SHOCK + 20 else LOCKED)
    assert all(state.evidence is None for sample, state in states.items() if sample < SHOCK)
    assert states[SHOCK].evidence is not None and states[SHOCK].alarm_ticks == (282,)
    first = min(named(states))
    assert SHOCK + 20 <= first < SHOCK + 22  # hypotheses are judged every 16 ms
    found = states[first].diagnosis
    assert found is not None and found.fault == LOCKED.fault and not found.confirmed
    assert (found.alarm_tick, found.tick) == (282, TICKS * first + TICKS)
    assert found.onset_tick == TICKS * (SHOCK - 1)
    assert found.displacement == pytest.approx(NOMINAL.displacement[2] @ STATE)


@pytest.mark.parametrize("actuator", [0.9989, 0.9991])
def test_no_actuator_is_named_below_the_stated_confidence(actuator):
    """0.999: else the alarm is given up when onsets are no longer looked for so far back."""
    states = flown(lambda sample: replace(LOCKED, actuator_confidence=actuator), SHOCK + 115)
    assert bool(named(states)) == (actuator > 0.999)
    unexplained = [sample for sample, state in states.items() if state.unexplained]
    if actuator < 0.999:
        assert SHOCK + 100 <= min(unexplained) < SHOCK + 102
        last = states[min(unexplained)]
        assert last.evidence is None and last.relearns == 80  # as many as at the start
    else:
        assert not unexplained


@pytest.mark.parametrize(("part", "is_named"), [(0.29, True), (0.31, False)])
def test_a_failure_that_leaves_most_of_the_residuals_is_not_named(part, is_named):
    states = flown(lambda sample: replace(LOCKED, unexplained=part), SHOCK + 115)
    assert bool(named(states)) == is_named
    assert max(states.items())[1].unexplained == (not is_named)


@pytest.mark.parametrize(
    ("inflation", "part", "is_named"),
    [(29.0, 0.2, True), (31.0, 0.009, True), (31.0, 0.011, False)],
)
def test_a_failure_whose_residuals_are_not_noise_is_not_named(inflation, part, is_named):
    """Above 30 times the variance; where a model of so large a failure errs, 1 % of the energy."""
    said = replace(LOCKED, inflation=inflation, unexplained=part)
    assert bool(named(flown(lambda sample: said, SHOCK + 10))) == is_named


def test_while_nothing_fits_evidence_begins_anew_and_what_was_before_is_left_behind():
    """After 0.2 s each, of 20 samples, with onsets in the last half of them."""
    states = flown(lambda sample: MISFIT if sample < SHOCK + 45 else LOCKED, SHOCK + 50)
    first = {k: each.evidence.onsets[0] for k, each in states.items() if each.evidence is not None}
    begun = [k for k in range(SHOCK + 1, SHOCK + 45) if first[k] != first[k - 1]]
    assert len(begun) == 2 and all(20 <= gap <= 22 for gap in np.diff([SHOCK, *begun]))
    assert all(begun_at - 10 <= first[begun_at] < begun_at for begun_at in begun)
    assert min(named(states)) >= SHOCK + 45 and first[SHOCK + 49] > SHOCK


def test_a_named_failure_that_no_longer_fits_is_given_up():
    states = flown(lambda sample: LOCKED if sample < SHOCK + 20 else MISFIT, SHOCK + 40)
    last = max(named(states))
    assert SHOCK + 19 <= last < SHOCK + 20 + 5  # judged every 48 ms
    assert states[last + 1].unexplained and states[last + 1].diagnosis is None


def test_after_an_unexplained_alarm_the_watch_is_not_blind():
    """What it knew before is tested by from the next sample on, and what is new is learned."""
    states = flown(lambda sample: UNSURE, SHOCK + 190)
    given_up = min(sample for sample, state in states.items() if state.unexplained)
    last, then = states[given_up - 1], states[given_up]
    np.testing.assert_array_equal(then.observer.whitening, last.observer.whitening)
    assert then.relearns == 80 and np.abs(states[given_up + 1].recent).max() > 0
    assert then.cleared == given_up  # no onset is looked for before it
    assert states[given_up + 80].relearns == 0
    assert not np.allclose(states[given_up + 80].observer.whitening, last.observer.whitening)


@pytest.mark.parametrize(("free", "over"), [(0.9989, False), (0.9991, True)])
def test_an_alarm_is_dismissed_when_soundness_is_certain(free, over):
    calm = replace(UNSURE, actuator_confidence=1 - free, fault_free_confidence=free)
    states = flown(lambda sample: UNSURE if sample < SHOCK + 20 else calm, SHOCK + 30)
    last = states[SHOCK + 29]
    assert (last.evidence is None) == over
    assert (last.diagnosis, last.unexplained, last.alarm_ticks[0]) == (None, False, 282)


def test_what_is_looked_back_at_may_have_drifted_as_long():
    """The prior of the evidence is the tracked one, an offset's walk over a second added."""
    states = flown(lambda sample: UNSURE, SHOCK + 1, offset=20.0)
    evidence, history = states[SHOCK].evidence, states[SHOCK].history
    assert evidence is not None
    first = next(each for each in history if each.number == evidence.onsets[0])
    grown = evidence.prior.covariance - first.before.parameters.covariance
    np.testing.assert_allclose(grown, np.eye(3), atol=1e-9)


def test_the_filter_of_the_spectrum_is_made_anew_every_fiftieth_sample():
    states = flown(lambda sample: UNSURE, 160, shock=1000)
    filters = [states[sample].observer.whitening for sample in (120, 148, 149, 159)]
    np.testing.assert_array_equal(filters[0], filters[1])
    assert not np.allclose(filters[1], filters[2])
    made = USUAL.observer.with_spectrum(states[149].observer).whitening
    np.testing.assert_array_equal(filters[2], made)
    np.testing.assert_array_equal(filters[2], filters[3])


@pytest.mark.parametrize(("shock", "learned"), [(78, True), (81, False)])
def test_a_shock_while_the_plant_is_learned_is_no_alarm_but_learned(shock, learned):
    """In the first 0.8 s, of 80 samples; later it is an alarm, and not learned."""
    states = flown(lambda sample: UNSURE, shock + 1, shock=shock)
    state, before = states[shock], states[shock - 1].observer.spectrum.samples
    assert state.observer.spectrum.samples == before + learned
    assert bool(state.alarm_ticks) == (state.evidence is not None) == (not learned)


def test_the_residuals_are_tested_at_the_stated_rate_of_false_alarms():
    """One in 100 hours of samples of 10 ms, shared by seven means of three outputs."""
    expected = chi2.isf(0.01 * 10e-3 / 3600 / 7, 3)
    assert USUAL.test.threshold == pytest.approx(expected, rel=1e-9)
    assert len(USUAL.test.start()) == 2**6


def test_onsets_are_looked_for_as_far_back_as_stated_and_less_densely_there():
    """From the last sample to a second before it; each 1.25 times as far as the one after it."""
    evidence = flown(lambda sample: UNSURE, SHOCK + 1)[SHOCK].evidence
    assert evidence is not None
    back = SHOCK - evidence.onsets[::-1]
    assert back[0] == 0 and back[-1] <= 100 < 1.25 * back[-1] + 1
    np.testing.assert_array_equal(np.diff(back), np.maximum(1, np.round(0.25 * back[:-1])))
