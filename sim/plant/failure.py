"""Failures of an actuator during a run."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal, get_args

import mujoco

import argument_checks as check
from sim.plant.plant import Plant

FailureKind = Literal["locked", "free", "loose", "weak"]
"""Stuck where it is; without force; without force and spring; with a part of its force."""


@dataclass(frozen=True)
class Failure:
    """One actuator fails at one time.

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
