"""The events of a run, as what a :class:`sim.Bench` calls tick by tick."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, Literal

import mujoco
import numpy as np

import argument_checks as check
from fjh.rig.draw import Draw
from fjh.rig.events.effects import EVENTS, Effect, Event
from fjh.rig.run import tick_of
from fjh.study.errors import WrongInput
from sim import Array, Failure
from sim.mjcf import Drive, drives
from sim.plant import Reading, hooks_of, lock_of, measured_by, sent_by, switch_off

if TYPE_CHECKING:
    from fjh.rig.rig import Rig


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
        seed: Of random directions, actuators and samples; the same of the first event of a name
            whatever else happens.

    Raises:
        TypeError: An event without a list, its name alone, or an object without such functions.
        WrongInput: An actuator that the robot does not have, or that cannot have this event.
    """
    listed = [events] if isinstance(events, str | Event) else events
    if not isinstance(listed, Sequence):
        return events, []
    for each in listed:
        if isinstance(each, str) or listed is not events:
            raise TypeError(f"events must be a list of events, as {_written(each)}")
    hooks = Hooks([each for each in listed if not isinstance(each, Event)])
    failures, lead_in, names = list[Failure](), round(lead_in_s / rig.period_s), list[str]()
    for event in (each for each in listed if isinstance(each, Event)):
        effect, caused = effect_of(rig, event, seed, names.count(event.name))
        after = tick_of(event.time_s - begin_s, rig.period_s)
        hooks.begin(lead_in + after if after > 0 else 0, effect)
        failures += caused
        names.append(event.name)
    return (None if hooks.is_empty else hooks), failures


def _written(event: str | Event) -> str:
    """How an event is given in a list."""
    if isinstance(event, Event):
        return f"[{event}], got it without a list"
    actuator = ', "ACTUATOR"' if EVENTS.get(event, EVENTS["bump"]).of == "actuator" else ""
    name = event if event in EVENTS else "NAME"
    return f'[fjh.Event("{name}", 1.5{actuator})] at 1.5 s, got {check.short_repr(event)}'


def effect_of(rig: "Rig", event: Event, seed: int, before: int = 0) -> tuple[Effect, list[Failure]]:
    """What an event does after so many of its name, and the failures that belong to it.

    Raises:
        WrongInput: An actuator that the robot does not have, or that cannot have this event.
    """
    rng = np.random.default_rng(Draw(seed).seed(f"{event.name} {before}"))
    target, kind = Target(rig, event, rng), event.kind
    effect = kind.effect(target)
    if kind.of == "actuator":
        struck = [target.actuator] * len(kind.failures)
    else:
        struck = rng.permutation(len(rig.actuators))[: len(kind.failures)].tolist()
    time_s = event.time_s + kind.after_s
    return effect, [Failure(k, each, time_s) for k, each in zip(struck, kind.failures, strict=True)]


class Hooks:
    """Everything that happens to a machine: hooks of others first, then effects in their order."""

    def __init__(self, others: Iterable[object] = ()) -> None:
        """Begin with hooks as of :class:`sim.Bench`, without effects.

        Raises:
            TypeError: One has no such function.
        """
        self._effects, self._readers, self._pushes = list[tuple[int, Effect]](), list[Any](), False
        for plant, measured, sent in map(hooks_of, others):
            self._effects.append((0, Effect(plant, sent=sent and partial(sent_by, sent))))
            self._readers += [measured] if measured else []

    def __getstate__(self) -> dict[str, Any]:
        raise TypeError("events in a run cannot be copied: what they did so far would be shared")

    @property
    def is_empty(self) -> bool:
        """Whether there is nothing of either."""
        return not self._effects

    def begin(self, tick: int, effect: Effect) -> None:
        """Add an effect from a tick on."""
        self._effects.append((tick, effect))
        self._pushes |= effect.plant is not None

    def end(self, effect: Effect) -> None:
        """Remove an effect; what it has changed of the plant's model stays."""
        self._effects = [each for each in self._effects if each[1] is not effect]

    def plant(self, tick: int, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Act on the plant before the physics of a tick; forces of several events add up."""
        if self._pushes:
            data.xfrc_applied[:] = 0.0
        for since, change in self._begun("plant", tick):
            change(since, model, data)

    def measured(self, tick: int, reading: Reading) -> Reading:
        """What the controller reads instead."""
        for reader in self._readers:
            reading, gap = measured_by(reader, tick, reading)
            if gap is not None:
                return reading
        for since, change in self._begun("measured", tick):
            reading = reading._replace(output=change(since, reading.output))
        return reading

    def sent(self, tick: int, inputs: Array) -> Array:
        """What the drives get instead."""
        for since, change in self._begun("sent", tick):
            inputs = change(since, inputs)
        return inputs

    def _begun(self, hook: str, tick: int) -> list[tuple[int, Any]]:
        """Ticks since each effect with this hook began, and the hook."""
        found = [(tick - first, getattr(each, hook)) for first, each in self._effects]
        return [(since, change) for since, change in found if since >= 0 and change is not None]


@dataclass(frozen=True)
class Target:
    """Machine that an event acts on, and the generator of the event's random numbers."""

    rig: "Rig"
    event: Event
    rng: np.random.Generator

    switch_off = staticmethod(switch_off)

    @cached_property
    def actuator(self) -> int:
        """Number of the event's own actuator."""
        assert self.event.actuator is not None  # of an actuator, so it has one
        return self.rig.number(self.event.actuator)

    @cached_property
    def drives(self) -> tuple[Drive, ...]:
        """Drives of all actuators; their ids are those of the plant's model, too."""
        part = self.rig.part
        return drives(self.rig.model, among=None if part is None else part.actuators)

    @property
    def drive(self) -> Drive:
        """Drive of the event's own actuator."""
        return self.drives[self.actuator]

    @property
    def lock(self) -> int:
        """Id of the equality that locks the event's own actuator; negative: it has none."""
        return lock_of(self.rig.model, self.drive)

    @cached_property
    def reach(self) -> float:
        """Largest displacement of any actuator on the path, [m] or [rad]."""
        gain = self.rig.mapping(self.rig.goal).major_gain()
        return self.rig.size * float(np.abs(gain).max())

    @property
    def limits(self) -> tuple[float, float]:
        """Lowest and highest displacement of the event's own actuator; infinite without limits."""
        low, high = self.rig.task.limits
        return float(low[self.actuator]), float(high[self.actuator])

    def input(self, displacement: float) -> float:
        """Input of the event's own actuator that a displacement takes."""
        everywhere = np.full(len(self.drives), displacement)
        return float(self.rig.task.drives.inputs(everywhere)[self.actuator])

    def ticks(self, duration_s: float) -> float:
        """Nearest number of ticks, one at least; infinite as the duration."""
        ticks = duration_s / self.rig.period_s
        return max(1, round(ticks)) if math.isfinite(ticks) else ticks

    def direction(self, axes: int) -> Array:
        """Random unit vector, (axes,)."""
        normal = self.rng.standard_normal(axes)
        return normal / np.linalg.norm(normal)

    def moved(
        self, what: Literal["stiffness", "damping", "frictionloss"]
    ) -> Callable[[mujoco.MjModel], Array]:
        """View (1,) in a model of a property of what the event's own actuator moves.

        Raises:
            WrongInput: It moves neither a joint nor a tendon.
        """
        joint, k, name = self.drive.joint, self.drive.tendon, f"tendon_{what}"
        if joint is not None and what == "stiffness":
            k, name = joint, "jnt_stiffness"
        elif joint is not None:
            k, name = int(self.rig.model.jnt_dofadr[joint]), f"dof_{what}"
        if k is None:
            raise self.refused("moves neither a joint nor a tendon")
        return lambda model: getattr(model, name)[k : k + 1]

    def refused(self, why: str) -> WrongInput:
        """Error: the machine cannot have the event."""
        return WrongInput(f"{self.event.name}: {self.rig.actuators[self.actuator]} {why}")
