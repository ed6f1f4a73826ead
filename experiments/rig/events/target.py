"""What an event acts on, and what it does there."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from math import inf
from typing import TYPE_CHECKING, NamedTuple

import mujoco
import numpy as np

from experiments.rig.events.kinds import Event
from experiments.study.study import WrongInput
from sim import Array, Drive
from sim.mjcf.transmission import drives
from sim.plant.actuators import locks_of

if TYPE_CHECKING:
    from experiments.rig.rig import Rig

_FULL = 20.0
"""Input of an actuator without limits, in what the path moves any of them."""


class Effect(NamedTuple):
    """What an event does at each tick from its first one on, which is tick 0.

    Attributes:
        plant: Before the physics; forces on bodies are added to `data.xfrc_applied`.
        measured: What is read of the major rows (m1,) instead.
        sent: What the drives get instead, (n,).
    """

    plant: Callable[[int, mujoco.MjModel, mujoco.MjData], None] | None = None
    measured: Callable[[int, Array], Array] | None = None
    sent: Callable[[int, Array], Array] | None = None


@dataclass(frozen=True)
class Target:
    """The machine of an event.

    Attributes:
        rig: The machine.
        event: What happens.
        rng: Of what is drawn.
    """

    rig: "Rig"
    event: Event
    rng: np.random.Generator

    @cached_property
    def actuator(self) -> int:
        """Number of the event's own."""
        assert self.event.actuator is not None  # of an actuator, so it has one
        return self.rig.number(self.event.actuator)

    @cached_property
    def drives(self) -> tuple[Drive, ...]:
        """Of all actuators of the machine; their numbers are those of the plant's model, too."""
        part = self.rig.part
        return drives(self.rig.model, among=None if part is None else part.actuators)

    @property
    def drive(self) -> Drive:
        """Of the event's own actuator."""
        return self.drives[self.actuator]

    @property
    def lock(self) -> int:
        """The equality that locks it.

        Raises:
            WrongInput: There is none.
        """
        lock = locks_of(self.rig.model, self.drives, None)[self.actuator]
        if lock < 0:
            raise self.refused("has no lock")
        return lock

    @cached_property
    def reach(self) -> float:
        """How far the path moves any actuator, [m] or [rad]."""
        gain = self.rig.mapping(self.rig.goal).major_gain()
        return self.rig.size * float(np.abs(gain).max())

    @property
    def full(self) -> tuple[float, float]:
        """Displacements of the lowest and the highest input of the event's own actuator."""
        low, high = (float(limit[self.actuator]) for limit in self.rig.task.limits)
        most = _FULL * self.reach
        return -most if low == -inf else low, most if high == inf else high

    def input(self, displacement: float) -> float:
        """Of the event's own actuator, for a displacement."""
        everywhere = np.full(len(self.drives), displacement)
        return float(self.rig.task.drives.inputs(everywhere)[self.actuator])

    def ticks(self, duration_s: float) -> int:
        """The nearest number, one at least."""
        return max(1, round(duration_s / self.rig.period_s))

    def direction(self, axes: int) -> Array:
        """A drawn unit vector, (axes,)."""
        drawn = self.rng.standard_normal(axes)
        return drawn / np.linalg.norm(drawn)

    def refused(self, why: str) -> WrongInput:
        """Why the machine has no such event."""
        return WrongInput(f"{self.event.name}: {self.rig.actuators[self.actuator]} {why}")
