"""The hexapod searching around a target off its axis: the run that three demonstrations share."""

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace

import mujoco
import numpy as np

from experiments.goals.demonstration import Outcome, Way, smooth_step
from experiments.goals.pseudo_inverse import PseudoInverseMapping
from experiments.hexapod.compensator import Loop
from experiments.hexapod.goal import Goal
from experiments.hexapod.mapping import StrutMapping
from experiments.hexapod.metrics import closure_residual_max_m
from experiments.hexapod.pilot import PointingState
from experiments.hexapod.simulation import Trajectory
from experiments.hexapod.testbed import Bench
from ftc.controller import Controller, Sensed
from sim import Amplifier, Array, Pose, hexapod, pointing_angles

SLEW_S = 3.0
"""From the axis to the target."""
JUDGED_FROM_S = SLEW_S + 0.5
"""The slew's own error has died away by then: twenty time constants of the slower loop."""


def off_axis_path(bench: Bench, target_urad: tuple[float, float], duration_s: float) -> Array:
    """A slew to the best known position of the target, then the bench's spiral there, (N, 2)."""
    time_s = bench.time_s(duration_s)
    path = smooth_step(time_s / SLEW_S)[:, None] * 1e-6 * np.array(target_urad)
    searching = time_s >= SLEW_S
    search = replace(bench, duration_s=duration_s - SLEW_S)
    path[searching] += search.desired_rad(time_s[searching] - SLEW_S)
    return path


def controllers(
    model: mujoco.MjModel, bench: Bench, loops: tuple[Loop, Loop], way: Way
) -> Callable[[Goal], Controller]:
    """The controller of this machine for any goal, through the mapping of the way.

    The Jacobian is constant: within the stroke that costs pointing less than noise does.
    """
    geometry = hexapod(model)
    amplifier = bench.amplifier(newton_per_m=float(model.actuator_gainprm[0, 0]))

    def controller(goal: Goal) -> Controller:
        if way.major_weight is None:
            mapping = StrutMapping(geometry, goal, "constant")
        else:
            mapping = PseudoInverseMapping(geometry, goal, "constant", way.major_weight)
        return Controller(loops, mapping, amplifier, bench.handover_s)

    return controller


def unrolled(sensed: Sensed, pose: Pose) -> Sensed:
    """What the detector would read if the payload had not rolled.

    The detector turns with the payload: off the axis, a roll about it moves the spot although
    the pointing stays. What it reads and what is pointed at are compared at the estimated pose.
    """
    reading = -pointing_angles(pose.rotation.T)
    return replace(
        sensed, pointing_rad=sensed.pointing_rad - reading + pointing_angles(pose.rotation)
    )


StrutRates = Callable[[Array, Pose], Array]
"""Desired strut rates (6,), theta_ad of eq. (24), [m]/[s], where the struts are commanded to be
(6,) and the payload is estimated to be."""


def no_rates(displacements_m: Array, pose: Pose) -> Array:
    """No secondary goal."""
    return np.zeros_like(displacements_m)


@dataclass(frozen=True)
class SeekerState(PointingState):
    """Beside it, the desired strut rates integrated so far, shape (6,)."""

    rest_m: Array


@dataclass(frozen=True)
class Seeker:
    """Points, and follows desired strut rates as far as pointing leaves the struts free.

    Attributes:
        controller: Of the pointing loops.
        rates: The secondary goal.
        period_s: Control period.
    """

    controller: Controller
    rates: StrutRates
    period_s: float

    @property
    def amplifier(self) -> Amplifier:
        """That of the controller."""
        return self.controller.amplifier

    def start(self) -> SeekerState:
        """At rest at the nominal pose."""
        return SeekerState(self.controller.start(), np.zeros(6))

    def step(self, state: SeekerState, desired_rad: Array, sensed: Sensed) -> SeekerState:
        """One control tick."""
        sent_m = self.amplifier.displacement_m(state.input_percent)
        rest_m = state.rest_m + self.period_s * self.rates(sent_m, state.pose)
        seen = unrolled(sensed, state.pose)
        return SeekerState(
            self.controller.step(state.controller, desired_rad, seen, rest_m), rest_m
        )


def outcome(flown: Trajectory, measure: Array, **arrays: Array) -> Outcome:
    """A run with its secondary measure (N,), and further arrays to keep."""
    return Outcome(
        time_s=flown.time_s,
        error_rad=flown.desired_rad - flown.true_rad,
        measure=measure,
        closure_residual_max_m=closure_residual_max_m(flown),
        arrays={name: each for name, each in asdict(flown).items() if name != "time_s"} | arrays,
    )
