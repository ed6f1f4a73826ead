"""Two machines at once, one supervised and one not, and all that a person can do to them."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from fjh.live.course import COURSES, course
from fjh.live.flight import Flight
from fjh.rig import Rig, Run
from fjh.rig.run import SOUND
from ftc.supervisor import Supervisor, SupervisorState

Kind = Literal["sound", "locked", "free", "weak", "loose"]
LASTING = ("hum", "stuck", "sag")
LONGEST_S = 300.0
"""Of a flight: its machine then is replaced. That of two hexapods logs 0.4 GB."""
KEPT_S = 60.0


class Session:
    """A supervised machine and one whose controller does nothing about failures.

    Attributes:
        rig: The robot.
        flights: Of both, supervised first.
        course: What both follow.
        goal: Of both.
        states: Of the actuators.
        going_on: Which of `LASTING` are.
        diagnoses: Whether the first is supervised at present.
    """

    def __init__(self, rig: Rig, seed: int = 0) -> None:
        """Begin with sound machines on the first of `COURSES`; all noise is of the seed."""
        self.rig, self._seed, self.goal = rig, seed, rig.goal
        self._supervisor, self.diagnoses = rig.supervisor(), True
        self._learned: Supervisor | None = None
        self._begin(COURSES[0])

    def restart(self) -> None:
        """Sound machines after one tick at rest; path, goal and diagnosis stay."""
        self._begin(self.course.name)

    def _begin(self, path: str) -> None:
        rig, ticks = self.rig, round(LONGEST_S / self.rig.period_s)
        pilot = self._supervisor if self.diagnoses else self._unaware
        self.flights = [Flight(rig, each, ticks, self._seed) for each in (pilot, self._unaware)]
        self.states: list[Kind] = [SOUND] * len(rig.actuators)
        self.going_on = set[str]()
        self.course, self._since = course(rig, path), 0
        self.advance(1)

    @property
    def _unaware(self) -> Any:
        return self.rig.controller(self.goal)

    @property
    def tick(self) -> int:
        """So many are done."""
        return self.flights[0].tick

    def advance(self, ticks: int) -> int:
        """As many ticks, or until the flights have ended; how many were done.

        Raises:
            sim.SimulationDiverged: The physics left the finite numbers.
        """
        begin = self.tick
        desired, demands = self.course.at(begin - self._since + np.arange(ticks))
        for k in range(ticks):
            if self.flights[0].has_ended:
                return k
            for flight in self.flights:
                flight.step(desired[k], None if demands is None else demands[k])
        return ticks

    def make(self, actuator: int, kind: Kind) -> None:
        """Repair an actuator, or let it fail.

        Raises:
            sim.ModelError: It is to lock and has no lock; it then works.
        """
        if self.states[actuator] == kind:
            return
        self._learn()
        for flight in self.flights:
            if self.states[actuator] != SOUND:
                flight.repair(actuator)
        self.states[actuator] = SOUND
        if kind != SOUND:
            for flight in self.flights:
                flight.strike(actuator, kind)
            self.states[actuator] = kind

    def disturb(self, name: str) -> None:
        """Something happens that is over by itself, such as a bump."""
        self._learn()
        for flight in self.flights:
            flight.begin(name)

    def last(self, name: str, on: bool) -> None:
        """One of `LASTING` begins, or ends."""
        if on == (name in self.going_on):
            return
        self._learn()
        self.going_on ^= {name}
        for flight in self.flights:
            (flight.begin if on else flight.end)(name)

    def follow(self, name: str) -> None:
        """Another path, after the present one faded out."""
        self.course = course(self.rig, name, self.course, self.tick - self._since)
        self._since = self.tick

    def weigh(self, joint_weight: Sequence[float]) -> None:
        """W1 of the goal: what moves of an actuator costs so much."""
        if (weights := tuple(joint_weight)) == self.goal.joint_weight:
            return  # a slider says the same several times
        self.goal = replace(self.goal, joint_weight=weights)
        self._supervisor = self.rig.supervisor(goal=self.goal)
        self._go_on(self.flights[0], self._supervised if self.diagnoses else self._unaware)
        self._go_on(self.flights[1], self._unaware)

    def diagnose(self, on: bool) -> None:
        """Look for failures from now on, or go on with what is known."""
        self._learn()
        self.diagnoses, first = on, self.flights[0]
        if on:
            self._go_on(first, self._supervised)
        elif isinstance(state := first.state, SupervisorState):
            first.hand_over(state.current, state.controller)

    @property
    def _supervised(self) -> Supervisor:
        """Knows the sound machine, if it was ever seen: it does not learn a broken one."""
        if self._learned is None:
            return self._supervisor
        return replace(self._supervisor, monitor=self._learned.monitor)

    def _learn(self) -> None:
        """Keep what was learned before anything happened."""
        state = self.flights[0].state
        if self._learned is None and isinstance(state, SupervisorState):
            with suppress(ValueError):  # not long enough, or there was a failure
                self._learned = self._supervisor.calibrated(state)

    def _go_on(self, flight: Flight, pilot: Any) -> None:
        flight.hand_over(pilot, pilot.transfer(flight.state))

    def last_minute(self) -> tuple[Run, Run]:
        """What happened to both of late."""
        first = max(0, self.tick - round(KEPT_S / self.rig.period_s))
        one, other = (flight.run(first) for flight in self.flights)
        return one, other
