"""Detection, isolation, confirmation: the diagnosis of one failure after another.

The machine as it is believed to be runs beside the real one; a chart watches the residuals. On an
alarm a bank of hypotheses looks back over the history, and goes on until one strut is certain, or
until it is certain that nothing has failed. A diagnosis may be revised for a while, before its
machine becomes the believed one.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ftc.controller import Sensed
from ftc.fdi.config import Rules
from ftc.fdi.diagnosis import Diagnosis, Moment, MonitorState
from ftc.fdi.fault_model import Fault, SoundMachine
from ftc.fdi.hypotheses import Bank, BankState, Verdict, bank
from ftc.fdi.residual_test import Chart, chart
from ftc.fdi.sensing import Sensing
from sim import Array


@dataclass(frozen=True)
class Monitor:
    """Watches a machine that is believed to have these faults and no others."""

    faults: tuple[Fault, ...]
    sound: SoundMachine
    sensing: Sensing
    rules: Rules
    bank: Bank
    chart: Chart

    def start(self) -> MonitorState:
        """At rest at the nominal pose."""
        p, s = self.sensing.C.shape
        nothing = Moment(-1, np.zeros(s), np.zeros(self.sound.struts), np.zeros(p))
        return MonitorState((nothing,), self.chart.start())

    def step(self, state: MonitorState, sensed: Sensed, sent_m: Array) -> MonitorState:
        """One tick.

        Args:
            state: From the tick before.
            sensed: Now.
            sent_m: Strut displacements commanded since the tick before, shape (6,).
        """
        last, machine = state.history[-1], self.bank.believed
        x = machine.step(last.x, sent_m)
        now = Moment(last.tick + 1, x, sent_m, self.sensing.whitened(sensed))
        kept = self._ticks(self.rules.look_back_s)
        if state.evidence is not None:  # back to the oldest onset that is looked for
            kept = last.tick - int(state.evidence.onsets[0]) + 1
        state = replace(state, history=(*state.history[-kept:], now))
        if state.evidence is not None:
            return self._judged(state, self._heard(state.evidence, now))
        state = self._charted(state, x)
        if self.chart.alarm(state.recent):
            state = replace(state, alarm_ticks=(*state.alarm_ticks, now.tick))
            return self._judged(state, self._looked_back(state.history))
        return state

    def believing(self, state: MonitorState) -> tuple["Monitor", MonitorState]:
        """The monitor that goes on from a settled diagnosis, its history told anew.

        Raises:
            ValueError: The diagnosis of `state` is not settled.
        """
        found = state.diagnosis
        if found is None or not found.settled:
            raise ValueError(f"state must hold a settled diagnosis, got {found}")
        others = (known for known in self.faults if known.strut != found.fault.strut)
        after = monitor((*others, found.fault), self.sound, self.sensing, self.rules)
        machine = after.bank.believed
        past = [moment for moment in state.history if moment.tick >= found.onset_tick]
        told = [replace(past[0], x=machine.onset @ past[0].x)]
        for moment in past[1:]:
            x = machine.step(told[-1].x, moment.sent_m)
            told.append(replace(moment, x=x))
        begun = replace(self._forgetting(state), history=tuple(told))
        for moment in told:
            if moment.tick > state.named_tick:
                begun = after._charted(replace(begun, history=(moment,)), moment.x)
        return after, replace(begun, history=tuple(told))

    def _charted(self, state: MonitorState, x: Array) -> MonitorState:
        """With the residual that the latest outputs leave if the machine's state is x."""
        residual = state.history[-1].y - self.sensing.C @ x
        return replace(state, recent=np.vstack([state.recent[1:], residual]))

    def _heard(self, evidence: BankState, moment: Moment) -> BankState:
        return self.bank.step(evidence, moment.tick, moment.x, moment.sent_m, moment.y)

    def _looked_back(self, history: tuple[Moment, ...]) -> BankState:
        """The evidence in the history, for onsets at growing distances before the last moment."""
        now = history[-1].tick
        reach = min(now - history[0].tick, self._ticks(self.rules.look_back_s))
        distances, distance = [0], 1
        while distance <= reach:
            distances.append(distance)
            distance = max(distance + 1, round(distance * self.rules.onset_growth))
        evidence = self.bank.start(now - np.array(distances[::-1]))
        return self._evidence(evidence, history)

    def _evidence(self, evidence: BankState, history: Sequence[Moment]) -> BankState:
        for moment in history:
            if moment.tick >= evidence.onsets[0]:
                evidence = self._heard(evidence, moment)
        return evidence

    def _judged(self, state: MonitorState, evidence: BankState) -> MonitorState:
        """Name a strut, revise that, settle it, or let the alarm go."""
        now, found = state.history[-1], state.diagnosis
        verdict = self.bank.verdict(evidence, now.tick, now.x)
        state = replace(state, evidence=evidence, verdict=verdict)
        certain = self._certain(verdict)
        since = state.alarm_ticks[-1] if found is None else state.named_tick
        waited_s = (now.tick - since) * self.sound.period_s
        if verdict.sound_confidence >= self.rules.confidence:
            return self._forgetting(state)
        if verdict.misfit < self.rules.misfit and waited_s >= self.rules.look_back_s:
            return replace(self._forgetting(state), unexplained=True)
        if found is None:
            return self._named(state, verdict) if certain else state
        state = self._charted(state, verdict.x)
        if window := self.chart.alarm(state.recent):
            return self._contradicted(state, now.tick - window)
        if certain and waited_s >= self.rules.confirmation_s:
            return replace(state, diagnosis=self._diagnosis(state, verdict, settled=True))
        if certain and self._revises(found.fault, verdict):
            return self._named(state, verdict)
        return state

    def _named(self, state: MonitorState, verdict: Verdict) -> MonitorState:
        diagnosis = self._diagnosis(state, verdict, settled=False)
        now = state.history[-1].tick
        return replace(state, named_tick=now, recent=self.chart.start(), diagnosis=diagnosis)

    def _forgetting(self, state: MonitorState) -> MonitorState:
        """Nothing is suspected any more; the history and the record of alarms stay."""
        return MonitorState(
            state.history,
            self.chart.start(),
            alarm_ticks=state.alarm_ticks,
            unexplained=state.unexplained,
        )

    def _contradicted(self, state: MonitorState, until: int) -> MonitorState:
        """Something else has happened: settle this failure by what came before, or give it up."""
        assert state.evidence is not None and state.diagnosis is not None  # a diagnosis stands
        until = max(until, state.named_tick)
        before = [moment for moment in state.history if moment.tick <= until]
        evidence = self._evidence(self.bank.start(state.evidence.onsets), before)
        verdict = self.bank.verdict(evidence, until, before[-1].x)
        if not self._certain(verdict):
            return replace(self._forgetting(state), unexplained=True)
        return replace(state, diagnosis=self._diagnosis(state, verdict, settled=True))

    def _certain(self, verdict: Verdict) -> bool:
        sure = verdict.strut_confidence >= self.rules.confidence
        return sure and verdict.misfit >= self.rules.misfit

    def _revises(self, before: Fault, verdict: Verdict) -> bool:
        """Whether another strut or kind is certain by now, or a coil weak in another measure."""
        now = verdict.fault
        if now.strut != before.strut:
            return True
        if now.kind == before.kind:
            return abs(now.strength - before.strength) > self.rules.strength_step
        return verdict.kind_confidence >= self.rules.confidence

    def _diagnosis(self, state: MonitorState, verdict: Verdict, settled: bool) -> Diagnosis:
        return Diagnosis(
            fault=verdict.fault,
            strut_confidence=verdict.strut_confidence,
            kind_confidence=verdict.kind_confidence,
            displacement_m=float(self.sound.linear.C_active[verdict.fault.strut] @ verdict.x),
            onset_tick=verdict.onset,
            alarm_tick=state.alarm_ticks[-1],
            tick=state.history[-1].tick,
            settled=settled,
        )

    def _ticks(self, time_s: float) -> int:
        return round(time_s / self.sound.period_s)


def monitor(
    faults: tuple[Fault, ...],
    sound: SoundMachine,
    sensing: Sensing,
    rules: Rules,
) -> Monitor:
    """A monitor for a machine with these known faults."""
    return Monitor(
        faults,
        sound,
        sensing,
        rules,
        bank(sound, faults, sensing.C),
        chart(len(sensing.C), rules.false_alarms_per_hour, sound.period_s),
    )
