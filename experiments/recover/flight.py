"""One flight, as numbers and words alone: its plant, its failures, its posture."""

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import cache
from typing import Any, Literal

from experiments.recover.course import SPIRAL, Course
from experiments.recover.recovery import BEFORE_S
from experiments.rig.events import Event
from experiments.rig.hexapod.fault_tolerance import DITHER
from experiments.rig.hexapod.mismatch import ALL, ALONE, OTHER
from experiments.rig.hexapod.rig import HexapodRig, hexapod_rig
from experiments.rig.hexapod.testbed import TestbedConfig
from experiments.rig.mismatch import EXACT, Mismatch
from experiments.rig.rig import Rig
from ftc.fdi.dither import Dither
from ftc.fdi.fault_model import Fault
from ftc.supervisor import Supervisor
from sim import Array, Failure

STRUCK = round(BEFORE_S / TestbedConfig().control_period_s)
"""Tick of the failure in each of these flights."""

Sort = Literal["failure", "size", "sound", "pair", "event"]
"""What a flight is for: one failure, with a controller that is informed beside; the supervised one
alone against the size of a mismatch; a long flight without failures; two failures; whatever else
happens, with controllers that do nothing and that are informed beside."""

MISMATCHES: dict[str, Mismatch] = {"exact": EXACT, **ALONE, "all": ALL}
"""Rows of the study's table."""

PLANTS = MISMATCHES | {"other family": OTHER}
"""All plants that are flown."""


@dataclass(frozen=True)
class Flight:
    """One flight; so small that it can be sent to any machine.

    Attributes:
        number: In the study; column `case` of the dataset.
        sort: What it is for.
        draw: Flights of one draw have the same failure, posture, noise and directions of mismatch.
        mismatch: Of plant and model, a name in `PLANTS`.
        factor: By which its sizes are multiplied.
        plant_seed: Of the plant.
        failures: What happens, in the order of time.
        begin_s: Where on the spiral it begins; elsewhere, the time of its first tick.
        duration_s: How long it lasts.
        posture_m: Secondary displacement at which the struts stand, shape (6,).
        seed: Of the sensors' noise.
        events: What else happens.
        course: Where it points.
    """

    number: int
    sort: Sort
    draw: int
    mismatch: str
    factor: float
    plant_seed: int
    failures: tuple[Failure, ...]
    begin_s: float
    duration_s: float
    posture_m: tuple[float, ...]
    seed: int
    events: tuple[Event, ...] = ()
    course: Course = SPIRAL

    @property
    def fault(self) -> Fault:
        """The first fault that is there to be found."""
        return Fault.of(self.failures[0])

    def path(self, rig: Rig) -> Array:
        """Its part of the course, shape (N, 2)."""
        return self.course.desired_rad(self.begin_s, self.duration_s)

    def dither(self, about: Dither = DITHER) -> Dither:
        """The dither, about where the struts stand."""
        return replace(about, offset=self.posture_m)

    @property
    def secondary(self) -> Callable[[float], Array]:
        """Where the struts are to be at each time, as far as the spiral leaves them free."""
        return self.dither().at

    def rig(self) -> HexapodRig:
        """The hexapod with the plant of this flight, settled once for all its controllers."""
        size = PLANTS[self.mismatch].scaled(self.factor)
        return exact_rig().drawn(size, self.plant_seed)

    def pilot(self, rig: Rig) -> Supervisor:
        """By the nominal model, which all flights share."""
        return replace(_supervisor(), secondary=self.secondary)

    def parameters(self) -> dict[str, Any]:
        """The columns in which flights differ before they are simulated."""
        own = {name: value for name, value in asdict(self).items() if name in _OWN}
        row = {"case": self.number, **own}
        for place, failure in zip(("", "second_"), self.failures, strict=False):
            fault = Fault.of(failure)
            row |= {f"{place}strut": fault.actuator + 1, f"{place}kind": fault.kind}
            row |= {f"{place}effectiveness": fault.effectiveness, f"{place}time_s": failure.time_s}
        return row


_OWN = ("sort", "draw", "mismatch", "factor", "plant_seed", "begin_s", "duration_s", "seed")


@cache
def exact_rig() -> HexapodRig:
    """The hexapod on its exact plant, once in each process however many flights it does."""
    return hexapod_rig()


@cache
def _supervisor() -> Supervisor:
    """Made once in each process."""
    return exact_rig().supervisor(DITHER)
