"""How the hexapod's controller pursues a secondary goal: by the mapping, or by a pseudo-inverse."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from experiments.goals.demonstration import Strategy
from experiments.goals.secondary_goals import REWEIGH_TICKS, joint_weights
from experiments.rig.compromise import CompromisingMapping
from experiments.rig.hexapod.controller import StrutMapping
from experiments.rig.hexapod.testbed import Testbed
from experiments.rig.options import JacobianChoice
from ftc.controller import Measurement, PrioritizedController
from ftc.goal import Goal
from ftc.oracle import NestedState
from sim import Amplifier, Array, Coils, Hexapod, Pose, hexapod, pointing_angles


class PseudoInverseMapping(CompromisingMapping[Pose], StrutMapping):
    """The strut mapping with a weighted pseudo-inverse."""

    def __init__(
        self, geometry: Hexapod, goal: Goal, jacobian: JacobianChoice, major_weight: float
    ) -> None:
        """As the strut mapping; `major_weight` weighs [rad] of pointing."""
        self.major_weight = major_weight
        super().__init__(geometry, goal, jacobian)


def controllers(testbed: Testbed, strategy: Strategy) -> Callable[[Goal], PrioritizedController]:
    """The controller of this machine for any goal, through the mapping of the strategy.

    The Jacobian is constant: within the stroke that costs pointing less than noise does.
    """
    geometry, amplifier = hexapod(testbed.model), testbed.amplifier()

    def controller(goal: Goal) -> PrioritizedController:
        if strategy.major_weight is None:
            mapping = StrutMapping(geometry, goal, "constant")
        else:
            mapping = PseudoInverseMapping(geometry, goal, "constant", strategy.major_weight)
        return PrioritizedController(testbed.loops, mapping, amplifier, testbed.bench.handover_s)

    return controller


def unrolled(measurement: Measurement, pose: Pose) -> Measurement:
    """What the detector would read if the payload had not rolled.

    The detector turns with the payload: off the axis, a roll about it moves the spot although
    the pointing stays. What it reads and what is pointed at are compared at the estimated pose.
    """
    read, pointed = -pointing_angles(pose.rotation.T), pointing_angles(pose.rotation)
    return Measurement(measurement.output - read + pointed, measurement.displacement)


StrutRates = Callable[[Array, Pose], Array]
"""Desired strut rates (6,), theta_ad of eq. (24), [m]/[s], where the struts are commanded to be
(6,) and the payload is estimated to be."""


def no_rates(displacements_m: Array, pose: Pose) -> Array:
    """No secondary goal."""
    return np.zeros_like(displacements_m)


@dataclass(frozen=True)
class SeekerState(NestedState):
    """Beside it, the desired strut rates integrated so far, shape (6,)."""

    secondary_reference: Array


@dataclass(frozen=True)
class Seeker:
    """Points, and follows desired strut rates as far as pointing leaves the struts free."""

    controller: PrioritizedController
    rates: StrutRates
    period_s: float

    def start(self) -> SeekerState:
        """At rest at the nominal pose."""
        return SeekerState(self.controller.start(), np.zeros(6))

    def step(self, state: SeekerState, reference: Array, measurement: Measurement) -> SeekerState:
        """One control tick."""
        commanded_m = self.controller.drives.displacements(state.inputs)
        moved_m = self.period_s * self.rates(commanded_m, state.pose)
        reference_m = state.secondary_reference + moved_m
        seen = unrolled(measurement, state.pose)
        controller = self.controller.step(state.controller, reference, seen, reference_m)
        return SeekerState(controller, reference_m)


@dataclass(frozen=True)
class ReweighedState(NestedState):
    """Beside it, coil temperatures by the controller's own model (6,), and the present weights."""

    temperature_c: Array
    steering: PrioritizedController
    ticks: int


@dataclass(frozen=True)
class Reweighing:
    """Points, with weights on the struts that follow the coils' temperatures.

    It estimates them from the currents that it sends, with a thermal model of its own.
    """

    controller_for: Callable[[Goal], PrioritizedController]
    coils: Coils
    amplifier: Amplifier
    period_s: float

    def start(self) -> ReweighedState:
        """At rest at the nominal pose, coils cold."""
        cold = self.coils.cold()
        steering = self._weighted(cold)
        return ReweighedState(steering.start(), cold, steering, ticks=0)

    def step(
        self, state: ReweighedState, reference: Array, measurement: Measurement
    ) -> ReweighedState:
        """One control tick."""
        steering = state.steering
        current_a = self.amplifier.current_a(state.inputs)
        temperature_c = self.coils.step(state.temperature_c, current_a, self.period_s)
        if state.ticks % REWEIGH_TICKS == 0:
            steering = self._weighted(temperature_c)
        seen = unrolled(measurement, state.pose)
        controller = steering.step(state.controller, reference, seen)
        return ReweighedState(controller, temperature_c, steering, state.ticks + 1)

    def _weighted(self, temperature_c: Array) -> PrioritizedController:
        return self.controller_for(Goal(joint_weight=tuple(joint_weights(temperature_c))))
