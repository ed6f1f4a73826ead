"""Failures of an actuator during a run."""

from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Literal, cast, get_args

import mujoco

import argument_checks as check
from sim.plant.plant import Plant

FailureKind = Literal["locked", "free", "loose", "weak"]
"""Stuck where it is; without force; without force and spring; with a part of its force."""

_LONGEST_NUMBER = 9
"""Digits of an actuator's number in a text; more are a name."""


@dataclass(frozen=True)
class Failure:
    """One actuator fails at one time.

    As text it is NAME:KIND@SECONDS, such as "strut1:locked@1.3", which :meth:`parse` reads.

    Attributes:
        actuator: 0..n-1, in the order of `plant.drives`, which is that of :func:`jacobians`; or the
            name of its joint, tendon or actuator.
        kind: See :data:`FailureKind`.
        time_s: When, not before the start.
        effectiveness: Part of the force that a weak one has left, in 0..1.

    Raises:
        ValueError: No such kind, a negative actuator, a time that is not finite, or no such part.
    """

    actuator: int | str
    kind: FailureKind
    time_s: float = 0.0
    effectiveness: float = 0.5

    def __post_init__(self) -> None:
        check.choice("kind", self.kind, get_args(FailureKind))
        if not isinstance(self.actuator, str):
            check.index("actuator", self.actuator)
        check.number("time_s", self.time_s)
        check.at_most_one("effectiveness", self.effectiveness)

    def __str__(self) -> str:
        return f"{self.actuator}:{self.kind}@{str(float(self.time_s)).removesuffix('.0')}"

    @classmethod
    def parse(cls, text: str) -> "Failure":
        """Parse NAME:KIND@SECONDS, as `str` writes a failure; a weak one has the default part.

        Args:
            text: NAME of a joint, tendon or actuator, or the number of the actuator in digits.

        Raises:
            ValueError: Another form, no such kind, or no such time.
            TypeError: `text` is of another type.
        """
        name, _, rest = check.instance("text", text, str).rpartition(":")
        kind, _, time_s = rest.partition("@")
        is_number = name.isascii() and name.isdecimal() and len(name) <= _LONGEST_NUMBER
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
        """The actuator, 0..n-1.

        Raises:
            TypeError: It is given by its name, which only a plant or a rig knows the number of.
        """
        if isinstance(self.actuator, str):
            raise TypeError(f"actuator must be a number here, got {check.shown(self.actuator)}")
        return int(self.actuator)

    def strike(self, plant: Plant) -> None:
        """Apply the failure now.

        Raises:
            ValueError: No such actuator.
            ModelError: It is to lock and has no lock.
            TypeError: `plant` is of another type.
        """
        actuator = check.instance("plant", plant, Plant).number(self.actuator)
        if self.kind == "weak":
            plant.weaken(actuator, self.effectiveness)
        else:
            events = {"locked": plant.lock, "free": plant.release, "loose": plant.break_loose}
            events[self.kind](actuator)


def failed_plant(model: mujoco.MjModel, failures: Iterable[Failure]) -> Plant:
    """A plant at rest at the nominal pose, with failures already applied.

    For sites and locks of other names than :class:`Plant` expects, make it with these names and
    apply each failure with :meth:`Failure.strike`.

    Raises:
        ModelError: As :class:`Plant`.
        ValueError: A failure of an actuator that the model lacks.
        TypeError: Something in `failures` is of another type.
    """
    plant = Plant(model)
    for failure in check.members("failures", failures, Failure):
        failure.strike(plant)
    return plant
