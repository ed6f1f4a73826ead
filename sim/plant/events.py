"""Events of a run: failures of actuators, and hooks tick by tick."""

from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from difflib import get_close_matches
from inspect import signature
from typing import Any, Literal, cast, get_args

import mujoco
import numpy as np

import argument_checks as check
from sim.array import Array
from sim.plant.plant import Plant
from sim.plant.sensors import Reading

FailureKind = Literal["locked", "free", "loose", "weak"]
"""Stuck where it is; without force; without force and spring; with a part of its force."""


@dataclass(frozen=True)
class Failure:
    """One actuator fails at one time.

    As text it is NAME:KIND@SECONDS, such as "strut1:locked@1.3", which :meth:`parse` reads.

    Attributes:
        actuator: 0..n-1, in the order of `plant.drives`, which is that of :func:`jacobians`; or the
            name of its joint, tendon or actuator.
        kind: See :data:`FailureKind`.
        time_s: When, not before 0.
        effectiveness: Part of the force that a weak one has left, in 0..1.
    """

    actuator: int | str
    kind: FailureKind
    time_s: float = 0.0
    effectiveness: float = 0.5

    def __post_init__(self) -> None:
        check.choice("kind", self.kind, get_args(FailureKind))
        if not isinstance(self.actuator, str):
            check.integer("actuator", self.actuator)
        check.number("time_s", self.time_s, 0.0)
        check.number("effectiveness", self.effectiveness, 0.0, 1.0)

    def __str__(self) -> str:
        return f"{self.actuator}:{self.kind}@{str(float(self.time_s)).removesuffix('.0')}"

    @classmethod
    def parse(cls, text: str) -> "Failure":
        """Parse NAME:KIND@SECONDS, as `str` writes a failure; a weak one has the default part.

        NAME is that of a joint, tendon or actuator, or the number of the actuator in digits.
        """
        name, _, rest = check.instance("text", text, str).rpartition(":")
        kind, _, time_s = rest.partition("@")
        is_number = name.isascii() and name.isdecimal() and len(name) < 10  # of 32 bits
        actuator = int(name) if is_number else name
        with suppress(ValueError):  # what is said below is of the whole text
            if name:
                return cls(actuator, cast(FailureKind, kind), float(time_s))
        kinds = get_args(FailureKind)
        near = [] if kind in kinds else get_close_matches(kind, kinds, 1)
        hint = f'; did you mean "{near[0]}"?' if near else ""
        raise ValueError(
            f"text must be NAME:KIND@SECONDS, with KIND one of {', '.join(kinds)} and SECONDS from "
            f"0 on, got {check.shown(text)}{hint}"
        )

    @property
    def number(self) -> int:
        """The actuator, 0..n-1."""
        if isinstance(self.actuator, str):
            raise TypeError(f"actuator must be a number here, got {check.shown(self.actuator)}")
        return int(self.actuator)

    def strike(self, plant: Plant) -> None:
        """Apply the failure now; a ModelError if the actuator is to lock and has no lock."""
        actuator = check.instance("plant", plant, Plant).number(self.actuator)
        if self.kind == "weak":
            plant.weaken(actuator, self.effectiveness)
        else:
            events = {"locked": plant.lock, "free": plant.release, "loose": plant.break_loose}
            events[self.kind](actuator)


def failed_plant(model: mujoco.MjModel, failures: Iterable[Failure]) -> Plant:
    """Make a plant at rest at the nominal pose, with failures already applied.

    Sites have the names that :class:`Plant` expects by default.
    """
    plant = Plant(model)
    for failure in check.members("failures", failures, Failure):
        failure.strike(plant)
    return plant


def hooks_of(events: object) -> list[Any]:
    """List the hooks `plant`, `measured` and `sent` of an object, None where it has none."""
    takes = {"plant": "tick, model, data", "measured": "tick, reading", "sent": "tick, inputs"}
    hooks = {name: getattr(events, name, None) for name in takes}
    given = {name: hook for name, hook in hooks.items() if hook is not None}
    if not given:
        raise TypeError("events must have plant, measured or sent, got " + check.shown(events))
    for name, hook in given.items():
        with suppress(ValueError):  # of compiled functions nothing is known
            of = signature(check.function(f"events.{name}", hook))
            try:
                of.bind(*takes[name].split(", "))
            except TypeError:
                said = f"events.{name} must be a function of ({takes[name]}), got {of}"
                raise TypeError(said) from None
    return [*hooks.values()]


def measured_by(hook: Callable[[int, Any], Any], tick: int, reading: Any) -> tuple[Any, Any]:
    """Let a hook change a reading; return it, and the error of a pilot that needs what is missing.

    The error is None if nothing is missing, as NaN, and all numbers are there, in arrays.
    """
    changed = hook(tick, reading)
    if not isinstance(reading, Reading):
        return changed, None
    name, arrays = f"what events.measured returns at tick {tick}", list[Array]()
    try:
        check.attributes(name, changed, *Reading._fields)
        for part, before in zip(Reading._fields, reading, strict=True):
            value = getattr(changed, part)
            arrays.append(check.array(f"{part} of {name}", value, *before.shape, finite=False))
    except (ValueError, TypeError) as error:
        return changed, error
    missing = ValueError(f"pilot must go on without numbers that are missing in {name}")
    return Reading(*arrays), None if np.isfinite(arrays[0]).all() else missing


def sent_by(hook: Callable[[int, Array], Array], tick: int, inputs: Array) -> Array:
    """Let a hook change inputs, and refuse anything but as many finite numbers."""
    name = f"what events.sent returns at tick {tick}"
    return check.array(name, hook(tick, inputs), *inputs.shape)
