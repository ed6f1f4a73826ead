"""A case of the study as numbers and words alone: its robot, its path, and what happens."""

from dataclasses import dataclass, replace
from functools import lru_cache
from math import inf
from pathlib import Path
from typing import Any, Literal

import numpy as np

from experiments.rig.events import Event
from experiments.rig.hexapod.mismatch import ALONE, OTHER
from experiments.rig.hexapod.rig import hexapod_rig
from experiments.rig.hexapod.testbed import TestbedConfig
from experiments.rig.mismatch import EXACT, Mismatch
from experiments.rig.mjcf import robot_rig
from experiments.rig.options import RobotOptions
from experiments.rig.rig import Rig
from ftc.fdi.dither import Dither
from ftc.fdi.fault_model import Fault
from sim import Array, Failure

BENCH = TestbedConfig()
MISMATCHES = ("exact", *ALONE, "all", "other family")
"""Names of differences of plant and model, in the order of the tables."""

Sort = Literal["failure", "size", "pair", "healthy", "event"]
"""What a case is for: one failure, beside an informed controller; the supervised controller alone,
against the size of a mismatch; two failures; no failure; an event, beside an unaware controller."""


@dataclass(frozen=True)
class Course:
    """A path of the major rows.

    Attributes:
        shape: The testbed's spiral, from any time on; a circle from rest; steps out and back, each
            held for a quarter of a turn; or none.
        turn_s: Time of one turn.
        radius: In sizes of the robot's path.
        plane_seed: Of the plane of the major rows in which it lies; None: the first two rows.
    """

    shape: Literal["spiral", "circle", "steps", "rest"] = "spiral"
    turn_s: float = BENCH.spiral_period_s
    radius: float = 1.0
    plane_seed: int | None = None

    def path(self, rig: Rig, begin_s: float, duration_s: float) -> Array:
        """The part of it that a run follows, shape (N, m1)."""
        if self.shape == "spiral":
            size_urad = self.radius * BENCH.spiral_radius_urad
            bench = replace(BENCH, spiral_period_s=self.turn_s, spiral_radius_urad=size_urad)
            return bench.spiral_rad(duration_s, begin_s)
        if self.shape == "rest":
            return np.zeros((round(duration_s / rig.period_s), len(rig.major)))
        sized = replace(rig, size=self.radius * rig.size)
        path = sized.path(self.shape, duration_s=duration_s, turn_s=self.turn_s)
        if self.plane_seed is None:
            return path
        normal = np.random.default_rng([self.plane_seed, 1]).normal(size=(len(rig.major),) * 2)
        return path @ np.linalg.qr(normal)[0]


@dataclass(frozen=True)
class Case:
    """One run with all controllers that are compared; so small that it can be sent anywhere.

    Attributes:
        number: In the study; column `case` of the dataset.
        sort: What it is for.
        draw: Cases of one draw have the same failure, path, noise and plant, as far as they can.
        mismatch: Of plant and model, a name in `MISMATCHES`.
        factor: By which its sizes are multiplied.
        plant_seed: Of the plant.
        seed: Of the sensors' noise, and of what is drawn of events.
        begin_s: Time of its first tick; on the spiral, where it begins.
        duration_s: How long it lasts.
        dither: Secondary motion, about where the actuators stand; None is none.
        failures: What happens, in the order of time.
        events: What else happens; one at most.
        course: Path of the major rows.
        compared: Controllers beside the supervised one, "informed" and "unaware".
        transient_s: Start of the run that its errors do not count.
        recovered_s: What counts as recovery begins so long after what happens.
        isolable: Whether the dither separates the failure in half a second, by the uncertain linear
            model; None: that is not known.
        model: MJCF file; None is the hexapod.
        options: Of the robot of a file.
    """

    number: int
    sort: Sort
    draw: int
    mismatch: str
    factor: float
    plant_seed: int
    seed: int
    begin_s: float
    duration_s: float
    dither: Dither | None
    failures: tuple[Failure, ...] = ()
    events: tuple[Event, ...] = ()
    course: Course = Course()
    compared: tuple[str, ...] = ()
    transient_s: float = 0.5
    recovered_s: float = 0.5
    isolable: bool | None = None
    model: Path | None = None
    options: RobotOptions | None = None

    @property
    def happens_s(self) -> float:
        """Time of its first failure or event; infinite where nothing happens."""
        return min((each.time_s for each in (*self.failures, *self.events)), default=inf)

    def rig(self) -> Rig:
        """The robot with the plant of this case, for all its controllers."""
        rig = exact_rig(self.model, self.options)
        return rig.drawn(sizes_of(rig, self.mismatch).scaled(self.factor), self.plant_seed)

    def path(self, rig: Rig) -> Array:
        """Desired displacements of the major rows, shape (N, m1)."""
        return self.course.path(rig, self.begin_s, self.duration_s)

    def parameters(self) -> dict[str, Any]:
        """The columns in which cases differ before they are simulated."""
        row = {name: getattr(self, name) for name in _DRAWN}
        row |= {"case": self.number, "sense": self.options.sense if self.options else "task"}
        rig, course = exact_rig(self.model, self.options), self.course
        row |= {"course": course.shape, "turn_s": course.turn_s, "radius": course.radius}
        for place, failure in zip(("", "second_"), self.failures, strict=False):
            fault = Fault.of(failure)
            row |= {f"{place}actuator": rig.actuators[fault.actuator], f"{place}kind": fault.kind}
            row |= {f"{place}effectiveness": fault.effectiveness, f"{place}time_s": failure.time_s}
        for event in self.events:
            own = None if event.actuator is None else rig.actuators[rig.number(event.actuator)]
            row |= {"event": event.name, "time_s": event.time_s, "actuator": own}
        return row


_DRAWN = (
    *("sort", "draw", "mismatch", "factor", "plant_seed", "seed"),
    *("begin_s", "duration_s", "isolable"),
)


@lru_cache(maxsize=4)
def exact_rig(model: Path | None = None, options: RobotOptions | None = None) -> Rig:
    """The hexapod, or the robot of a file, on its exact plant: once in each process."""
    return hexapod_rig() if model is None or options is None else robot_rig(model, options)


def sizes_of(rig: Rig, mismatch: str) -> Mismatch:
    """How far a plant of a name in `MISMATCHES` is from the model."""
    named = {"exact": EXACT, "all": rig.machine.everything, "other family": OTHER, **ALONE}
    return named[mismatch]
