"""All runs of the study, side by side on the machine's cores."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

from experiments.limits.arm import ArmRun, Motion, move
from experiments.limits.spirals import BENCH, TURN_S, Case, track
from experiments.limits.strategies import Strategy, arm_strategies, loop_strategies
from experiments.rig.hexapod.controller import nominal_loops
from experiments.rig.hexapod.simulation import Trajectory
from experiments.rig.hexapod.testbed import Testbed
from experiments.study.parallel import in_parallel
from sim import load_model


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
    spirals: dict[Case, Trajectory]
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


def run_limits(
    *, seed: int, quick: bool, on_progress: Callable[[int, int], None] = lambda done, total: None
) -> LimitsRuns:
    """Run the spirals and the arm.

    Raises:
        sim.SimulationDiverged: The physics left the finite numbers.
    """
    model = load_model()
    testbed = Testbed(model, BENCH, nominal_loops(model, BENCH))
    spirals = cases(seed, quick=quick)
    motions = [Motion(each, 16.0 if quick else 40.0) for each in arm_strategies(quick)]
    calls = [{"testbed": testbed, "one": one} for one in (*motions, *spirals)]
    ran = in_parallel(simulate, calls, on_progress)
    moved = dict(zip([motion.strategy for motion in motions], ran, strict=False))
    return LimitsRuns(seed, testbed, dict(zip(spirals, ran[len(motions) :], strict=True)), moved)


def simulate(testbed: Testbed, one: Case | Motion) -> Trajectory | ArmRun:
    """One run of the hexapod or the arm."""
    return track(testbed, one) if isinstance(one, Case) else move(one)
