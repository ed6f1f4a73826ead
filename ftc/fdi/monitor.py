"""Monitor: the diagnosis of one failure after another.

On an alarm of the observer a bank of hypotheses looks back over the history, and goes on until one
actuator is certain, or that nothing has failed. A diagnosis may be revised for a while, before its
model becomes the nominal one.
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
from ftc.fdi.observer import (
    LEARNING_S,
    ORDER,
    Observer,
    ObserverState,
    ResidualTest,
    Sample,
)

DECISION_PERIOD_S, REVISION_PERIOD_S = 16e-3, 48e-3
"""How often hypotheses are judged until one is named, and once one is: a verdict costs more than a
sample, and a name is later by so much at most; it is judged twenty times before it is confirmed."""

SPECTRUM_SAMPLES = 5 * ORDER
"""How often the filter of the spectrum is made anew. A count, as the accuracy of an autoregression
is one of samples for each coefficient: earlier it is as inaccurate as it was."""

ONSET_GROWTH = 1.25
"""Onsets are so much further back from one to the next, or a sample, so that 23 of them cover a
second: what fails slowly enough to be found late need not be dated sharply."""

_NEGLIGIBLE = 12.0
"""Onsets whose likelihood is e^12 times smaller than the best one's, as five standard deviations
are, are dropped at a diagnosis: all together they are less than the confidence leaves open."""


@dataclass(frozen=True)
class MonitorState:
    """State of a monitor: what it has seen, what it suspects, and what it has named.

    Attributes:
        commanded: Displacements of the ticks of the sample that is not complete, (n,) each.
        outputs: Of these ticks, in units of their noise, (p,) each; None: nothing was measured.
        last_commanded: Mean of the sample before, shape (n,).
        history: The latest samples, the newest last.
        recent: Latest residuals, for their test.
        evidence: Of the hypotheses, from an alarm on.
        alarm_ticks: Of all alarms so far, the last of them the one that is looked into.
        named_tick: When an actuator was first named.
        diagnosis: Of the present failure, from then on.
        unexplained: Whether an alarm was given up once: no single failure after another explained
            the outputs. The monitor goes on with what was confirmed before.
        begun_tick: When the present evidence began.
        cleared: Sample up to which nothing had failed, or nothing that was understood.
        causes: What explained the alarms that were dismissed, in order; None is something slow.
        relearns: For so many more samples what is seen is taken for the machine as it is.
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
        """Suspect nothing any more; the history and the record of alarms stay."""
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
    """Monitor of a plant with exactly these known faults, in samples of so many ticks.

    With a `calibration`, the state of another run's observer, it tests from the first sample on,
    and takes none for healthy unseen.
    """

    nominal: NominalModel
    faults: tuple[Fault, ...]
    config: FdiConfig
    ticks: int
    observer: Observer
    test: ResidualTest
    calibration: ObserverState | None = None

    def start(self) -> MonitorState:
        """State at rest at the equilibrium."""
        none, _ = np.zeros(self.nominal.actuators), self.bank  # no tick is to wait for the bank
        observer = self.observer.start(self.calibration)
        return MonitorState(0, (), (), none, observer, (), self.test.start())

    def step(self, state: MonitorState, measured: Array | None, commanded: Array) -> MonitorState:
        """Take one tick: outputs (p,) now, or None, and displacements (n,) commanded before it.

        Nothing is tested, learned or weighed in a sample without any measurement, nor in those
        after it whose whitening needs it.
        """
        check.instance("state", state, MonitorState)
        noise = self.nominal.noise
        commanded = check.array("commanded", commanded, len(self.nominal.displacement))
        y = None if measured is None else check.array("measured", measured, len(noise)) / noise
        ticks = state.ticks + 1
        if not state.outputs:  # the first tick: what was commanded before it does not count
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
        """The hypotheses, made when first needed: after a confirmed failure by the next alarm."""
        return hypothesis_bank(self.nominal, self.faults, self.config.uncertainty, self.ticks)

    def _sample(
        self, state: MonitorState, now: dict[str, Any], v: Array, y: Array | None
    ) -> MonitorState:
        """Take one sample: inputs v and mean outputs y (p,), or None; `now` is new of the state."""
        if y is None and state.diagnosis is None:  # what raised the alarm may be the sensor
            state = state.reset()
        relearns, learning = state.relearns > 0, self.observer.samples(LEARNING_S)
        learns = relearns or state.evidence is None
        observer, sample = self.observer.step(
            state.observer, v, y, learns=learns, gated=not relearns
        )
        retained = max(self.observer.samples(LOOK_BACK_S), learning)
        if state.evidence is not None:  # back to the oldest onset that is looked for
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
        """Raise an alarm, and look back for what it comes from."""
        alarms = (*state.alarm_ticks, state.ticks - 1)
        started = {"alarm_ticks": alarms, "decision": None, "evidence_start_tick": state.ticks}
        state = replace(state, **started, observer=self.observer.after_alarm(state.observer))
        return self._decided(state, self._looked_back(state, LOOK_BACK_S))

    def _looked_back(self, state: MonitorState, look_back_s: float) -> Evidence:
        """The evidence in the history, for onsets at growing distances up to so far back."""
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
        for sample in past:  # of arrays that nobody else has
            evidence = self.bank.step(evidence, sample, *filters, copy=False)
        return evidence

    def _decided(self, state: MonitorState, evidence: Evidence) -> MonitorState:
        """Name an actuator, revise that, confirm it, or dismiss the alarm, by this evidence."""
        diagnosis, previous = state.diagnosis, state.decision
        # Once a failure is named, what shakes the failed machine is slow disturbance enough.
        now = decide(self.bank, evidence, state.history[-1].number, disturbed=diagnosis is None)
        state = replace(state, evidence=evidence, decision=now)
        # What a name is withdrawn for must explain better than it does.
        better = diagnosis is None or now.inflation <= LARGEST_INFLATION
        if now.fault_free_confidence >= CONFIDENCE and better:
            return self._dismissed(state, now)
        if diagnosis is None:
            return self._looked_into(state, now)
        if previous is not None and self._has_new_change(previous, now):
            # One that comes and goes has not been healthy for the time that a confirmation takes.
            if diagnosis.fault.is_healthy:
                return self._dismissed(state, now)
            # What has happened since is not noise of the machine that has been confirmed.
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
        """Name an actuator for the first time, begin anew, or give up."""
        waited_s, seen_s = (
            (state.ticks - tick) * self.nominal.period_s
            for tick in (state.alarm_ticks[-1], state.evidence_start_tick)
        )
        explained = now.fits and now.unexplained <= LARGEST_UNEXPLAINED
        # In less than a period of the dither an actuator that locks can look like another one that
        # weakens, on a plant whose errors the nominal model does not have.
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
        """Name what the verdict says, without onsets that hardly matter any more."""
        evidence = evidence.only(now.best >= now.best.max() - _NEGLIGIBLE)
        return replace(state, evidence=evidence, diagnosis=self._diagnosis(state, now))

    def _dismissed(self, state: MonitorState, now: Decision) -> MonitorState:
        observer, cleared = (
            self.observer.with_larger_offsets(state.observer),
            state.history[-1].number,
        )
        causes = (*state.causes, now.cause)
        return replace(state.reset(), observer=observer, cleared=cleared, causes=causes)

    def _given_up(self, state: MonitorState) -> MonitorState:
        """Nothing explains the residuals: learn what they are like."""
        return replace(
            state.reset(),
            unexplained=True,
            cleared=state.history[-1].number,
            relearns=self.observer.samples(LEARNING_S),
            observer=self.observer.relearning(state.observer),
        )

    def _has_new_change(self, previous: Decision, now: Decision) -> bool:
        """Whether something else has happened between two verdicts, at the rate of false alarms.

        It has if what was measured meanwhile has more energy than noise as before has.
        """
        samples = max(self.observer.samples(REVISION_PERIOD_S), 1)
        hours = samples * self.observer.period_s / 3600
        freedom = samples * len(self.nominal.noise)
        limit = chdtri(freedom, self.config.false_alarms_per_hour * hours) * previous.inflation
        return bool(now.energy - previous.energy > limit)

    def _diagnosis(self, state: MonitorState, now: Decision) -> Diagnosis:
        """The diagnosis by a verdict, not confirmed."""
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
        """The monitor that continues from a confirmed diagnosis, with recomputed history."""
        diagnosis = state.diagnosis
        if diagnosis is None or not diagnosis.confirmed:
            raise ValueError(f"state must hold a confirmed diagnosis, got {diagnosis}")
        others = [item for item in self.faults if item.actuator != diagnosis.fault.actuator]
        faults = others if diagnosis.fault.is_healthy else [*others, diagnosis.fault]
        after = monitor(self.nominal, faults, self.config)
        past = [item for item in state.history if item.number * self.ticks >= diagnosis.onset_tick]
        first = (past or state.history[-1:])[0].before
        # The residuals of a failed plant have more variance.
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
        later = [
            item.is_complete and item.number * self.ticks > state.isolation_tick for item in history
        ]
        recent = self.test.start()
        recent = np.vstack([recent, *compress(residuals, later)])[-len(recent) :]
        return after, replace(
            state.reset(), observer=observer, history=tuple(history), recent=recent
        )


def _mean(outputs: Sequence[Array | None], before: Sequence[Sample]) -> Array | None:
    """Mean (p,) of the outputs of a sample, as if those missing were on the slope before it.

    A mean without them would be that of another time, which a plant that moves shows as an error.
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
    """Make a monitor for a plant with these known faults.

    Raises:
        ValueError: Besides, a sample has more than 10,000 ticks.
    """
    check.instance("nominal", nominal, NominalModel)
    faults = of_actuators(faults, nominal.actuators)
    check.instance("config", config, FdiConfig)
    ticks = max(1, round(config.sample_s / nominal.period_s))
    period_s = ticks * nominal.period_s
    if ticks > MOST_STEPS:
        raise ValueError(
            f"config must have samples of at most {MOST_STEPS} ticks, got {config.sample_s:g} s"
        )
    base = base_model_of(nominal, faults, config.uncertainty, ticks)
    test = ResidualTest(
        len(nominal.noise), config.false_alarms_per_hour, period_s, config.dither_hz
    )
    weak = [fault for fault in faults if fault.kind == "weak" and 0 < fault.effectiveness < 1]
    followed = tuple(weak) if config.uncertainty.gain > 0 else ()
    observer = Observer(base, config, period_s, test.threshold, followed)
    return Monitor(nominal, tuple(faults), config, ticks, observer, test)
