"""Explain and decide: what an alarm comes from, and what is made of that.

A bank of hypotheses looks back over the history, and goes on until one actuator is certain, or
until it is certain that nothing has failed.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from argument_checks.ties import ascending
from ftc.fdi.detection.watch import Watch
from ftc.fdi.diagnosis import Diagnosis, FdiConfig
from ftc.fdi.fault_model import KINDS, NominalModel
from ftc.fdi.isolation.bank import HypothesisBank
from ftc.fdi.isolation.look_back import looked_back
from ftc.fdi.isolation.verdict import Verdict
from ftc.fdi.monitor_state import MonitorState
from ftc.fdi.naming import WINDOW_S, Naming

REVISED_EVERY = 12
"""In samples: how often hypotheses are judged once an actuator is named."""

_NEGLIGIBLE = 12.0
"""Onsets whose likelihood is e^12 times smaller than the best one's are dropped at a diagnosis."""


@dataclass(frozen=True)
class Judge:
    """Of the alarms of a monitor, of which these are parts."""

    nominal: NominalModel
    config: FdiConfig
    ticks: int
    bank: HypothesisBank
    watch: Watch

    def begun(self, state: MonitorState, reach_s: float) -> MonitorState:
        """With new evidence, of onsets up to so far back."""
        reach = min(self.watch.samples(reach_s), state.history[-1].sample - state.cleared)
        evidence = looked_back(self.bank, self.watch, state.watch, state.history, reach)
        return replace(state, evidence=evidence, verdict=None, begun_tick=state.ticks)

    def judged(self, state: MonitorState) -> MonitorState:
        """Name an actuator, revise that, confirm it, or dismiss the alarm."""
        assert state.evidence is not None
        found, sample = state.diagnosis, state.history[-1].sample
        # Once a failure is named, what shakes the failed machine is slow disturbance enough.
        verdict = self.bank.verdict(state.evidence, sample, disturbed=found is None)
        since = state.alarm_ticks[-1] if found is None else state.named_tick
        waited_s, seen_s = (
            (state.ticks - tick) * self.nominal.period_s for tick in (since, state.begun_tick)
        )
        before = state.verdict
        action = self._naming.action(found, before, verdict, waited_s, seen_s)
        state = replace(state, verdict=verdict)
        if action == "dismiss":
            watch, causes = self.watch.following(state.watch), (*state.causes, verdict.cause)
            return replace(reset(state), watch=watch, cleared=sample, causes=causes)
        if action == "name":
            return self._named(state, verdict)
        if action == "begin":
            return self.begun(state, WINDOW_S / 2)
        if action == "give_up":
            return self._given_up(state)
        if action == "confirm":
            return replace(state, diagnosis=self._diagnosis(state, verdict, confirmed=True))
        if action == "keep" and found is not None and before is not None:
            # What has happened since is not noise of the machine that has been confirmed.
            verdict = replace(verdict, inflation=before.inflation)
            kept = replace(found, confirmed=True, tick=state.ticks - 1)
            return replace(state, verdict=verdict, diagnosis=kept)
        return state

    @cached_property
    def _naming(self) -> Naming:
        improbable = self.config.false_alarms_per_hour * self.watch.period_s * REVISED_EVERY / 3600
        return Naming(self.config, REVISED_EVERY * len(self.nominal.noise), improbable)

    def _named(self, state: MonitorState, verdict: Verdict) -> MonitorState:
        """With this diagnosis, and without onsets that hardly matter any more."""
        assert state.evidence is not None
        likely = verdict.best >= verdict.best.max() - _NEGLIGIBLE
        diagnosis = self._diagnosis(state, verdict, confirmed=False)
        named = state.ticks - 1 if state.diagnosis is None else state.named_tick
        return replace(
            state, evidence=state.evidence.only(likely), named_tick=named, diagnosis=diagnosis
        )

    def _given_up(self, state: MonitorState) -> MonitorState:
        """Nothing explains the residuals: the watch goes on, and learns what they are like."""
        state = replace(reset(state), unexplained=True, cleared=state.history[-1].sample)
        learning = self.watch.samples(self.config.learning_s)
        return replace(state, relearns=learning, watch=self.watch.relearning(state.watch))

    def _diagnosis(self, state: MonitorState, verdict: Verdict, confirmed: bool) -> Diagnosis:
        row = self.nominal.displacement[verdict.fault.actuator]
        likely = np.array(verdict.kind_confidences)
        by_likelihood = [(likely[k], KINDS[k]) for k in ascending(-likely)]
        alike = 1 - self.config.confidence
        return Diagnosis(
            fault=verdict.fault,
            kinds=tuple(kind for likely, kind in by_likelihood if likely > alike),
            actuator_confidence=verdict.actuator_confidence,
            kind_confidence=verdict.kind_confidences[KINDS.index(verdict.fault.kind)],
            displacement=float(row @ verdict.x),
            onset_tick=verdict.onset * self.ticks,
            alarm_tick=state.alarm_ticks[-1],
            tick=state.ticks - 1,
            confirmed=confirmed,
        )


def reset(state: MonitorState) -> MonitorState:
    """Nothing is suspected any more; the history and the record of alarms stay."""
    return replace(
        state,
        recent=np.zeros_like(state.recent),
        evidence=None,
        verdict=None,
        named_tick=0,
        diagnosis=None,
    )
