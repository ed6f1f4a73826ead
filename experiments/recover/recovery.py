"""Flights of a rig with a supervised controller, with an informed and a fault-unaware one."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import ceil
from typing import Any, Protocol

import numpy as np

from experiments.rig.events import Event
from experiments.rig.rig import Rig
from experiments.rig.run import Run
from ftc.fdi.diagnosis import Diagnosis
from ftc.fdi.fault_model import Fault, static_share
from ftc.fdi.isolation.causes import Cause
from ftc.oracle import NEVER, OracleController
from ftc.reconfiguration import goal_after
from ftc.supervisor import Supervisor
from sim import Array, Failure

BEFORE_S, AFTER_S = 1.2, 2.5
"""Of a flight of the hexapod, before and after its failure."""

RECOVERED_S = 0.5
"""After the failure: what counts as recovery begins here."""


class Flight(Protocol):
    """A flight of a rig, in which actuators fail or do not."""

    @property
    def failures(self) -> tuple[Failure, ...]:
        """What happens, in the order of time."""
        ...

    @property
    def events(self) -> Sequence[Event]:
        """What else happens."""
        ...

    @property
    def begin_s(self) -> float:
        """Time of its first tick."""
        ...

    @property
    def seed(self) -> int:
        """Of the sensors' noise."""
        ...

    @property
    def secondary(self) -> Callable[[float], Array] | None:
        """Reference of the secondary goal (n,) at each time from its first tick; None is zero."""
        ...

    def path(self, rig: Rig) -> Array:
        """Desired displacements of the major rows, shape (N, m1)."""
        ...

    def pilot(self, rig: Rig) -> Supervisor:
        """That diagnoses its failures."""
        ...


@dataclass(frozen=True)
class Identification:
    """What a supervised controller made of a flight.

    Attributes:
        failures: What happened, in the order of time.
        struck: Tick of each.
        alarm_ticks: Of all alarms.
        diagnoses: All of them, in order.
        causes: Of alarms that were dismissed, in order; None is something slow.
        standing: Those that stand in the end.
        unexplained: Whether an alarm was given up.
        task_lost: Whether the controller declared the task lost.
        lost_rightly: Whether the failure atlas says so of what did happen.
        closure_residual_max_m: Of the flight.
    """

    failures: tuple[Failure, ...]
    struck: tuple[int, ...]
    alarm_ticks: tuple[int, ...]
    diagnoses: tuple[Diagnosis, ...]
    causes: tuple[Cause | None, ...]
    standing: tuple[Diagnosis, ...]
    unexplained: bool
    task_lost: bool
    lost_rightly: bool
    closure_residual_max_m: float

    @property
    def alarm_before(self) -> bool:
        """Whether there was an alarm before anything had failed."""
        return any(tick < min(self.struck, default=np.inf) for tick in self.alarm_ticks)

    @property
    def detected(self) -> int | None:
        """Tick of the first alarm from the first failure on."""
        return next((tick for tick in self.alarm_ticks if tick >= self.struck[0]), None)

    @property
    def first(self) -> Diagnosis | None:
        """The first diagnosis from the first failure on."""
        return next((each for each in self.diagnoses if each.tick >= self.struck[0]), None)

    @property
    def sound_named(self) -> bool:
        """Whether ever an actuator was named that had not failed by then."""
        return any(not self._had_failed(each) for each in self.diagnoses)

    @property
    def strut_right(self) -> bool:
        """Whether the first strut that was named is the first that failed, and not before that."""
        first = next(iter(self.diagnoses), None)
        if first is None or first.tick < self.struck[0]:
            return False
        return first.fault.actuator == self.failures[0].actuator

    @property
    def all_right(self) -> bool:
        """Whether each failure was found, and no other, and the loss of the task if it is lost.

        A kind is found if it is among those that are not told apart.
        """
        kinds = {each.number: each.kind for each in self.failures}
        found = {each.fault.actuator: each.kinds for each in self.standing}
        named = kinds.keys() == found.keys()
        return (
            named
            and all(kind in found[strut] for strut, kind in kinds.items())
            and self.task_lost == self.lost_rightly
        )

    def _had_failed(self, diagnosis: Diagnosis) -> bool:
        return any(
            diagnosis.fault.actuator == failure.actuator and diagnosis.tick >= tick
            for failure, tick in zip(self.failures, self.struck, strict=True)
        )


def struck(rig: Rig, flight: Flight) -> tuple[int, ...]:
    """Tick of each failure, from the start of the flight."""
    times_s = [each.time_s - flight.begin_s for each in flight.failures]
    return tuple(ceil(time_s / rig.period_s - 1e-6) for time_s in times_s)


def supervised(rig: Rig, flight: Flight) -> tuple[Run, Identification]:
    """A flight with a controller that diagnoses."""
    pilot = flight.pilot(rig)
    run = _flown(rig, flight, pilot)
    state = run.state
    return run, Identification(
        failures=flight.failures,
        struck=struck(rig, flight),
        alarm_ticks=tuple(state.watch.alarm_ticks),
        diagnoses=state.diagnoses,
        causes=state.watch.causes,
        standing=tuple(state.standing),
        unexplained=state.watch.unexplained,
        task_lost=state.task_lost,
        lost_rightly=not pilot.is_possible([Fault.of(failure) for failure in flight.failures]),
        closure_residual_max_m=float(run.closure_m.max()),
    )


def fault_unaware(
    rig: Rig, flight: Flight, switched: type[OracleController] = OracleController
) -> Run:
    """The same flight by a controller that goes on as if nothing had happened."""
    pilot = rig.controller()
    unaware = switched(pilot, pilot, NEVER, secondary=flight.secondary)
    return _flown(rig, flight, unaware)


def informed(
    rig: Rig, flight: Flight, fault: Fault, displacement: float, late_s: float = 0.0
) -> Run:
    """The same flight by a controller that is informed of a fault so long after the failure.

    `displacement` is where that actuator stood when it failed, with any controller.
    """
    news, lost = Diagnosis.told(fault, displacement), np.zeros(len(rig.actuators))
    acting = np.zeros(len(rig.actuators))
    acting[fault.actuator] = static_share(rig.nominal, fault)
    if fault.kind != "locked" and late_s == 0:
        lost[fault.actuator] = (1 - static_share(rig.nominal, fault)) * displacement
    after = rig.controller(goal_after(rig.goal, [news], rig.nominal, rig.unused))
    tick = struck(rig, flight)[0] + round(late_s / rig.period_s)
    pilot = OracleController(rig.controller(), after, tick, lost, flight.secondary, acting)
    return _flown(rig, flight, pilot)


def _flown(rig: Rig, flight: Flight, pilot: Any) -> Run:
    how = {"failures": flight.failures, "seed": flight.seed, "begin_s": flight.begin_s}
    return rig.fly(pilot, flight.path(rig), events=flight.events or None, **how)
