"""The closed loop as a whole, and its ticks with recorded measurements: no plant."""

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass
from functools import cached_property, partial
from time import process_time_ns
from typing import Any, Generic, TypeVar

import mujoco
import numpy as np

from experiments.benchmark.measurement import Contender
from experiments.rig import Rig
from experiments.rig.hexapod.columns import COLUMNS
from experiments.rig.hexapod.fault_tolerance import nominal_model
from experiments.rig.hexapod.rig import hexapod_rig
from experiments.rig.hexapod.testbed import Testbed
from experiments.rig.run import Run
from ftc.controller import Measurement, PrioritizedController
from ftc.fdi.diagnosis import DEFAULT_CONFIG
from ftc.fdi.monitor import Monitor, MonitorState, monitor
from ftc.loop import Controller
from sim import MODELS, Array, Failure, Plant, Pose

Pilot = TypeVar("Pilot", bound=Controller[Any])

GOAL = COLUMNS[0].goal  # w_a, all struts sound
_SAMPLED = 64  # ticks of the monitor in one sample


@dataclass(frozen=True)
class ClosedLoop:
    """The run that is timed: `seconds` of the spiral after settling, noise of this seed."""

    testbed: Testbed
    seconds: float
    seed: int

    @property
    def ticks(self) -> int:
        """Of control."""
        return len(self.testbed.bench.time_s(self.seconds))

    @property
    def steps(self) -> int:
        """Of physics, those of settling too."""
        seconds = self.testbed.bench.settling_s + self.seconds
        return round(seconds / self.testbed.model.opt.timestep)

    def run(self) -> None:
        """The whole closed loop, its log kept in memory."""
        rig = hexapod_rig(self.testbed, GOAL, jacobian="analytic")
        rig.fly(rig.controller(), self.testbed.bench.spiral_rad(self.seconds), seed=self.seed)

    def step(self) -> None:
        """MuJoCo alone, in one call."""
        model = self.testbed.model
        mujoco.mj_step(model, mujoco.MjData(model), self.steps)


def whole(loop: ClosedLoop) -> list[Contender]:
    """Times per control tick: bare physics, and the loop."""
    return [
        Contender("mj_step", loop.step, lambda: [()], loop.ticks),
        Contender("closed_loop", loop.run, lambda: [()], loop.ticks),
    ]


LOOPS = {"arm": (3, 4, 5), "hand": (3, 4), "arms": (3, 4, 5), "platform": (3, 4)}
"""Bundled robots beside the hexapod, and their major rows."""


@dataclass(frozen=True)
class RobotLoop:
    """A run of a robot that is timed: `seconds` of a circle, noise of this seed."""

    name: str
    rig: Rig
    seconds: float
    seed: int

    @staticmethod
    def of(name: str, seconds: float, seed: int) -> "RobotLoop":
        """That of a bundled robot."""
        major = LOOPS.get(name)
        if major is None:
            return RobotLoop(name, Rig.hexapod(), seconds, seed)
        rig = Rig.of_mjcf(MODELS / f"{name}.xml", site="payload", major=major)
        return RobotLoop(name, rig, seconds, seed)

    @cached_property
    def path(self) -> Array:
        """Of the major rows, (N, m1)."""
        return self.rig.path("circle", duration_s=self.seconds)

    @cached_property
    def _at_rest(self) -> Plant:
        return self.rig.bench(np.zeros(1), (), self.seed).plant

    def step(self) -> None:
        """MuJoCo alone, from the start, in one call."""
        plant, rig = self._at_rest, self.rig
        data = copy(plant.data)
        steps = len(self.path) * round(rig.period_s / plant.model.opt.timestep)
        mujoco.mj_step(plant.model, data, steps)

    def contenders(self) -> list[Contender]:
        """Times per control tick: bare physics, the loop, and the loop that diagnoses."""
        pilots = {"loop": self.rig.controller(), "supervised": self.rig.supervisor()}
        calls = {"physics": self.step} | {
            name: partial(self.rig.fly, pilot, self.path, seed=self.seed)
            for name, pilot in pilots.items()
        }
        ticks = len(self.path)
        return [
            Contender(f"{self.name}_{name}", call, lambda: [()], ticks)
            for name, call in calls.items()
        ]

    def slowest(self) -> dict[str, float]:
        """Mean and slowest tick of a supervisor, in a run in which an actuator locks, [us]."""
        rig, pilot = self.rig, self.rig.supervisor()
        struck = [Failure(0, "locked", _STRUCK_S)]
        path = rig.path("circle", duration_s=2 * _STRUCK_S)
        timed = _Timed(pilot)
        rig.fly(timed, path, failures=struck, seed=self.seed)
        return {"mean_us": float(np.mean(timed.us)), "slowest_us": max(timed.us)}


_STRUCK_S = 2.5  # after so long what is learned of the machine is known


class _Timed:
    """A controller whose ticks are timed, processor time, [us]."""

    def __init__(self, pilot: Any) -> None:
        self.start, self._step, self.us = pilot.start, pilot.step, list[float]()

    def step(self, *given: Any, feedforward: Array | None = None) -> Any:
        """As the controller."""
        begin = process_time_ns()
        state = self._step(*given, feedforward=feedforward)
        self.us.append(1e-3 * (process_time_ns() - begin))
        return state


@dataclass(frozen=True)
class Recorded(Generic[Pilot]):
    """A run of the hexapod in closed loop, all struts sound, and the controller that made it."""

    testbed: Testbed
    controller: Pilot
    run: Run

    def controlling(self) -> Callable[[], None]:
        """A call is one control tick: with the inputs of the run, after the last over again."""
        pilot, run = self.controller, self.run
        at_rest = np.zeros(run.displacement.shape[1])
        given = [
            (desired, Measurement(output=measured, displacement=at_rest))
            for desired, measured in zip(run.desired, run.measured, strict=True)
        ]
        begin = state = pilot.start()
        k = 0

        def tick() -> None:
            nonlocal state, k
            state = pilot.step(state if k else begin, *given[k])
            k = (k + 1) % len(given)

        return tick

    def watched(
        self: "Recorded[PrioritizedController[Pose]]",
    ) -> tuple[Monitor, list[tuple[MonitorState, Array, Array]]]:
        """A monitor, and the arguments of its last ticks: state, outputs, displacements.

        Raises:
            RuntimeError: The monitor raised an alarm, and would do more work than without.
        """
        bench, run = self.testbed.bench, self.run
        watch = monitor(nominal_model(self.testbed.model, bench))
        held_m = self.controller.drives.displacements(run.inputs)
        commanded_m = np.vstack([np.zeros((1, held_m.shape[1])), held_m[:-1]])
        state, arguments = watch.start(), []
        for given in zip(run.measured, commanded_m, strict=True):
            arguments.append((state, *given))
            state = watch.step(state, *given)
        if state.alarm_ticks:
            raise RuntimeError("the monitor raised an alarm in a run without failures")
        return watch, arguments[-_SAMPLED:]

    def diagnosis(self: "Recorded[PrioritizedController[Pose]]") -> list[Contender]:
        """What the diagnosis adds to a control tick while nothing has failed: mean, slowest ticks.

        Its work recurs with the ticks of one of its samples.
        """
        watch, arguments = self.watched()
        phases = [arguments[k :: watch.ticks] for k in range(watch.ticks)]
        each = [Contender("diagnosis_worst", watch.step, lambda g=g: g, len(g), 5) for g in phases]
        slowest = max(each, key=lambda one: min(one.timer(process_time_ns).repeat(9, number=1)))
        whole = Contender("diagnosis", watch.step, lambda: arguments, len(arguments), samples=5)
        return [whole, slowest]


def recorded(testbed: Testbed, pilot: Pilot, seed: int) -> Recorded[Pilot]:
    """A run as long as the diagnosis looks back, so that its history is full, and a little more."""
    seconds = DEFAULT_CONFIG.look_back_s + 2 * _SAMPLED * testbed.bench.control_period_s
    run = hexapod_rig(testbed).fly(pilot, testbed.bench.spiral_rad(seconds), seed=seed)
    return Recorded(testbed, pilot, run)
