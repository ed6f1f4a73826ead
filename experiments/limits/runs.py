"""The hexapod on a spiral that leaves what stroke and coil current allow, and the arm.

All runs go side by side on the machine's cores.
"""

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from experiments.limits.allocation import (
    UNLIMITED,
    AllocatedMapping,
    Strategy,
    arm_strategies,
    loop_strategies,
)
from experiments.limits.arm import ArmRun, Motion, move
from experiments.limits.conventional import Limits
from experiments.rig.hexapod.columns import MAJOR
from experiments.rig.hexapod.controller import StrutMapping
from experiments.rig.hexapod.rig import hexapod_rig, nominal_testbed
from experiments.rig.hexapod.testbed import Testbed, TestbedConfig
from experiments.rig.run import Run
from experiments.study.parallel import in_parallel
from experiments.study.study import OnProgress
from ftc.controller import ControllerState, Measurement, PrioritizedController
from ftc.goal import Goal
from prioritized import ConstrainedSystem
from sim import NOMINAL, Array, Failure, Pose, displacement_limits, hexapod

BENCH = replace(TestbedConfig(), detector_half_width_m=10e-3)
"""The spiral is 40 times larger than that of Table I; the detector must see it."""
RADIUS_RAD = 4e-3
TURN_S = 4.0
REST_S = 1.0
"""At the end of a run, at the centre."""
LEAD_IN_S = 0.5
"""Until the other struts have made up for the one that is stuck, before the run."""
CURRENT_LIMIT_A = np.array([4.0005, 2.0, 4.0005, 4.0005, 2.0, 4.0005])
"""Coils 2 and 5 are hot; of the others the stroke is the limit."""
STUCK_M = 317.5e-6
"""Half the stroke, at which strut 1 is stuck, known to the mapping."""
HEAVE_M = 250e-6
"""Secondary goal: all struts longer by as much, the payload raised."""
LONGER = 3.0
"""Stroke of the machine without limits, in strokes of the hexapod."""


@dataclass(frozen=True)
class Case:
    """One run; `heave` is whether the payload shall be raised."""

    stuck: bool
    heave: bool
    strategy: Strategy
    seed: int
    duration_s: float
    turn_s: float

    @property
    def condition(self) -> str:
        """Without the strategy, as in `limits.json`."""
        return f"{'stuck' if self.stuck else 'sound'}{'_heave' if self.heave else ''}"

    @property
    def name(self) -> str:
        """As in `limits.json`."""
        return f"{self.condition}_{self.strategy.name}"

    @property
    def locked_at(self) -> dict[int, float]:
        """As in :class:`ftc.goal.Goal`."""
        return {0: STUCK_M} if self.stuck else {}


@dataclass(frozen=True)
class Raising:
    """The controller with a constant secondary goal."""

    controller: PrioritizedController[Pose]
    reference_m: Array

    def start(self) -> ControllerState[Pose]:
        """At rest at the nominal pose."""
        return self.controller.start()

    def step(
        self, state: ControllerState[Pose], reference: Array, measurement: Measurement
    ) -> ControllerState[Pose]:
        """One control tick."""
        return self.controller.step(state, reference, measurement, self.reference_m)


def path_rad(case: Case) -> Array:
    """Desired (alpha, beta): out until halfway, back, and at rest, shape (N, 2)."""
    time_s = BENCH.time_s(case.duration_s)
    radius = RADIUS_RAD * np.sin(np.pi * (time_s / (case.duration_s - REST_S)).clip(0, 1)) ** 2
    turned = 2 * np.pi * time_s / case.turn_s
    return np.stack([radius * np.cos(turned), radius * np.sin(turned)], axis=1)


def limits_of(testbed: Testbed) -> Limits:
    """Displacements that stroke and current allow the struts."""
    return displacement_limits(testbed.model, testbed.amplifier(), CURRENT_LIMIT_A)


def attainable(testbed: Testbed, case: Case) -> Array:
    """Corners of the attainable pointing [rad], a stuck strut where it is, shape (k, 2)."""
    lower, upper = (each.copy() for each in limits_of(testbed))
    for strut, stands_m in case.locked_at.items():
        lower[strut] = upper[strut] = stands_m
    J = np.linalg.inv(hexapod(testbed.model).inverse_jacobian(NOMINAL))
    kinematics = ConstrainedSystem(J, None, range(len(lower))).kinematics()
    return kinematics.attainable(MAJOR, (lower, upper)).vertices


def track(testbed: Testbed, case: Case) -> Run:
    """What happens in one case.

    Raises:
        sim.SimulationDiverged: The physics left the finite numbers.
    """
    strategy, struts = case.strategy, len(CURRENT_LIMIT_A)
    geometry, limits = hexapod(testbed.model), limits_of(testbed)
    if strategy == UNLIMITED:
        testbed = testbed.scaled(stroke=LONGER)
        goal = Goal(joint_weight=(1.0,) * struts, locked_at=case.locked_at)
        mapping = StrutMapping(geometry, goal, "constant")
    else:
        mapping = AllocatedMapping(geometry, case.locked_at, limits, strategy)
    controller = PrioritizedController(
        testbed.loops,
        mapping,
        testbed.amplifier(),
        testbed.bench.handover_s,
        anti_windup=strategy.anti_windup,
        tracking_slowness=strategy.slowness if strategy.anti_windup else 1.0,
    )
    start_m = np.zeros(struts)
    for strut, stands_m in case.locked_at.items():
        start_m[strut] = stands_m
    raised_m = np.full(struts, HEAVE_M if case.heave else 0.0)
    return hexapod_rig(testbed, start_m=start_m).fly(
        Raising(controller, raised_m),
        path_rad(case),
        failures=[Failure(strut, "locked") for strut in case.locked_at],
        seed=case.seed,
        lead_in_s=LEAD_IN_S,
    )


@dataclass(frozen=True)
class LimitsRuns:
    """What was simulated.

    Attributes:
        seed: Of the detector noise.
        testbed: The hexapod with its limits.
        spirals: Of the hexapod.
        arm: Of the arm, by strategy.
    """

    seed: int
    testbed: Testbed
    spirals: dict[Case, Run]
    arm: dict[Strategy, ArmRun]


def cases(seed: int, *, quick: bool) -> list[Case]:
    """The spirals."""
    duration_s, turn_s = (3.0, TURN_S / 2) if quick else (9.0, TURN_S)
    conditions = product((False, True), (True,) if quick else (False, True))
    return [
        Case(stuck, heave, strategy, seed, duration_s, turn_s)
        for stuck, heave in conditions
        for strategy in loop_strategies(quick)
    ]


def run_limits(*, seed: int, quick: bool, on_progress: OnProgress) -> LimitsRuns:
    """Run the spirals and the arm.

    Raises:
        sim.SimulationDiverged: The physics left the finite numbers.
    """
    testbed = nominal_testbed(BENCH)
    spirals = cases(seed, quick=quick)
    motions = [Motion(each, 16.0 if quick else 40.0) for each in arm_strategies(quick)]
    calls = [{"testbed": testbed, "one": one} for one in (*motions, *spirals)]
    ran = in_parallel(simulate, calls, on_progress)
    moved = dict(zip([motion.strategy for motion in motions], ran, strict=False))
    return LimitsRuns(seed, testbed, dict(zip(spirals, ran[len(motions) :], strict=True)), moved)


def simulate(testbed: Testbed, one: Case | Motion) -> Run | ArmRun:
    """One run of the hexapod or the arm."""
    return track(testbed, one) if isinstance(one, Case) else move(one)
