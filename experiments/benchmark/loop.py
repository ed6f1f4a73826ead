"""The closed loop beside bare physics of the same steps, and the parts of a control tick."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from experiments.benchmark.stopwatch import Contender
from experiments.hexapod.choices import JacobianChoice
from experiments.hexapod.columns import COLUMNS
from experiments.hexapod.compensator import Loop
from experiments.hexapod.simulation import controller_for, fly, track_spiral
from experiments.hexapod.testbed import Bench
from ftc.controller import Sensed
from sim import Plant, Pose

GOAL = COLUMNS[0].goal
"""W_a, all struts sound."""
_BEFORE_S = 0.2
_CALLS, _SAMPLES = 32, 5


@dataclass(frozen=True)
class Flight:
    """The run that is timed.

    Attributes:
        model: The machine.
        bench: Constants around it.
        loops: Compensators.
        seconds: Of the spiral; settling comes before it.
        seed: Of the detector noise.
    """

    model: mujoco.MjModel
    bench: Bench
    loops: tuple[Loop, Loop]
    seconds: float
    seed: int

    @property
    def ticks(self) -> int:
        """Of control."""
        return len(self.bench.time_s(self.seconds))

    @property
    def steps(self) -> int:
        """Of physics, those of settling too."""
        return round((self.bench.settling_s + self.seconds) / self.model.opt.timestep)

    def run(self, jacobian: JacobianChoice) -> None:
        """The whole closed loop, its log kept in memory."""
        track_spiral(
            self.model,
            self.bench,
            self.loops,
            GOAL,
            jacobian=jacobian,
            seed=self.seed,
            duration_s=self.seconds,
        )

    def step(self) -> None:
        """MuJoCo alone, in one call."""
        mujoco.mj_step(self.model, mujoco.MjData(self.model), self.steps)


def whole(flight: Flight) -> list[Contender]:
    """Times per control tick: bare physics, and the loop with either Jacobian."""
    return [
        Contender("mj_step", flight.step, lambda: [()], flight.ticks),
        Contender("closed_loop", flight.run, lambda: [("analytic",)], flight.ticks),
        Contender("closed_loop_constant", flight.run, lambda: [("constant",)], flight.ticks),
    ]


def parts(flight: Flight) -> list[Contender]:
    """Times per control tick of what a tick is made of, each alone, in the midst of a flight."""
    model, bench = flight.model, flight.bench
    controller = controller_for(model, bench, flight.loops, GOAL)
    _, state = fly(model, bench, controller, seed=flight.seed, duration_s=_BEFORE_S)
    mapping, amplifier = controller.mapping, controller.amplifier
    sent_m, asked_rad = amplifier.displacement_m(state.input_percent), state.asked.pointing_rad
    detector, strut_sensors = bench.detector(), bench.strut_sensors()
    rng, plant, bare = np.random.default_rng(flight.seed), Plant(model), mujoco.MjData(model)
    period_s = bench.control_period_s
    # Without whatever the estimate has worked out beside it.
    bare_pose = Pose(state.pose.rotation, state.pose.translation_m)

    def sense() -> Sensed:
        plant.closure_residual_m()
        return Sensed(
            pointing_rad=detector.read(plant.pose().rotation, rng),
            strut_m=strut_sensors.read(plant.strut_displacement_m(), rng),
        )

    calls = {
        "part_mj_step": (mujoco.mj_step, model, bare, round(period_s / model.opt.timestep)),
        "part_plant_step": (plant.step, sent_m, period_s),
        "part_sensors": (sense,),
        "part_controller": (controller.step, state, asked_rad, sense()),
        "part_estimate": (mapping.estimate, sent_m, state.pose),
        "part_mapping": (mapping.displacements, asked_rad, state.pose),
        "part_jacobian": (mapping.geometry.inverse_jacobian, bare_pose),
        "part_converter": (amplifier.input_percent, sent_m),
    }
    return [_part(name, *call) for name, call in calls.items()]


def _part(name: str, call: Callable[..., Any], *arguments: Any) -> Contender:
    return Contender(name, call, lambda: [arguments] * _CALLS, samples=_SAMPLES)
