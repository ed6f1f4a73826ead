"""One flight of any robot whose actuator fails, as numbers and words; and what became of it."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from experiments.recover.recovery import RECOVERED_S, Identification, informed, supervised
from experiments.rig.events import Event
from experiments.rig.mjcf import robot_rig
from experiments.rig.options import RobotOptions, Sensing
from experiments.rig.rig import Rig
from experiments.rig.run import Run
from ftc.fdi.dither import Dither
from ftc.fdi.fault_model import Fault
from ftc.supervisor import Supervisor
from sim import Array, Failure

TRANSIENT_S, LEFT_S = 0.8, 1.0
"""What is not counted at the start, while the diagnosis learns; how long a flight goes on once it
has recovered."""


def recovered_s(rig: Rig) -> float:
    """After a failure, one period of the slowest loop's crossover: errors until then have decayed.

    Not less than on the hexapod, whose loops are faster.
    """
    return max(RECOVERED_S, 1 / min(each.crossover_hz for each in rig.margins))


@dataclass(frozen=True)
class MechanismFlight:
    """A flight of a robot around a circle, in a direction of its own.

    Attributes:
        number: In the study; column `case` of the dataset.
        model: MJCF file.
        options: Of the robot.
        dither: In which the diagnosis looks for failures; None is none.
        failure: What happens; None is nothing.
        isolable: Whether the dither separates it in half a second, by the uncertain linear model.
        turn_s: Time of one turn.
        duration_s: How long it lasts.
        seed: Of plant, noise, drift and direction.
        events: What else happens.
    """

    number: int
    model: Path
    options: RobotOptions
    dither: Dither | None
    failure: Failure | None
    isolable: bool
    turn_s: float
    duration_s: float
    seed: int
    events: tuple[Event, ...] = ()

    @property
    def sense(self) -> Sensing:
        """What the diagnosis looks at."""
        return self.options.sense

    @property
    def failures(self) -> tuple[Failure, ...]:
        """What happens, if anything does."""
        return () if self.failure is None else (self.failure,)

    @property
    def begin_s(self) -> float:
        """It begins with the circle."""
        return 0.0

    @property
    def fault(self) -> Fault | None:
        """What there is to find."""
        return None if self.failure is None else Fault.of(self.failure)

    @property
    def secondary(self) -> Callable[[float], Array] | None:
        """The dither."""
        return None if self.dither is None else self.dither.at

    def rig(self) -> Rig:
        """The robot, its plants drawn with all mismatches."""
        return _rig(self.model, self.options).drawn("all", self.seed)

    def pilot(self, rig: Rig) -> Supervisor:
        """With the dither."""
        return rig.supervisor(self.dither)

    def path(self, rig: Rig) -> Array:
        """Desired displacements of the major rows, shape (N, m1), a circle in any plane of them."""
        circle = rig.path("circle", duration_s=self.duration_s, turn_s=self.turn_s)
        normal = np.random.default_rng([self.seed, 1]).normal(size=(len(rig.major),) * 2)
        return circle @ np.linalg.qr(normal)[0]


@lru_cache(maxsize=3)
def _rig(model: Path, options: RobotOptions) -> Rig:
    """Once in each process, however many flights it does."""
    return robot_rig(model, options)


@dataclass(frozen=True)
class MechanismFlown:
    """What became of a flight.

    Attributes:
        flight: The flight.
        found: What the diagnosis made of it.
        rms: Error of all major rows together, before the failure and after recovery, in sizes of
            the path; the second is None without a failure.
        rms_informed: After recovery, by a controller informed of the failure at once; None where
            nothing fails, or the actuators that are left cannot do the task.
    """

    flight: MechanismFlight
    found: Identification
    rms: tuple[float, float | None]
    rms_informed: float | None


def fly(flight: MechanismFlight) -> MechanismFlown:
    """The flight with a supervised controller, then with an informed one."""
    rig, fault = flight.rig(), flight.fault
    run, found = supervised(rig, flight)
    rms_informed = None
    if fault is not None and not found.lost_rightly:
        stood = float(run.displacement[found.struck[0], fault.actuator])
        rms_informed = _rms(rig, informed(rig, flight, fault, stood), found.struck)[1]
    return MechanismFlown(flight, found, _rms(rig, run, found.struck), rms_informed)


def _rms(rig: Rig, run: Run, struck: tuple[int, ...]) -> tuple[float, float | None]:
    """Before the failure and after recovery, as in :class:`MechanismFlown`."""
    error = (run.desired - run.true) / rig.size
    begin, recovered = (round(s / rig.period_s) for s in (TRANSIENT_S, recovered_s(rig)))
    at = min(struck, default=len(error))
    before, after = error[begin:at], error[at + recovered :]
    rms = [float(np.sqrt((part**2).sum(axis=1).mean())) for part in (before, after) if len(part)]
    return rms[0], rms[1] if len(rms) > 1 else None
