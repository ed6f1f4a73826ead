"""Conversion of a run's events to hooks of a :class:`sim.Bench`."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, Literal

import mujoco
import numpy as np

import argument_checks as check
from fjh.rig.events.effects import EVENTS, Effect, Event
from fjh.rig.random_streams import RandomStreams
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
    """Return the hooks of a bench for events (None without any), and the failures that these cause.

    Args:
        rig: The machine.
        events: List of :class:`Event` and of objects with hooks as for :class:`sim.Bench`, or one
            such object; None: no events.
        begin_s: Time of the first tick of the path [s].
        lead_in_s: Duration [s] of the control before the path; events (and failures) at the first
            tick of the path occur at the first tick of this lead-in.
        seed: Seed of random directions, actuators and samples; an event's random numbers do not
            depend on events of other names.

    Raises:
        TypeError: An event is not in a list or only its name is given, or an object has no hooks.
        WrongInput: An actuator that the robot does not have, or to which the event does not apply.
    """
    listed = [events] if isinstance(events, str | Event) else events
    if not isinstance(listed, Sequence):
        return events, []
    for event in listed:
        if isinstance(event, str) or listed is not events:
            raise TypeError(f"events must be a list of events, as {_written(event)}")
    hooks = Hooks([event for event in listed if not isinstance(event, Event)])
    failures, lead_in, names = list[Failure](), round(lead_in_s / rig.period_s), list[str]()
    for event in (event for event in listed if isinstance(event, Event)):
        effect, caused = effect_of(rig, event, seed, names.count(event.name))
        after = tick_of(event.time_s - begin_s, rig.period_s)
        hooks.start(lead_in + after if after > 0 else 0, effect)
        failures += caused
        names.append(event.name)
    return (None if hooks.is_empty else hooks), failures


def _written(event: str | Event) -> str:
    """Return an example of how an event is written in a list."""
    if isinstance(event, Event):
        return f"[{event}], got it without a list"
    actuator = ', "ACTUATOR"' if EVENTS.get(event, EVENTS["bump"]).of == "actuator" else ""
    name = event if event in EVENTS else "NAME"
    return f'[fjh.Event("{name}", 1.5{actuator})] at 1.5 s, got {check.short_repr(event)}'


def effect_of(rig: "Rig", event: Event, seed: int, before: int = 0) -> tuple[Effect, list[Failure]]:
    """Return the effect of an event after `before` others of its name, and the failures it causes.

    Raises:
        WrongInput: An actuator that the robot does not have, or to which the event does not apply.
    """
    rng = np.random.default_rng(RandomStreams(seed).seed(f"{event.name} {before}"))
    target, kind = Target(rig, event, rng), event.kind
    effect = kind.effect(target)
    if kind.of == "actuator":
        failing = [target.actuator] * len(kind.failures)
    else:
        failing = rng.permutation(len(rig.actuators))[: len(kind.failures)].tolist()
    time_s = event.time_s + kind.after_s
    failures = [Failure(k, mode, time_s) for k, mode in zip(failing, kind.failures, strict=True)]
    return effect, failures


class Hooks:
    """Hooks of all events of a machine: those of user objects first, then effects by start."""

    def __init__(self, others: Iterable[object] = ()) -> None:
        """Take objects with hooks as for :class:`sim.Bench`; :meth:`start` adds effects.

        Raises:
            TypeError: An object has no hooks.
        """
        self._effects, self._readers, self._pushes = list[tuple[int, Effect]](), list[Any](), False
        for plant, measured, sent in map(hooks_of, others):
            self._effects.append((0, Effect(plant, sent=sent and partial(sent_by, sent))))
            self._readers += [measured] if measured else []

    def __getstate__(self) -> dict[str, Any]:
        raise TypeError("events in a run cannot be copied: the copies would share their state")

    @property
    def is_empty(self) -> bool:
        """True if there are no hooks and no effects."""
        return not self._effects

    def start(self, tick: int, effect: Effect) -> None:
        """Add an effect that starts at a tick."""
        self._effects.append((tick, effect))
        self._pushes |= effect.plant is not None

    def end(self, effect: Effect) -> None:
        """Remove an effect; its changes of the plant's model remain."""
        self._effects = [item for item in self._effects if item[1] is not effect]

    def plant(self, tick: int, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Change the plant before the physics of a tick; forces of several events are added."""
        if self._pushes:
            data.xfrc_applied[:] = 0.0
        for since, change in self._started("plant", tick):
            change(since, model, data)

    def measured(self, tick: int, reading: Reading) -> Reading:
        """Return the reading that the controller receives."""
        for reader in self._readers:
            reading, gap = measured_by(reader, tick, reading)
            if gap is not None:
                return reading
        for since, change in self._started("measured", tick):
            reading = reading._replace(output=change(since, reading.output))
        return reading

    def sent(self, tick: int, inputs: Array) -> Array:
        """Return the inputs that the drives receive."""
        for since, change in self._started("sent", tick):
            inputs = change(since, inputs)
        return inputs

    def _started(self, hook: str, tick: int) -> list[tuple[int, Any]]:
        """Return this hook of each started effect, with the number of ticks since its start."""
        started = [(tick - first, getattr(effect, hook)) for first, effect in self._effects]
        return [(since, change) for since, change in started if since >= 0 and change is not None]


@dataclass(frozen=True)
class Target:
    """Machine and actuator on which an event acts, with the event's random generator."""

    rig: "Rig"
    event: Event
    rng: np.random.Generator

    switch_off = staticmethod(switch_off)

    @cached_property
    def actuator(self) -> int:
        """Number of the event's own actuator."""
        assert self.event.actuator is not None  # checked by Event
        return self.rig.number(self.event.actuator)

    @cached_property
    def drives(self) -> tuple[Drive, ...]:
        """Drives of all actuators; their ids are valid for the plant's model as well."""
        part = self.rig.part
        return drives(self.rig.model, among=None if part is None else part.actuators)

    @property
    def drive(self) -> Drive:
        """Drive of the event's own actuator."""
        return self.drives[self.actuator]

    @property
    def lock(self) -> int:
        """Id of the equality that locks the event's own actuator; negative if there is none."""
        return lock_of(self.rig.model, self.drive)

    @cached_property
    def amplitude(self) -> float:
        """Largest displacement of any actuator on the path, [m] or [rad]."""
        gain = self.rig.mapping(self.rig.goal).major_gain()
        return self.rig.size * float(np.abs(gain).max())

    @property
    def limits(self) -> tuple[float, float]:
        """Lowest and highest displacement of the event's own actuator; infinite without limits."""
        low, high = self.rig.task.limits
        return float(low[self.actuator]), float(high[self.actuator])

    def input(self, displacement: float) -> float:
        """Return the input of the event's own actuator for a displacement."""
        everywhere = np.full(len(self.drives), displacement)
        return float(self.rig.task.drives.inputs(everywhere)[self.actuator])

    def ticks(self, duration_s: float) -> float:
        """Return the nearest number of ticks, at least one; infinite for an infinite duration."""
        ticks = duration_s / self.rig.period_s
        return max(1, round(ticks)) if math.isfinite(ticks) else ticks

    def direction(self, axes: int) -> Array:
        """Return a random unit vector, shape (axes,)."""
        normal = self.rng.standard_normal(axes)
        return normal / np.linalg.norm(normal)

    def moved(
        self, what: Literal["stiffness", "damping", "frictionloss"]
    ) -> Callable[[mujoco.MjModel], Array]:
        """Return a function from a model to a writable property (1,) of the joint or tendon.

        Raises:
            WrongInput: The actuator moves neither a joint nor a tendon.
        """
        joint, k, name = self.drive.joint, self.drive.tendon, f"tendon_{what}"
        if joint is not None and what == "stiffness":
            k, name = joint, "jnt_stiffness"
        elif joint is not None:
            k, name = int(self.rig.model.jnt_dofadr[joint]), f"dof_{what}"
        if k is None:
            raise self.unsupported("moves neither a joint nor a tendon")
        return lambda model: getattr(model, name)[k : k + 1]

    def unsupported(self, why: str) -> WrongInput:
        """Return the error that the event does not apply to this actuator."""
        return WrongInput(f"{self.event.name}: {self.rig.actuators[self.actuator]} {why}")
