"""One failure on the spiral: a supervised controller beside an informed and a fault-unaware one."""

from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np

from experiments.hexapod.controller import controller_for
from experiments.hexapod.fault_tolerance import (
    HEAVE,
    fault_of,
    supervisor,
)
from experiments.hexapod.metrics import closure_residual_max_m
from experiments.hexapod.other_controller import track_with
from experiments.hexapod.simulation import Trajectory, track_path
from experiments.hexapod.testbed import Testbed, TestbedConfig
from ftc.controller import PrioritizedController
from ftc.fdi.diagnosis import Diagnosis
from ftc.fdi.dither import Dither
from ftc.fdi.fault_model import KINDS, Fault, FaultKind
from ftc.goal import Goal
from ftc.oracle import NEVER, OracleController
from ftc.supervisor import reconfigured_goal
from sim import Array, Failure

GOAL = Goal(joint_weight=(1.0,) * 6)
"""W_a, under which antipodal struts look alike."""

DITHER = Dither(0.5e-6, 20.0, HEAVE)
"""A strut that fails is then seen at 1.2 urad, four times the detector's noise. Its frequency is
above the loops' crossovers, so that they do not suppress it; below the modes from 32 Hz on, where
the linear model would have to be more exact; and high enough for inertia to move a free strut."""

BEFORE_S, AFTER_S = 1.2, 2.5
"""Of each run, before and after the failure; the first half second, a transient, is not counted."""

RECOVERED_S = 0.5
"""After the failure: what counts as recovery begins here."""

STRUCK = round(BEFORE_S / TestbedConfig().control_period_s)
"""Tick of the failure in each run."""

_TRANSIENT_S = 0.5
_EARLIEST_S, _LATEST_S = 1.5, 13.4
_STANDING_M = 10e-6
_EFFECTIVENESS = 0.2, 0.8
_EACH: list[tuple[FaultKind, int]] = [(kind, strut) for strut in range(6) for kind in KINDS]


def controller(testbed: Testbed, goal: Goal = GOAL) -> PrioritizedController:
    """A controller for a goal, with the constant Jacobian."""
    return controller_for(testbed, goal, jacobian="constant")


@dataclass(frozen=True)
class Scenario:
    """One failure on the spiral.

    Attributes:
        fault: What fails.
        time_s: On the spiral.
        secondary_reference_m: Secondary displacement at which the struts stand, shape (6,).
        seed: Of the sensors' noise.
    """

    fault: Fault
    time_s: float
    secondary_reference_m: tuple[float, ...]
    seed: int

    @property
    def run(self) -> dict[str, Any]:
        """Options of a simulated run: what fails, and which part of the spiral it is."""
        fault = self.fault
        failure = Failure(fault.actuator, fault.kind, self.time_s, fault.effectiveness)
        begin_s, duration_s = self.time_s - BEFORE_S, BEFORE_S + AFTER_S
        span = {"begin_s": begin_s, "duration_s": duration_s}
        return {"failures": (failure,), "seed": self.seed} | span

    def dither(self, about: Dither) -> Dither:
        """The dither, about where the struts stand."""
        return replace(about, offset=self.secondary_reference_m)


def draw(seed: int, number: int) -> list[Scenario]:
    """Each strut and kind in turn, at random times on the spiral, in random postures."""
    rng = np.random.default_rng([seed, 2])
    drawn = []
    for kind, strut in (_EACH[k % len(_EACH)] for k in range(number)):
        # Whole control periods, so that all runs of a scenario are sampled alike.
        time_s = round(float(rng.uniform(_EARLIEST_S, _LATEST_S)), 3)
        secondary_reference_m = tuple(rng.normal(scale=_STANDING_M, size=6).tolist())
        noise = int(rng.integers(2**32))
        left = float(rng.uniform(*_EFFECTIVENESS)) if kind == "weak" else 0.0
        drawn.append(Scenario(Fault(strut, kind, left), time_s, secondary_reference_m, noise))
    return drawn


@dataclass(frozen=True)
class Identification:
    """What a supervised controller made of a run.

    Attributes:
        failures: What happened, in the order of time.
        struck: Tick of the first failure; ticks count from the start of the run.
        diagnoses: All of them, in order.
        standing: Those that stand in the end.
        false_alarm: Whether there was an alarm before the first failure.
        unexplained: Whether an alarm was given up.
        task_lost: Whether the controller declared the task lost.
        lost_rightly: Whether the failure atlas says so of what did happen.
        closure_residual_max_m: Of the run.
    """

    failures: tuple[Failure, ...]
    struck: int
    diagnoses: tuple[Diagnosis, ...]
    standing: tuple[Diagnosis, ...]
    false_alarm: bool
    unexplained: bool
    task_lost: bool
    lost_rightly: bool
    closure_residual_max_m: float

    @property
    def first(self) -> Diagnosis | None:
        """The first diagnosis after the failure."""
        return next((each for each in self.diagnoses if each.tick >= self.struck), None)

    @property
    def strut_right(self) -> bool:
        """Whether the strut was right as first named, without a false alarm before."""
        named = self.first is not None and self.first.fault.actuator == self.failures[0].actuator
        return named and not self.false_alarm

    @property
    def all_right(self) -> bool:
        """Whether each failure was found, and no other, and the loss of the task if it is lost."""
        happened = sorted((failure.actuator, failure.kind) for failure in self.failures)
        found = sorted((each.fault.actuator, each.fault.kind) for each in self.standing)
        return happened == found and self.task_lost == self.lost_rightly

    @property
    def right(self) -> bool:
        """The same, without a false alarm before."""
        return self.all_right and not self.false_alarm


def diagnose(
    testbed: Testbed,
    run: dict[str, Any],
    dither: Dither = DITHER,
    plant: mujoco.MjModel | None = None,
    **options: Any,
) -> tuple[Trajectory, Identification]:
    """Simulate a run, options of `track_path`, with a supervised controller.

    `plant` is the machine, if it is not quite the model; the rest are options of `supervisor`.
    """
    pilot = supervisor(testbed, GOAL, dither=dither, **options)
    machine = replace(testbed, inexact=plant)
    trajectory, state = track_path(machine, pilot, **run)
    failures = run["failures"]
    struck = round((failures[0].time_s - run["begin_s"]) / testbed.bench.control_period_s)
    return trajectory, Identification(
        failures=failures,
        struck=struck,
        diagnoses=state.diagnoses,
        standing=tuple(state.standing),
        false_alarm=any(tick < struck for tick in state.watch.alarm_ticks),
        unexplained=state.watch.unexplained,
        task_lost=state.task_lost,
        lost_rightly=not pilot.is_possible([fault_of(failure) for failure in failures]),
        closure_residual_max_m=closure_residual_max_m(trajectory),
    )


def identify(
    testbed: Testbed, scenario: Scenario, dither: Dither = DITHER, **options: Any
) -> tuple[Trajectory, Identification]:
    """The same for a scenario, with the dither about where its struts stand."""
    return diagnose(testbed, scenario.run, scenario.dither(dither), **options)


def fault_unaware(testbed: Testbed, scenario: Scenario) -> Trajectory:
    """The same run by a controller that goes on as if nothing had happened."""
    pilot = controller(testbed)
    unaware = OracleController(pilot, pilot, NEVER, secondary=scenario.dither(DITHER).at)
    return track_path(testbed, unaware, **scenario.run)[0]


def informed(
    testbed: Testbed, scenario: Scenario, fault: Fault, displacement_m: float, late_s: float = 0.0
) -> Trajectory:
    """The same run by a controller that is informed of a fault so long after the failure.

    `displacement_m` is where that strut has stuck, which is the same in all runs of a scenario.
    """
    tick = STRUCK + round(late_s / testbed.bench.control_period_s)
    news = Diagnosis.told(fault, displacement_m)
    after = controller(testbed, reconfigured_goal(GOAL, [news]))
    lost_displacement_m = np.zeros(6)
    if fault.kind != "locked" and late_s == 0:
        lost_displacement_m[fault.actuator] = (1 - fault.effectiveness) * displacement_m
    pilot = OracleController(
        controller(testbed), after, tick, lost_displacement_m, scenario.dither(DITHER).at
    )
    return track_path(testbed, pilot, **scenario.run)[0]


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


@dataclass(frozen=True)
class Recovery:
    """One scenario: the identification, and the errors of the three controllers.

    Where another controller is compared, its errors are `other`, and `failure` a sentence if it
    failed.
    """

    scenario: Scenario
    found: Identification
    supervised: Errors
    informed: Errors
    uncorrected: Errors
    other: Errors | None = None
    failure: str | None = None


def recover(testbed: Testbed, scenario: Scenario, controller_name: str | None = None) -> Recovery:
    """Simulate a scenario three times, and once more with another controller."""
    run, found = identify(testbed, scenario)
    unaware = fault_unaware(testbed, scenario)
    displacement_m = float(unaware.strut_displacement_m[STRUCK, scenario.fault.actuator])
    oracle = informed(testbed, scenario, scenario.fault, displacement_m)
    ours = errors(run), errors(oracle), errors(unaware)
    if controller_name is None:
        return Recovery(scenario, found, *ours)
    theirs, failure = track_with(testbed, controller_name, GOAL, **scenario.run)
    return Recovery(scenario, found, *ours, errors(theirs), failure)
