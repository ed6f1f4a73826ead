"""Simulation of two machines, one with diagnosis and one without, and actions of the user."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from fjh.live.live_run import Kind, LiveRun
from fjh.live.reference_path import PATHS, reference_path
from fjh.rig import Rig, Run
from fjh.rig.run import HEALTHY
from ftc import Supervisor, SupervisorState

LONGEST_S = 300.0
"""Longest run [s], after which new machines start: the log of two hexapods then has 0.4 GB."""
SAVED_S = 60.0
"""Duration of a saved recording [s]."""


class Session:
    """Simulation of two equal machines: the first has a supervisor, the second no diagnosis.

    Attributes:
        rig: The robot.
        runs: Runs of both machines.
        reference: Reference path of both.
        goal: Goal of both.
        states: States of the actuators.
        going_on: Names of active events that do not end by themselves.
        diagnoses: Whether the diagnosis of the first machine is on.
    """

    def __init__(self, rig: Rig, seed: int = 0) -> None:
        """Start healthy machines on the first of `PATHS`; the seed determines random numbers."""
        self.rig, self._seed, self.goal = rig, seed, rig.goal
        self._supervisor, self.diagnoses = rig.supervisor(), True
        self._learned: Supervisor | None = None
        self.restart(PATHS[0])

    def restart(self, path: str | None = None) -> None:
        """Replace the machines by healthy ones on a path; None: the present path."""
        rig, ticks = self.rig, round(LONGEST_S / self.rig.period_s)
        first = self._supervisor if self.diagnoses else self._fault_unaware
        self.runs = [LiveRun(rig, one, ticks, self._seed) for one in (first, self._fault_unaware)]
        self.states: list[Kind] = [HEALTHY] * len(rig.actuators)
        self.going_on = set[str]()
        self.reference, self._since = reference_path(rig, path or self.reference.name), 0
        self.advance(1)

    @property
    def _fault_unaware(self) -> Any:
        return self.rig.controller(self.goal)

    @property
    def tick(self) -> int:
        """Number of simulated ticks."""
        return self.runs[0].tick

    def advance(self, ticks: int) -> int:
        """Simulate up to `ticks` ticks, at most to the end of the runs; return their number.

        Raises:
            sim.SimulationDiverged: The state of the physics is not finite.
        """
        ticks = min(ticks, self.runs[0].ticks_left)
        desired, demands = self.reference.at(self.tick - self._since + np.arange(ticks))
        for k in range(ticks):
            for run in self.runs:
                run.step(desired[k], None if demands is None else demands[k])
        return ticks

    def make(self, actuator: int, kind: Kind) -> None:
        """Repair an actuator, or let it fail.

        Raises:
            sim.ModelError: The model has no lock for the actuator, which stays healthy.
        """
        if self.states[actuator] == kind:
            return
        self._learn()
        steps: tuple[Kind, ...] = (HEALTHY, kind)
        for step in steps:
            if step != self.states[actuator]:
                for run in self.runs:
                    run.make(actuator, step)
                self.states[actuator] = step

    def disturb(self, name: str, on: bool | None = None) -> None:
        """Start (True) or end (False) an event; None starts one that ends by itself."""
        if on == (name in self.going_on):
            return
        self._learn()
        if on is not None:
            self.going_on ^= {name}
        for run in self.runs:
            (run.end_event if on is False else run.start_event)(name)

    def follow(self, name: str) -> None:
        """Switch to another path after fading out the present one."""
        self.reference = reference_path(self.rig, name, self.reference, self.tick - self._since)
        self._since = self.tick

    def weigh(self, joint_weight: Sequence[float]) -> None:
        """Set the joint weights W1 of the goal."""
        if (weights := tuple(joint_weight)) == self.goal.joint_weight:
            return  # a slider repeats its value
        self.goal = replace(self.goal, joint_weight=weights)
        self._supervisor = self.rig.supervisor(goal=self.goal)
        self.runs[0].switch_controller(self._supervised if self.diagnoses else self._fault_unaware)
        self.runs[1].switch_controller(self._fault_unaware)

    def diagnose(self, on: bool) -> None:
        """Switch the diagnosis on or off; its present result remains in the controller."""
        self._learn()
        self.diagnoses, first = on, self.runs[0]
        if on:
            first.switch_controller(self._supervised)
        elif isinstance(state := first.state, SupervisorState):
            first.switch_controller(state.current, state.controller)

    @property
    def _supervised(self) -> Supervisor:
        """Supervisor, with the calibration from the healthy machine if there is one."""
        if self._learned is None:
            return self._supervisor
        return replace(self._supervisor, monitor=self._learned.monitor)

    def _learn(self) -> None:
        """Keep the calibration of the diagnosis if neither a failure nor an event has occurred."""
        state = self.runs[0].state
        if self._learned is None and isinstance(state, SupervisorState):
            with suppress(ValueError):  # too short, or there was a failure
                self._learned = self._supervisor.calibrated(state)

    def last_minute(self) -> tuple[Run, Run]:
        """Return the runs of both machines in the last minute."""
        first = max(0, self.tick - round(SAVED_S / self.rig.period_s))
        return self.runs[0].logged_run(first), self.runs[1].logged_run(first)
