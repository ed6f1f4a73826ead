"""Flights with a supervised controller, with an informed and with a fault-unaware one."""

from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from experiments.recover import flight as flights
from experiments.recover.flight import BEFORE_S, DITHER, STRUCK, Flight
from experiments.rig.hexapod.controller import controller_for
from experiments.rig.hexapod.fault_tolerance import UNUSED
from experiments.rig.hexapod.metrics import closure_residual_max_m
from experiments.rig.hexapod.rig import rig_of
from experiments.rig.hexapod.simulation import Trajectory, track_path
from experiments.rig.hexapod.testbed import Testbed
from ftc.controller import PrioritizedController
from ftc.fdi.diagnosis import Diagnosis
from ftc.fdi.fault_model import Fault
from ftc.goal import Goal
from ftc.oracle import NEVER, OracleController
from ftc.supervisor import Supervisor, goal_after
from sim import Array, Failure

GOAL = Goal(joint_weight=(1.0,) * 6)
"""W_a, under which antipodal struts look alike."""

RECOVERED_S = 0.5
"""After the failure: what counts as recovery begins here."""

_TRANSIENT_S = 0.5
"""Of each flight, not counted."""


def controller(testbed: Testbed, goal: Goal = GOAL) -> PrioritizedController[Any]:
    """A controller for a goal, with the constant Jacobian."""
    return controller_for(testbed, goal, jacobian="constant")


@dataclass(frozen=True)
class Identification:
    """What a supervised controller made of a flight.

    Attributes:
        failures: What happened, in the order of time.
        struck: Tick of each.
        alarm_ticks: Of all alarms.
        diagnoses: All of them, in order.
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


def supervised(testbed: Testbed, flight: Flight) -> tuple[Trajectory, Identification]:
    """Simulate a flight on a testbed with a supervised controller."""
    pilot = replace(_supervisor(), secondary=flight.dither().at)
    run, state = track_path(testbed, pilot, **flight.run)
    return run, Identification(
        failures=flight.failures,
        struck=flight.struck,
        alarm_ticks=tuple(state.watch.alarm_ticks),
        diagnoses=state.diagnoses,
        standing=tuple(state.standing),
        unexplained=state.watch.unexplained,
        task_lost=state.task_lost,
        lost_rightly=not pilot.is_possible([Fault.of(failure) for failure in flight.failures]),
        closure_residual_max_m=closure_residual_max_m(run),
    )


@cache
def _supervisor() -> Supervisor:
    """By the nominal model, which all flights share: made once in each process."""
    return rig_of(flights.testbed()).supervisor(DITHER)


def fault_unaware(testbed: Testbed, flight: Flight) -> Trajectory:
    """The same flight by a controller that goes on as if nothing had happened."""
    pilot = controller(testbed)
    unaware = OracleController(pilot, pilot, NEVER, secondary=flight.dither().at)
    return track_path(testbed, unaware, **flight.run)[0]


def informed(
    testbed: Testbed, flight: Flight, fault: Fault, displacement_m: float, late_s: float = 0.0
) -> Trajectory:
    """The same flight by a controller that is informed of a fault so long after the failure.

    `displacement_m` is where that strut has stuck, which is the same with every controller.
    """
    tick = STRUCK + round(late_s / testbed.bench.control_period_s)
    news = Diagnosis.told(fault, displacement_m)
    after = controller(testbed, goal_after(GOAL, [news], UNUSED))
    lost_displacement_m = np.zeros(6)
    if fault.kind != "locked" and late_s == 0:
        lost_displacement_m[fault.actuator] = (1 - fault.effectiveness) * displacement_m
    pilot = OracleController(
        controller(testbed), after, tick, lost_displacement_m, flight.dither().at
    )
    return track_path(testbed, pilot, **flight.run)[0]


@dataclass(frozen=True)
class Errors:
    """Pointing error |desired - true|, both angles together: before, during, after recovery."""

    rms_urad: tuple[float, ...]
    peak_urad: tuple[float, ...]


def errors(run: Trajectory) -> Errors:
    """Before, during and after: see RECOVERED_S."""
    period_s = run.time_s[1] - run.time_s[0]
    edges = [round(s / period_s) for s in (_TRANSIENT_S, BEFORE_S, BEFORE_S + RECOVERED_S)]
    _, *parts = np.split(pointing_error_urad(run), edges)
    return Errors(
        rms_urad=tuple(float(np.sqrt((part**2).mean())) for part in parts),
        peak_urad=tuple(float(part.max()) for part in parts),
    )


def pointing_error_urad(run: Trajectory) -> Array:
    """Size of desired minus true (alpha, beta), shape (N,)."""
    return 1e6 * np.linalg.norm(run.desired_rad - run.true_rad, axis=1)
