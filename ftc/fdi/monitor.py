"""Watch, decide, refine: the diagnosis of one failure after another.

The believed model runs beside the plant; its errors and the spectrum of its residuals are tracked,
and the residuals tested. On an alarm a bank of hypotheses looks back over the history, and goes on
until one actuator is certain, or until it is certain that nothing has failed. Until then nothing
that the controller sees changes. A diagnosis may be revised for a while, before its model becomes
the believed one.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

import argument_checks as check
from argument_checks import Array
from ftc._records import changed
from ftc.fdi.detection.replay import learned, quieter, replayed
from ftc.fdi.detection.residual_test import ResidualTest, residual_test
from ftc.fdi.detection.watch import Calibration, Moment, Watch
from ftc.fdi.diagnosis import DEFAULT_CONFIG, FdiConfig
from ftc.fdi.fault_model import MOST_STEPS, Fault, NominalModel, of_actuators
from ftc.fdi.isolation.bank import HypothesisBank
from ftc.fdi.isolation.hypotheses import believed_model, hypothesis_bank
from ftc.fdi.isolation.look_back import weighed
from ftc.fdi.judge import REVISED_EVERY, Judge, reset
from ftc.fdi.monitor_state import MonitorState

_ONE = np.ones(1)

_MOST_SAMPLES = 10_000
"""Of the history that is kept."""

_JUDGED_EVERY, _SPECTRUM_EVERY = 4, 50
"""In samples: how often hypotheses are judged until one is named, and how often the filter of the
spectrum is made anew."""


@dataclass(frozen=True)
class Monitor:
    """Monitor of a plant with exactly these known faults.

    With a `calibration` it tests from the first sample on, and takes none for sound unseen.
    """

    nominal: NominalModel
    faults: tuple[Fault, ...]
    config: FdiConfig
    ticks: int
    watch: Watch
    test: ResidualTest
    calibration: Calibration | None = None

    def start(self) -> MonitorState:
        """State at rest at the equilibrium."""
        none, _ = np.zeros(self.nominal.actuators), self.bank  # no tick is to wait for the bank
        watch = self.watch.start(self.calibration)
        return MonitorState(0, (), (), none, watch, (), self.test.start())

    def step(self, state: MonitorState, measured: Array | None, commanded: Array) -> MonitorState:
        """One tick.

        Nothing is tested, learned or weighed in a sample without any measurement, nor in the
        `order` ones after it, whose whitening needs it.

        Args:
            state: From the tick before.
            measured: Outputs now, in the units of the model's, shape (p,); None where they are
                missing.
            commanded: Displacements since the tick before, shape (n,).

        Raises:
            ValueError, TypeError: No state, or not finite numbers of these shapes.
        """
        check.instance("state", state, MonitorState)
        commanded, noise = (
            check.exactly("commanded", commanded, self._actuators),
            self.nominal.noise,
        )
        y = None if measured is None else check.exactly("measured", measured, len(noise)) / noise
        ticks = state.ticks + 1
        if not state.outputs:  # the first tick: what was commanded before it does not count
            return changed(state, ticks=ticks, outputs=(y,))
        every = (*state.commanded, commanded)
        if len(every) < self.ticks:
            return changed(state, ticks=ticks, commanded=every, outputs=(*state.outputs, y))
        mean_u = sum(every[1:], every[0]) / self.ticks  # np.mean takes three times as long
        mean_y = _mean(state.outputs, state.history[-2:])
        v = np.concatenate([mean_u, state.last_commanded, _ONE])
        now = {"ticks": ticks, "commanded": (), "outputs": (y,), "last_commanded": mean_u}
        return self._sample(changed(state, **now), v, mean_y)

    @cached_property
    def bank(self) -> HypothesisBank:
        """The hypotheses, made when first needed: after a confirmed failure by the next alarm."""
        return hypothesis_bank(self.nominal, self.faults, self.config.uncertainty, self.ticks)

    @cached_property
    def _actuators(self) -> int:
        return self.nominal.actuators

    def _sample(self, state: MonitorState, v: Array, y: Array | None) -> MonitorState:
        """One sample: inputs v and mean outputs y (p,) of as many ticks, or None."""
        if y is None and state.diagnosis is None:  # what raised the alarm may be the sensor
            state = reset(state)
        suspected, relearns = state.evidence is not None, state.relearns > 0
        how = {"learns": relearns or not suspected, "gated": not relearns}
        watch, moment = self.watch.step(state.watch, v, y, **how)
        learning = self.watch.samples(self.config.learning_s)
        kept = max(self.watch.samples(self.config.look_back_s), learning)
        if state.evidence is not None:  # back to the oldest onset that is looked for
            kept = max(kept, moment.sample - int(state.evidence.onsets[0]))
        history = (*state.history[-kept:], moment)
        known = relearns or watch.spectrum.samples > learning
        if how["learns"] and known and watch.sample % _SPECTRUM_EVERY == 0:
            watch = self.watch.with_spectrum(watch)
        left = max(state.relearns - moment.is_whole, 0)
        state = changed(state, history=history, watch=watch, relearns=left)
        if state.evidence is not None:
            evidence = weighed(self.bank, state.evidence, moment, watch)
            state = changed(state, evidence=evidence)
            every = _JUDGED_EVERY if state.diagnosis is None else REVISED_EVERY
            judges = moment.is_whole and evidence.samples % every == 0
            return self._judge.judged(state) if judges else state
        if not moment.is_whole:
            return state
        if not relearns and watch.spectrum.samples == learning:
            return replace(state, watch=learned(self.watch, watch, history))
        if not relearns and watch.spectrum.samples < learning:
            return state
        state = changed(state, recent=self.test.push(state.recent, watch.residual))
        if self.test.alarm(state.recent):
            alarms, watch = (*state.alarm_ticks, state.ticks - 1), self.watch.doubting(state.watch)
            state = replace(state, alarm_ticks=alarms, watch=watch)
            return self._judge.judged(self._judge.begun(state, self.config.look_back_s))
        return state

    def believing(self, state: MonitorState) -> tuple["Monitor", MonitorState]:
        """The monitor that continues from a confirmed diagnosis, with recomputed history.

        Raises:
            ValueError: The diagnosis of `state` is not confirmed.
        """
        found = state.diagnosis
        if found is None or not found.confirmed:
            raise ValueError(f"state must hold a confirmed diagnosis, got {found}")
        others = [each for each in self.faults if each.actuator != found.fault.actuator]
        known = (*others,) if found.fault.is_sound else (*others, found.fault)
        after = monitor(self.nominal, known, self.config)
        past = [each for each in state.history if each.sample * self.ticks >= found.onset_tick]
        first = past[0] if past else state.history[-1]
        begun = replace(
            state.watch,
            sample=first.sample,
            X=first.X @ after.watch.model.onset.T,
            memory=first.memory,
            parameters=first.parameters,
        )
        inflation = 1.0 if state.verdict is None else state.verdict.inflation
        begun, history, residuals = replayed(after.watch, quieter(begun, inflation), past)
        recent = self.test.start()
        for moment, residual in zip(history, residuals, strict=True):
            if moment.is_whole and moment.sample * self.ticks > state.named_tick:
                recent = self.test.push(recent, residual)
        state = replace(reset(state), watch=begun, history=tuple(history), recent=recent)
        return after, state

    @cached_property
    def _judge(self) -> Judge:
        return Judge(self.nominal, self.config, self.ticks, self.bank, self.watch)


def _mean(outputs: Sequence[Array | None], before: Sequence[Moment]) -> Array | None:
    """Mean (p,) of the outputs of a sample, as if those missing were on the slope before it.

    A mean without them would be that of another time, which a plant that moves shows as an error.
    """
    measured = [each for each in outputs if each is not None]
    if not measured:
        return None
    mean = sum(measured[1:], measured[0]) / len(measured)
    if len(measured) == len(outputs):
        return mean
    known = [tick for tick, each in enumerate(outputs) if each is not None]
    earlier = [each.y for each in before if each.y is not None]
    if len(earlier) < 2:
        return mean
    ticks = len(outputs)
    return mean + (earlier[1] - earlier[0]) / ticks * ((ticks - 1) / 2 - np.mean(known))


def monitor(
    nominal: NominalModel, faults: Sequence[Fault] = (), config: FdiConfig = DEFAULT_CONFIG
) -> Monitor:
    """A monitor for a plant with these known faults.

    Raises:
        ValueError, TypeError: No model, no faults of its actuators, no settings, or samples of more
            than 10,000 ticks, or more than 10,000 samples to look back or to learn.
    """
    check.instance("nominal", nominal, NominalModel)
    faults = of_actuators(faults, nominal.actuators)
    check.instance("config", config, FdiConfig)
    ticks = max(1, round(config.sample_s / nominal.period_s))
    period_s = ticks * nominal.period_s
    longest_s = max(config.look_back_s, config.learning_s)
    if ticks > MOST_STEPS or longest_s > _MOST_SAMPLES * period_s:
        raise ValueError(
            f"config must have samples of at most {MOST_STEPS} ticks, and look back and learn over "
            f"at most {_MOST_SAMPLES} samples, got samples of {config.sample_s:g} s, and "
            f"{longest_s:g} s"
        )
    believed = believed_model(nominal, faults, config.uncertainty, ticks)
    test = residual_test(
        len(nominal.noise), config.false_alarms_per_hour, period_s, config.dither_hz
    )
    weak = [each for each in faults if each.kind == "weak" and 0 < each.effectiveness < 1]
    followed = tuple(weak) if config.uncertainty.gain > 0 else ()
    watch = Watch(believed, config, period_s, test.threshold, followed)
    return Monitor(nominal, tuple(faults), config, ticks, watch, test)
