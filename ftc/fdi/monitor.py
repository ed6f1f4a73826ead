"""Monitor: detection, isolation and confirmation of one failure after another.

On an alarm of the observer, a bank of hypotheses processes the history and then new samples until
one actuator, or no failure, is certain. A diagnosis may be revised for a while before its model
becomes the nominal one.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import compress
from typing import Any

import numpy as np
from scipy.special import chdtri

import argument_checks as check
from argument_checks import Array
from argument_checks.records import changed
from argument_checks.ties import ascending
from ftc.fdi.bank import Cause, Evidence, HypothesisBank, base_model_of, hypothesis_bank
from ftc.fdi.decision import (
    CONFIDENCE,
    CONFIRMATION_S,
    LARGEST_INFLATION,
    LARGEST_UNEXPLAINED,
    LOOK_BACK_S,
    RESTART_S,
    WITHDRAWAL_UNEXPLAINED,
    Decision,
    decide,
)
from ftc.fdi.diagnosis import DEFAULT_CONFIG, Diagnosis, FdiConfig
from ftc.fdi.fault_model import KINDS, MOST_STEPS, Fault, NominalModel, of_actuators
from ftc.fdi.observer import LEARNING_S, ORDER, Observer, ObserverState, ResidualTest, Sample

DECISION_PERIOD_S, REVISION_PERIOD_S = 16e-3, 48e-3
"""Time between decisions before and after an actuator is isolated [s]: a decision costs more than a
sample and delays the isolation by so much at most; twenty decisions precede a confirmation."""

SPECTRUM_SAMPLES = 5 * ORDER
"""Samples between updates of the whitening filter. It is a count, because the accuracy of an
autoregression depends on the number of samples for each coefficient."""

ONSET_GROWTH = 1.25
"""Ratio of the distances of successive candidate onsets, at least one sample apart, so that 23 of
them cover a second: the onset of a failure that is detected late need not be sharp."""

_NEGLIGIBLE = 12.0
"""Difference of log likelihood to the best onset above which onsets are dropped at a diagnosis:
five standard deviations; all together are less probable than the confidence leaves open."""


@dataclass(frozen=True)
class MonitorState:
    """State of a monitor: samples, evidence and diagnosis.

    Attributes:
        ticks: Number of ticks so far.
        commanded: Commands (n,) of the ticks of the incomplete sample.
        outputs: Outputs (p,) of these ticks, in units of their noise; None: not measured.
        last_commanded: Mean command of the sample before, shape (n,).
        history: Latest samples, the newest last.
        recent: Latest residuals, for their test.
        evidence: Evidence of the hypotheses since an alarm; None without an alarm.
        alarm_ticks: Ticks of all alarms so far, the present one last.
        decision: Latest decision among the hypotheses.
        isolation_tick: Tick at which an actuator was first isolated.
        diagnosis: Diagnosis of the present failure, from that tick on.
        unexplained: Whether an alarm was ever given up because no single further failure explained
            the outputs; the monitor then continues with the confirmed failures.
        evidence_start_tick: Tick at which the present evidence started.
        cleared: Sample up to which no failure is assumed.
        causes: Causes of the dismissed alarms, in order; None is a slow disturbance.
        relearns: Remaining samples in which the residuals are learned as healthy.
    """

    ticks: int
    commanded: tuple[Array, ...]
    outputs: tuple[Array | None, ...]
    last_commanded: Array
    observer: ObserverState
    history: tuple[Sample, ...]
    recent: Array
    evidence: Evidence | None = None
    alarm_ticks: tuple[int, ...] = ()
    decision: Decision | None = None
    isolation_tick: int = 0
    diagnosis: Diagnosis | None = None
    unexplained: bool = False
    evidence_start_tick: int = 0
    cleared: int = 0
    causes: tuple[Cause | None, ...] = ()
    relearns: int = 0

    def reset(self) -> "MonitorState":
        """Clear evidence and diagnosis, but keep the history and the record of alarms."""
        return replace(
            self,
            recent=np.zeros_like(self.recent),
            evidence=None,
            decision=None,
            isolation_tick=0,
            diagnosis=None,
        )


@dataclass(frozen=True)
class Monitor:
    """Monitor of a plant with known `faults`, for samples of `ticks` ticks.

    With a `calibration`, the observer state of another run, it tests from the first sample on
    instead of learning from the first ones.
    """

    nominal: NominalModel
    faults: tuple[Fault, ...]
    config: FdiConfig
    ticks: int
    observer: Observer
    test: ResidualTest
    calibration: ObserverState | None = None

    def start(self) -> MonitorState:
        """Return the state at rest at the equilibrium."""
        none, _ = np.zeros(self.nominal.actuators), self.bank  # compute the bank now, not in a tick
        observer = self.observer.start(self.calibration)
        return MonitorState(0, (), (), none, observer, (), self.test.start())

    def step(self, state: MonitorState, measured: Array | None, commanded: Array) -> MonitorState:
        """Process one tick: present outputs (p,) or None, and displacements (n,) commanded before.

        A sample without measurement, and later ones whose whitening needs it, are neither tested
        nor learned nor used as evidence.
        """
        check.instance("state", state, MonitorState)
        noise = self.nominal.noise
        commanded = check.array("commanded", commanded, len(self.nominal.displacement))
        y = None if measured is None else check.array("measured", measured, len(noise)) / noise
        ticks = state.ticks + 1
        if not state.outputs:  # the first tick: the command before it is not used
            return changed(state, ticks=ticks, outputs=(y,))
        commands = (*state.commanded, commanded)
        if len(commands) < self.ticks:
            return changed(state, ticks=ticks, commanded=commands, outputs=(*state.outputs, y))
        mean_u = sum(commands[1:], commands[0]) / self.ticks
        mean_y = _mean(state.outputs, state.history[-2:])
        v = np.concatenate([mean_u, state.last_commanded, [1.0]])
        now = {"ticks": ticks, "commanded": (), "outputs": (y,), "last_commanded": mean_u}
        return self._sample(state, now, v, mean_y)

    @cached_property
    def bank(self) -> HypothesisBank:
        """Hypotheses, computed on first use: after a confirmed failure at the next alarm."""
        return hypothesis_bank(self.nominal, self.faults, self.config.uncertainty, self.ticks)

    def _sample(
        self, state: MonitorState, now: dict[str, Any], v: Array, y: Array | None
    ) -> MonitorState:
        """Process one sample: inputs v, mean outputs y (p,) or None, and new state fields `now`."""
        if y is None and state.diagnosis is None:  # the sensor may have caused the alarm
            state = state.reset()
        relearns, learning = state.relearns > 0, self.observer.samples(LEARNING_S)
        learns = relearns or state.evidence is None
        observer, sample = self.observer.step(
            state.observer, v, y, learns=learns, gated=not relearns
        )
        retained = max(self.observer.samples(LOOK_BACK_S), learning)
        if state.evidence is not None:  # back to the oldest candidate onset
            retained = max(retained, sample.number - int(state.evidence.onsets[0]))
        history = (*state.history[-retained:], sample)
        samples = observer.spectrum.samples
        is_due = observer.sample % SPECTRUM_SAMPLES == 0
        if learns and (relearns or samples > learning) and is_due:
            observer = self.observer.with_spectrum(observer)
        now |= {"history": history, "observer": observer}
        now["relearns"] = max(state.relearns - sample.is_complete, 0)
        if state.evidence is not None:
            evidence = self.bank.step(state.evidence, sample, *observer.filters)
            state = changed(state, evidence=evidence, **now)
            interval_s = DECISION_PERIOD_S if state.diagnosis is None else REVISION_PERIOD_S
            interval = self.observer.samples(interval_s)
            decides = sample.is_complete and evidence.samples % max(interval, 1) == 0
            return self._decided(state, evidence) if decides else state
        if not sample.is_complete or (samples < learning and not relearns):
            return changed(state, **now)
        if samples == learning and not relearns:
            now["observer"] = self.observer.learned(observer, history)
            return changed(state, **now)
        recent = np.concatenate([state.recent[1:], observer.residual[None]])
        state = changed(state, recent=recent, **now)
        return self._alarmed(state) if self.test.alarm(recent) else state

    def _alarmed(self, state: MonitorState) -> MonitorState:
        """Return the state after an alarm, with the hypotheses evaluated over the history."""
        alarms = (*state.alarm_ticks, state.ticks - 1)
        started = {"alarm_ticks": alarms, "decision": None, "evidence_start_tick": state.ticks}
        state = replace(state, **started, observer=self.observer.after_alarm(state.observer))
        return self._decided(state, self._looked_back(state, LOOK_BACK_S))

    def _looked_back(self, state: MonitorState, look_back_s: float) -> Evidence:
        """Return the evidence of the history, for onsets up to `look_back_s` back."""
        history, observer = state.history, self.observer
        now = history[-1].number
        longest = min(observer.samples(look_back_s), now - state.cleared, now - history[0].number)
        distances, distance = [0], 1
        while distance <= longest:
            distances.append(distance)
            distance = max(distance + 1, round(distance * ONSET_GROWTH))
        onsets = now - np.array(distances[::-1])
        past = [sample for sample in history if sample.number >= onsets[0]]
        first, p = past[0].before, len(self.nominal.noise)
        prior = first.parameters.spread(observer.drift(LOOK_BACK_S))
        memory = first.memory.copy()
        memory[:, 0] -= np.einsum("j,qjp->qp", prior.mean[:-p], memory[:, 1:]) + prior.mean[-p:]
        evidence = self.bank.start(onsets, prior, first.X, memory)
        filters = state.observer.filters
        for sample in past:  # in place: the arrays are local
            evidence = self.bank.step(evidence, sample, *filters, copy=False)
        return evidence

    def _decided(self, state: MonitorState, evidence: Evidence) -> MonitorState:
        """Isolate an actuator, revise or confirm the diagnosis, or dismiss the alarm."""
        diagnosis, previous = state.diagnosis, state.decision
        # Once a failure is isolated, its own residuals could pass for a slow disturbance.
        now = decide(self.bank, evidence, state.history[-1].number, disturbed=diagnosis is None)
        state = replace(state, evidence=evidence, decision=now)
        # A diagnosis is withdrawn only for a better explanation.
        better = diagnosis is None or now.inflation <= LARGEST_INFLATION
        if now.fault_free_confidence >= CONFIDENCE and better:
            return self._dismissed(state, now)
        if diagnosis is None:
            return self._looked_into(state, now)
        if previous is not None and self._has_new_change(previous, now):
            # An intermittent failure: the actuator did not work for the time of a confirmation.
            if diagnosis.fault.is_healthy:
                return self._dismissed(state, now)
            # The new event must not count as noise of the diagnosed machine.
            diagnosis = replace(diagnosis, confirmed=True, tick=state.ticks - 1)
            now = replace(now, inflation=previous.inflation)
            return replace(state, decision=now, diagnosis=diagnosis)
        waited_s = (state.ticks - state.isolation_tick) * self.nominal.period_s
        if not now.fits or now.unexplained > WITHDRAWAL_UNEXPLAINED:
            return self._given_up(state)
        if now.actuator_confidence < CONFIDENCE:
            return self._given_up(state) if waited_s >= 2 * CONFIRMATION_S else state
        if waited_s >= CONFIRMATION_S:
            return replace(state, diagnosis=replace(self._diagnosis(state, now), confirmed=True))
        return self._isolated(state, evidence, now) if now.revises(diagnosis.fault) else state

    def _looked_into(self, state: MonitorState, now: Decision) -> MonitorState:
        """Isolate an actuator for the first time, restart the evidence, or give up."""
        starts = state.alarm_ticks[-1], state.evidence_start_tick
        waited_s, seen_s = ((state.ticks - tick) * self.nominal.period_s for tick in starts)
        explained = now.fits and now.unexplained <= LARGEST_UNEXPLAINED
        # Within less than a period of the dither, with an inexact model, a locking actuator can
        # resemble another one that weakens.
        least_s = 1 / self.config.dither_hz if self.config.dither_hz else 0.0
        certain = now.actuator_confidence >= CONFIDENCE and seen_s >= least_s
        if explained and certain and (evidence := state.evidence) is not None:
            state = replace(state, isolation_tick=state.ticks - 1)
            return self._isolated(state, evidence, now)
        if waited_s >= LOOK_BACK_S:
            return self._given_up(state)
        if now.fits or seen_s < RESTART_S:
            return state
        evidence = self._looked_back(state, RESTART_S / 2)
        return replace(state, evidence=evidence, decision=None, evidence_start_tick=state.ticks)

    def _isolated(self, state: MonitorState, evidence: Evidence, now: Decision) -> MonitorState:
        """Diagnose the most likely fault, and drop negligible onsets."""
        evidence = evidence.only(now.best >= now.best.max() - _NEGLIGIBLE)
        return replace(state, evidence=evidence, diagnosis=self._diagnosis(state, now))

    def _dismissed(self, state: MonitorState, now: Decision) -> MonitorState:
        observer = self.observer.with_larger_offsets(state.observer)
        cleared, causes = state.history[-1].number, (*state.causes, now.cause)
        return replace(state.reset(), observer=observer, cleared=cleared, causes=causes)

    def _given_up(self, state: MonitorState) -> MonitorState:
        """Give up the alarm, and learn the unexplained residuals."""
        return replace(
            state.reset(),
            unexplained=True,
            cleared=state.history[-1].number,
            relearns=self.observer.samples(LEARNING_S),
            observer=self.observer.relearning(state.observer),
        )

    def _has_new_change(self, previous: Decision, now: Decision) -> bool:
        """Return whether another event occurred between two decisions, at the false-alarm rate.

        The test is whether the residual energy since then exceeds that of the previous noise.
        """
        samples = max(self.observer.samples(REVISION_PERIOD_S), 1)
        hours = samples * self.observer.period_s / 3600
        freedom = samples * len(self.nominal.noise)
        limit = chdtri(freedom, self.config.false_alarms_per_hour * hours) * previous.inflation
        return bool(now.energy - previous.energy > limit)

    def _diagnosis(self, state: MonitorState, now: Decision) -> Diagnosis:
        """Return the unconfirmed diagnosis for a decision."""
        likely = now.kind_confidences
        order = ascending(-np.array(likely))
        return Diagnosis(
            fault=now.fault,
            kinds=tuple(KINDS[k] for k in order if likely[k] > 1 - CONFIDENCE),
            actuator_confidence=now.actuator_confidence,
            kind_confidence=likely[KINDS.index(now.fault.kind)],
            displacement=float(self.nominal.displacement[now.fault.actuator] @ now.x),
            onset_tick=now.onset * self.ticks,
            alarm_tick=state.alarm_ticks[-1],
            tick=state.ticks - 1,
            confirmed=False,
        )

    def with_diagnosis(self, state: MonitorState) -> tuple["Monitor", MonitorState]:
        """Return the monitor with the confirmed diagnosis, and its state, history recomputed."""
        diagnosis = state.diagnosis
        if diagnosis is None or not diagnosis.confirmed:
            got = "none" if diagnosis is None else "an unconfirmed one"
            raise ValueError(f"state must hold a confirmed diagnosis, got {got}")
        others = [item for item in self.faults if item.actuator != diagnosis.fault.actuator]
        faults = others if diagnosis.fault.is_healthy else [*others, diagnosis.fault]
        after = monitor(self.nominal, faults, self.config)
        past = [item for item in state.history if item.number * self.ticks >= diagnosis.onset_tick]
        first = (past or state.history[-1:])[0].before
        # The residuals of a failed plant have a larger variance.
        inflation = 1.0 if state.decision is None else state.decision.inflation
        former, spectrum = state.observer, state.observer.spectrum
        started = replace(
            former,
            sample=first.sample,
            X=first.X @ after.observer.model.onset.T,
            memory=first.memory,
            parameters=first.parameters,
            spectrum=spectrum._replace(covariance=inflation * spectrum.covariance),
            whitening=former.whitening / np.sqrt(inflation),
            decoupled=former.decoupled / np.sqrt(inflation),
        )
        observer, history, residuals = after.observer.replayed(started, past)
        since = state.isolation_tick
        later = [item.is_complete and item.number * self.ticks > since for item in history]
        recent = self.test.start()
        recent = np.vstack([recent, *compress(residuals, later)])[-len(recent) :]
        return after, replace(
            state.reset(), observer=observer, history=tuple(history), recent=recent
        )


def _mean(outputs: Sequence[Array | None], before: Sequence[Sample]) -> Array | None:
    """Return the mean (p,) of the outputs of a sample, with missing ones extrapolated linearly.

    Their omission would shift the time of the mean, an error if the plant moves.
    """
    measured = [item for item in outputs if item is not None]
    if not measured:
        return None
    mean, ticks = sum(measured[1:], measured[0]) / len(measured), len(outputs)
    if len(measured) == ticks:
        return mean
    earlier = [item.y for item in before if item.y is not None]
    if len(earlier) < 2:
        return mean
    measured_ticks = [tick for tick, item in enumerate(outputs) if item is not None]
    return mean + (earlier[1] - earlier[0]) / ticks * ((ticks - 1) / 2 - np.mean(measured_ticks))


def monitor(
    nominal: NominalModel, faults: Sequence[Fault] = (), config: FdiConfig = DEFAULT_CONFIG
) -> Monitor:
    """Make a monitor for a plant with known faults.

    Raises:
        ValueError: An argument is invalid, or a sample has more than 10,000 ticks.
    """
    check.instance("nominal", nominal, NominalModel)
    faults = of_actuators(faults, nominal.actuators)
    check.instance("config", config, FdiConfig)
    ticks = max(1, round(config.sample_s / nominal.period_s))
    period_s = ticks * nominal.period_s
    if ticks > MOST_STEPS:
        raise ValueError(
            f"config must have samples of at most {MOST_STEPS} ticks of {nominal.period_s:g} s, "
            f"got {config.sample_s:g} s"
        )
    base = base_model_of(nominal, faults, config.uncertainty, ticks)
    test = ResidualTest(
        len(nominal.noise), config.false_alarms_per_hour, period_s, config.dither_hz
    )
    weak = [fault for fault in faults if fault.kind == "weak" and 0 < fault.effectiveness < 1]
    followed = tuple(weak) if config.uncertainty.gain > 0 else ()
    observer = Observer(base, config, period_s, test.threshold, followed)
    return Monitor(nominal, tuple(faults), config, ticks, observer, test)
