"""Detection, isolation, confirmation: the diagnosis of one failure after another.

The believed model runs beside the plant, and its residuals are tested. On an alarm a bank of
hypotheses looks back over the history, and goes on until one actuator is certain, or until it is
certain that nothing has failed. A diagnosis may be revised for a while, before its model becomes
the believed one.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from argument_checks import Array
from ftc.fdi.diagnosis import DEFAULT_CONFIG, Diagnosis, FdiConfig, Moment, MonitorState
from ftc.fdi.fault_model import Fault, NominalModel
from ftc.fdi.hypotheses import Evidence, HypothesisBank, Verdict, hypothesis_bank
from ftc.fdi.residual_test import ResidualTest, residual_test


@dataclass(frozen=True)
class Monitor:
    """Monitor of a plant with exactly these known faults."""

    nominal: NominalModel
    faults: tuple[Fault, ...]
    config: FdiConfig
    bank: HypothesisBank
    test: ResidualTest

    def start(self) -> MonitorState:
        """State at rest at the equilibrium."""
        p, s = self.bank.believed.C.shape
        nothing = Moment(-1, np.zeros(s), np.zeros(self.nominal.actuators), np.zeros(p))
        return MonitorState((nothing,), self.test.start())

    def step(self, state: MonitorState, measured: Array, commanded: Array) -> MonitorState:
        """One tick.

        Args:
            state: From the tick before.
            measured: Outputs now, in the units of the model's, shape (p,).
            commanded: Displacements since the tick before, shape (n,).
        """
        last = state.history[-1]
        x = self.bank.believed.step(last.x, commanded)
        now = Moment(last.tick + 1, x, commanded, measured / self.nominal.noise)
        kept = self._ticks(self.config.look_back_s)
        if state.evidence is not None:  # back to the oldest onset that is looked for
            kept = last.tick - int(state.evidence.onsets[0]) + 1
        state = replace(state, history=(*state.history[-kept:], now))
        if state.evidence is not None:
            return self._evaluate(state, self._update(state.evidence, (now,)))
        state = self._with_residual(state, now.y, x)
        if self.test.alarm(state.recent):
            state = replace(state, alarm_ticks=(*state.alarm_ticks, now.tick))
            return self._evaluate(state, self._look_back(state.history))
        return state

    def believing(self, state: MonitorState) -> tuple["Monitor", MonitorState]:
        """The monitor that continues from a confirmed diagnosis, with recomputed history.

        Raises:
            ValueError: The diagnosis of `state` is not confirmed.
        """
        found = state.diagnosis
        if found is None or not found.confirmed:
            raise ValueError(f"state must hold a confirmed diagnosis, got {found}")
        others = (known for known in self.faults if known.actuator != found.fault.actuator)
        after = monitor(self.nominal, (*others, found.fault), self.config)
        model = after.bank.believed
        past = [moment for moment in state.history if moment.tick >= found.onset_tick]
        commanded = np.array([moment.commanded for moment in past])[1:]
        states = model.states(commanded, start=model.onset @ past[0].x)
        begun = self._reset(state)
        for moment, x in zip(past, states, strict=True):
            if moment.tick > state.named_tick:
                begun = after._with_residual(begun, moment.y, x)
        history = (replace(moment, x=x) for moment, x in zip(past, states, strict=True))
        return after, replace(begun, history=tuple(history))

    def _with_residual(self, state: MonitorState, y: Array, x: Array) -> MonitorState:
        """With the residual that outputs y leave if the plant's state is x."""
        residual = y - self.bank.believed.C @ x
        return replace(state, recent=self.test.push(state.recent, residual))

    def _look_back(self, history: tuple[Moment, ...]) -> Evidence:
        """The evidence in the history, for onsets at growing distances before the last moment."""
        now = history[-1].tick
        reach = min(now - history[0].tick, self._ticks(self.config.look_back_s))
        distances, distance = [0], 1
        while distance <= reach:
            distances.append(distance)
            distance = max(distance + 1, round(distance * self.config.onset_growth))
        return self._update(self.bank.start(now - np.array(distances[::-1])), history)

    def _update(self, evidence: Evidence, moments: Sequence[Moment]) -> Evidence:
        for now in moments:
            if now.tick >= evidence.onsets[0]:
                evidence = self.bank.step(evidence, now.tick, now.x, now.commanded, now.y)
        return evidence

    def _evaluate(self, state: MonitorState, evidence: Evidence) -> MonitorState:
        """Name an actuator, revise that, confirm it, or dismiss the alarm."""
        now, found, config = state.history[-1], state.diagnosis, self.config
        verdict = self.bank.verdict(evidence, now.tick, now.x)
        state = replace(state, evidence=evidence, verdict=verdict)
        certain = self._is_certain(verdict)
        since = state.alarm_ticks[-1] if found is None else state.named_tick
        waited_s = (now.tick - since) * self.nominal.period_s
        if verdict.fault_free_confidence >= config.confidence:
            return self._reset(state)
        if verdict.p_value < config.least_p_value and waited_s >= config.look_back_s:
            return replace(self._reset(state), unexplained=True)
        if found is None:
            return self._named(state, verdict) if certain else state
        state = self._with_residual(state, now.y, verdict.x)
        if window := self.test.alarm(state.recent):
            return self._contradicted(state, now.tick - window)
        if certain and waited_s >= config.confirmation_s:
            return replace(state, diagnosis=self._diagnosis(state, verdict, confirmed=True))
        if certain and self._revises(found.fault, verdict):
            return self._named(state, verdict)
        return state

    def _named(self, state: MonitorState, verdict: Verdict) -> MonitorState:
        diagnosis = self._diagnosis(state, verdict, confirmed=False)
        now = state.history[-1].tick
        return replace(state, named_tick=now, recent=self.test.start(), diagnosis=diagnosis)

    def _reset(self, state: MonitorState) -> MonitorState:
        """Nothing is suspected any more; the history and the record of alarms stay."""
        return MonitorState(
            state.history,
            self.test.start(),
            alarm_ticks=state.alarm_ticks,
            unexplained=state.unexplained,
        )

    def _contradicted(self, state: MonitorState, until: int) -> MonitorState:
        """Confirm this failure by the data before a contradiction, or discard it."""
        assert state.evidence is not None and state.diagnosis is not None  # a diagnosis stands
        until = max(until, state.named_tick)
        before = [moment for moment in state.history if moment.tick <= until]
        evidence = self._update(self.bank.start(state.evidence.onsets), before)
        verdict = self.bank.verdict(evidence, until, before[-1].x)
        if not self._is_certain(verdict):
            return replace(self._reset(state), unexplained=True)
        return replace(state, diagnosis=self._diagnosis(state, verdict, confirmed=True))

    def _is_certain(self, verdict: Verdict) -> bool:
        sure = verdict.actuator_confidence >= self.config.confidence
        return sure and verdict.p_value >= self.config.least_p_value

    def _revises(self, before: Fault, verdict: Verdict) -> bool:
        """Whether another actuator or kind is certain by now, or another effectiveness."""
        now, config = verdict.fault, self.config
        if now.actuator != before.actuator:
            return True
        if now.kind == before.kind:
            return abs(now.effectiveness - before.effectiveness) > config.effectiveness_step
        return verdict.kind_confidence >= config.confidence

    def _diagnosis(self, state: MonitorState, verdict: Verdict, confirmed: bool) -> Diagnosis:
        row = self.nominal.displacement[verdict.fault.actuator]
        return Diagnosis(
            fault=verdict.fault,
            actuator_confidence=verdict.actuator_confidence,
            kind_confidence=verdict.kind_confidence,
            displacement=float(row @ verdict.x),
            onset_tick=verdict.onset,
            alarm_tick=state.alarm_ticks[-1],
            tick=state.history[-1].tick,
            confirmed=confirmed,
        )

    def _ticks(self, time_s: float) -> int:
        return round(time_s / self.nominal.period_s)


def monitor(
    nominal: NominalModel, faults: Sequence[Fault] = (), config: FdiConfig = DEFAULT_CONFIG
) -> Monitor:
    """A monitor for a plant with these known faults."""
    return Monitor(
        nominal,
        tuple(faults),
        config,
        hypothesis_bank(nominal, faults),
        residual_test(len(nominal.noise), config.false_alarms_per_hour, nominal.period_s),
    )
