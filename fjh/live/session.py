"""Two machines at once, one supervised and one not, and all that a person can do to them."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from fjh.live.live_run import Kind, LiveRun
from fjh.live.reference_path import PATHS, course
from fjh.rig import Rig, Run
from fjh.rig.run import SOUND
from ftc import Supervisor, SupervisorState

LONGEST_S = 300.0
"""Of a flight: its machine then is replaced. That of two hexapods logs 0.4 GB."""
SAVED_S = 60.0


class Session:
    """A supervised machine and one whose controller does nothing about failures.

    Attributes:
        rig: The robot.
        flights: Of both, supervised first.
        course: What both follow.
        goal: Of both.
        states: Of the actuators.
        going_on: Events that are not over by themselves.
        diagnoses: Whether the first is supervised at present.
    """

    def __init__(self, rig: Rig, seed: int = 0) -> None:
        """Begin with sound machines on the first of `COURSES`; all noise is of the seed."""
        self.rig, self._seed, self.goal = rig, seed, rig.goal
        self._supervisor, self.diagnoses = rig.supervisor(), True
        self._learned: Supervisor | None = None
        self.restart(PATHS[0])

    def restart(self, path: str | None = None) -> None:
        """Sound machines after one tick at rest; goal, diagnosis and, if None, path stay."""
        rig, ticks = self.rig, round(LONGEST_S / self.rig.period_s)
        pilot = self._supervisor if self.diagnoses else self._fault_unaware
        self.runs = [LiveRun(rig, each, ticks, self._seed) for each in (pilot, self._fault_unaware)]
        self.states: list[Kind] = [SOUND] * len(rig.actuators)
        self.going_on = set[str]()
        self.course, self._since = course(rig, path or self.course.name), 0
        self.advance(1)

    @property
    def _fault_unaware(self) -> Any:
        return self.rig.controller(self.goal)

    @property
    def tick(self) -> int:
        """So many are done."""
        return self.runs[0].tick

    def advance(self, ticks: int) -> int:
        """As many ticks, or until the flights have ended; how many were done.

        Raises:
            sim.SimulationDiverged: The physics left the finite numbers.
        """
        ticks = min(ticks, self.runs[0].left)
        desired, demands = self.course.at(self.tick - self._since + np.arange(ticks))
        for k in range(ticks):
            for flight in self.runs:
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
        steps: tuple[Kind, ...] = (SOUND, kind)
        for each in steps:
            if each != self.states[actuator]:
                for flight in self.runs:
                    flight.make(actuator, each)
                self.states[actuator] = each

    def disturb(self, name: str, on: bool | None = None) -> None:
        """An event begins, or ends; None is one that is over by itself, such as a bump."""
        if on == (name in self.going_on):
            return
        self._learn()
        if on is not None:
            self.going_on ^= {name}
        for flight in self.runs:
            (flight.end if on is False else flight.begin)(name)

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
        self.runs[0].switch_controller(self._supervised if self.diagnoses else self._fault_unaware)
        self.runs[1].switch_controller(self._fault_unaware)

    def diagnose(self, on: bool) -> None:
        """Look for failures from now on, or go on with what is known."""
        self._learn()
        self.diagnoses, first = on, self.runs[0]
        if on:
            first.switch_controller(self._supervised)
        elif isinstance(state := first.state, SupervisorState):
            first.switch_controller(state.current, state.controller)

    @property
    def _supervised(self) -> Supervisor:
        """Knows the sound machine, if it was ever seen: it does not learn a broken one."""
        if self._learned is None:
            return self._supervisor
        return replace(self._supervisor, monitor=self._learned.monitor)

    def _learn(self) -> None:
        """Keep what was learned before anything happened."""
        state = self.runs[0].state
        if self._learned is None and isinstance(state, SupervisorState):
            with suppress(ValueError):  # not long enough, or there was a failure
                self._learned = self._supervisor.calibrated(state)

    def last_minute(self) -> tuple[Run, Run]:
        """What happened to both of late."""
        first = max(0, self.tick - round(SAVED_S / self.rig.period_s))
        return self.runs[0].run(first), self.runs[1].run(first)
