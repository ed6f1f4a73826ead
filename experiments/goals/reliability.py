"""Reliability on the fly: weights that follow the temperatures of the coils."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from experiments.goals.demonstration import Demonstration, Outcome, Way, smooth_step
from experiments.goals.off_axis import (
    JUDGED_FROM_S,
    Seeker,
    controllers,
    no_rates,
    off_axis_path,
    outcome,
    unrolled,
)
from experiments.hexapod.compensator import Loop
from experiments.hexapod.goal import Goal
from experiments.hexapod.pilot import PointingState
from experiments.hexapod.simulation import fly
from experiments.hexapod.testbed import Bench
from ftc.controller import Controller, Sensed
from sim import Amplifier, Array, Coils, load_model

TARGET_URAD = (2771.0, 1600.0)
"""3.2 mrad off the axis, where struts 1 and 4 do most of the work: 84 % of their current."""

COILS = Coils(
    resistance_ohm=5.0,
    heat_capacity_j_per_k=4.0,
    thermal_resistance_k_per_w=np.array([2.2, 1.5, 1.5, 1.5, 1.5, 1.5]),
    ambient_c=20.0,
)
"""80 W at full current, and 10 g of copper: a light winding, with a time constant of 6 s, so that
16 s are long. Strut 1 has lost a third of its path to the ambient."""

LIMIT_C = 90.0
WARM_C = 60.0
"""Where a weight begins to rise; it reaches `HEAVIEST` at the limit."""
HEAVIEST = 10.0
REWEIGH_TICKS = 10
"""Between two changes of the weights: 10 ms. At 20 ms their steps begin to show in the pointing."""


def joint_weights(temperature_c: Array) -> Array:
    """Diagonal of W1 for coils that are so hot, shape (6,): a smooth step from 1 to HEAVIEST."""
    return 1.0 + (HEAVIEST - 1.0) * smooth_step((temperature_c - WARM_C) / (LIMIT_C - WARM_C))


@dataclass(frozen=True)
class ReweighedState(PointingState):
    """What is remembered beside the state of the pointing loops.

    Attributes:
        temperature_c: Of the coils, by the controller's own thermal model, shape (6,).
        steering: The controller with the present weights.
        ticks: How many there have been.
    """

    temperature_c: Array
    steering: Controller
    ticks: int


@dataclass(frozen=True)
class Reweighing:
    """Points, with weights on the struts that follow the coils' temperatures.

    It knows them from the currents that it sends and a thermal model of its own.

    Attributes:
        controller_for: The controller for a goal.
        coils: The thermal model.
        amplifier: The converters that it drives.
        period_s: Control period.
    """

    controller_for: Callable[[Goal], Controller]
    coils: Coils
    amplifier: Amplifier
    period_s: float

    def start(self) -> ReweighedState:
        """At rest at the nominal pose, coils cold."""
        cold = self.coils.cold()
        steering = self._weighted(cold)
        return ReweighedState(steering.start(), cold, steering, ticks=0)

    def step(self, state: ReweighedState, desired_rad: Array, sensed: Sensed) -> ReweighedState:
        """One control tick."""
        steering = state.steering
        current_a = self.amplifier.current_a(state.input_percent)
        temperature_c = self.coils.step(state.temperature_c, current_a, self.period_s)
        if state.ticks % REWEIGH_TICKS == 0:
            steering = self._weighted(temperature_c)
        seen = unrolled(sensed, state.pose)
        controller = steering.step(state.controller, desired_rad, seen)
        return ReweighedState(controller, temperature_c, steering, state.ticks + 1)

    def _weighted(self, temperature_c: Array) -> Controller:
        return self.controller_for(Goal(joint_weight=tuple(joint_weights(temperature_c))))


def run(way: Way, duration_s: float, loops: tuple[Loop, Loop]) -> Outcome:
    """One search around the target."""
    model, bench = load_model(), Bench()
    controller_for = controllers(model, bench, loops, way)
    cold, period_s = controller_for(Goal(joint_weight=(1.0,) * 6)), bench.control_period_s
    path = off_axis_path(bench, TARGET_URAD, duration_s)
    if way.pursues:
        pilot = Reweighing(controller_for, COILS, cold.amplifier, period_s)
        flown, _ = fly(model, bench, pilot, desired_rad=path, seed=way.seed)
    else:
        pilot = Seeker(cold, no_rates, period_s)
        flown, _ = fly(model, bench, pilot, desired_rad=path, seed=way.seed)
    current_a = cold.amplifier.current_a(flown.strut_input_percent)
    temperature_c = COILS.temperatures_c(current_a, period_s)
    return outcome(flown, temperature_c.max(axis=1), temperature_c=temperature_c)


DEMONSTRATION = Demonstration(
    name="reliability",
    title="Reliability on the fly",
    machine="fjh",
    angles=("alpha", "beta"),
    measure="hottest_coil_c",
    limit=LIMIT_C,
    keeps_below=True,
    judged_from_s=JUDGED_FROM_S,
    duration_s=16.0,
    quick_duration_s=8.0,
    settings={
        "target_urad": TARGET_URAD,
        "resistance_ohm": COILS.resistance_ohm,
        "heat_capacity_j_per_k": COILS.heat_capacity_j_per_k,
        "thermal_resistance_k_per_w": COILS.thermal_resistance_k_per_w.tolist(),
        "ambient_c": COILS.ambient_c,
        "warm_c": WARM_C,
        "heaviest_weight": HEAVIEST,
        "reweigh_ticks": REWEIGH_TICKS,
    },
    run=run,
)
