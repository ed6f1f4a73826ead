"""The events of a flight, as what a :class:`sim.Bench` calls tick by tick."""

from collections.abc import Callable, Sequence
from functools import partial
from math import ceil
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np

import argument_checks as check
from experiments.rig.events import actuator, machine, sensor
from experiments.rig.events.kinds import EVENTS, Event
from experiments.rig.events.target import Effect, Target
from experiments.study.draw import Draw
from sim import Array, Failure, Reading
from sim.plant.bench import hooks_of, measured_by, sent_by

if TYPE_CHECKING:
    from experiments.rig.rig import Rig

_SOON = 1e-6
"""Of a tick: times are rounded."""

EFFECTS: dict[str, Callable[[Target], Effect]] = {
    **dict.fromkeys(("locked", "free", "weak", "loose", "two_locked"), actuator.nothing),
    "spring_lost": actuator.spring_lost,
    "hard_over": partial(actuator.over, part=1.0),
    "half_over": partial(actuator.over, part=0.5),
    "stuck_input": partial(actuator.lagging, time_constant_s=np.inf),
    "offset": partial(actuator.offset, reaches=3.0, reaches_per_s=0.0),
    "drift": partial(actuator.offset, reaches=0.0, reaches_per_s=0.6),
    "intermittent": partial(actuator.without_force, works=lambda s: (s + 1e-9) % 0.3 >= 0.1),
    "fading": partial(actuator.fading, time_constant_s=1.0),
    "reversed": actuator.reversed_input,
    "slow": partial(actuator.lagging, time_constant_s=0.03),
    "strong": partial(actuator.strong, gain=1.3),
    "lock_released": partial(actuator.released, after_s=0.1),
    "free_returns": partial(actuator.without_force, works=lambda s: s >= 0.5),
    "rubbing": partial(actuator.rubbing, part=0.5),
    "damped": partial(actuator.damped, times=10.0),
    "sag": partial(actuator.sag, part=0.8),
    "ripple": partial(actuator.ripple, part=0.2, frequency_hz=100.0),
    "blackout": partial(actuator.without_force, works=lambda s: s >= 0.05, everywhere=True),
    "push": partial(machine.pushed, weights=1 / 54),
    **dict.fromkeys(
        ("bump", "bump_then_lock"), partial(machine.pushed, weights=5 / 54, duration_s=0.005)
    ),
    "tone": partial(machine.tone, frequency_hz=20.0, rms_m_per_s=1e-4),
    "tilt": partial(machine.tilt, rad_per_s=1e-3),
    "heavier": partial(machine.heavier, factor=1.2),
    "lighter": partial(machine.heavier, factor=0.8),
    "bias": partial(sensor.bias, deviations=20.0),
    "scale": partial(sensor.scaled, factor=1.2),
    "stuck": partial(sensor.stuck, everywhere=False),
    "all_stuck": partial(sensor.stuck, everywhere=True),
    "silent": partial(sensor.scaled, factor=0.0),
    "noisy": partial(sensor.noisy, times=5.0),
    "nan": partial(sensor.missing, duration_s=0.0),
    "nan_for_50ms": partial(sensor.missing, duration_s=0.05),
    "dropped": partial(sensor.dropped, part=0.1),
    "repeated": partial(sensor.repeated, part=0.1),
    "spike": partial(sensor.bias, deviations=1e6, samples=1),
    "late": partial(sensor.late, ticks=5),
    "hum": partial(sensor.hum, deviations=5.0, frequency_hz=20.0),
}
"""What each of :data:`experiments.rig.events.EVENTS` does."""


def events_of(
    rig: "Rig", events: object, *, begin_s: float = 0.0, lead_in_s: float = 0.0, seed: int = 0
) -> tuple[object, list[Failure]]:
    """What a bench calls, None for nothing, and the failures that belong to events.

    Args:
        rig: The machine.
        events: A sequence of :class:`Event` and of objects as of :class:`sim.Bench`; or one such
            object alone; None is nothing.
        begin_s: Time of the first tick of the path.
        lead_in_s: How long the loop has been closed by then; what happens at the first tick of the
            path happens at the first of the lead-in, as with failures.
        seed: Of what is drawn: directions, actuators, samples; the same of the first event of a
            name whatever else happens.

    Raises:
        WrongInput: An actuator that the robot does not have, or that cannot have this event.
    """
    if isinstance(events, str | Event):
        raise TypeError(f"events must be a list of events, as {_written(events)}")
    if not isinstance(events, Sequence):
        return events, []
    if texts := [each for each in events if isinstance(each, str)]:
        raise TypeError(f"events must be a list of events, as {_written(texts[0])}")
    named = [each for each in events if isinstance(each, Event)]
    hooks = Hooks([each for each in events if not isinstance(each, Event)])
    failures, lead_in = list[Failure](), round(lead_in_s / rig.period_s)
    for number, event in enumerate(named):
        before = sum(each.name == event.name for each in named[:number])
        effect, caused = effect_of(rig, event, seed, before)
        after = ceil((event.time_s - begin_s) / rig.period_s - _SOON)
        hooks.begin(lead_in + after if after > 0 else 0, effect)
        failures += caused
    return (None if hooks.is_empty else hooks), failures


def _written(event: str | Event) -> str:
    """How an event is given in a list."""
    if isinstance(event, Event):
        return f"[{event}], got it without a list"
    actuator = ', "ACTUATOR"' if EVENTS.get(event, EVENTS["bump"]).of == "actuator" else ""
    name = event if event in EVENTS else "NAME"
    return f'[fjh.Event("{name}", 1.5{actuator})] at 1.5 s, got {check.shown(event)}'


def effect_of(rig: "Rig", event: Event, seed: int, before: int = 0) -> tuple[Effect, list[Failure]]:
    """What an event does after so many of its name, and the failures that belong to it.

    Raises:
        WrongInput: An actuator that the robot does not have, or that cannot have this event.
    """
    draw = Draw(seed).seed(f"{event.name} {before}")
    target = Target(rig, event, np.random.default_rng(draw))
    return EFFECTS[event.name](target), _failures(target)


def _failures(target: Target) -> list[Failure]:
    """That belong to an event: of its actuator, or of drawn ones."""
    kind, time_s = target.event.kind, target.event.time_s + target.event.kind.after_s
    if kind.of == "actuator":
        struck = [target.actuator] * len(kind.failures)
    else:
        drawn = target.rng.permutation(len(target.rig.actuators))[: len(kind.failures)]
        struck = drawn.tolist()
    return [Failure(k, each, time_s) for k, each in zip(struck, kind.failures, strict=True)]


class Hooks:
    """All that happens to a machine: other hooks first, then effects in their order."""

    def __init__(self, others: Sequence[Any] = ()) -> None:
        """Begin with hooks as of :class:`sim.Bench`, without effects.

        Raises:
            TypeError: One has no such function.
        """
        self._others = [hooks_of(other) for other in others]
        self._effects, self._pushes = list[tuple[int, Effect]](), False

    def __getstate__(self) -> dict[str, Any]:
        raise TypeError("events in flight cannot be copied: what they did so far would be shared")

    @property
    def is_empty(self) -> bool:
        """Whether there is nothing of either."""
        return not (self._others or self._effects)

    def begin(self, tick: int, effect: Effect) -> None:
        """An effect from a tick on."""
        self._effects.append((tick, effect))
        self._pushes |= effect.plant is not None

    def end(self, effect: Effect) -> None:
        """It is over; what it has changed of the plant's model stays."""
        self._effects = [each for each in self._effects if each[1] is not effect]

    def plant(self, tick: int, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Before the physics of a tick; forces of several events add up."""
        if self._pushes:
            data.xfrc_applied[:] = 0.0
        for plant, *_ in self._others:
            if plant is not None:
                plant(tick, model, data)
        for since, effect in self._begun(tick):
            if effect.plant is not None:
                effect.plant(since, model, data)

    def measured(self, tick: int, reading: Reading) -> Reading:
        """What the controller reads instead."""
        for _, measured, _ in self._others:
            if measured is not None:
                reading, gap = measured_by(measured, tick, reading)
                if gap is not None:
                    return reading
        for since, effect in self._begun(tick):
            if effect.measured is not None:
                reading = reading._replace(output=effect.measured(since, reading.output))
        return reading

    def sent(self, tick: int, inputs: Array) -> Array:
        """What the drives get instead."""
        for *_, sent in self._others:
            if sent is not None:
                inputs = sent_by(sent, tick, inputs)
        for since, effect in self._begun(tick):
            if effect.sent is not None:
                inputs = effect.sent(since, inputs)
        return inputs

    def _begun(self, tick: int) -> list[tuple[int, Effect]]:
        return [(tick - first, effect) for first, effect in self._effects if tick >= first]
