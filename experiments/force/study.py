"""The force mapping's answers, and what the gauges of the simulation say of them."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from experiments.force.answers import Answer, answer, told
from experiments.force.cases import (
    GOALS,
    PRESCRIBED,
    STRUTS,
    Aims,
    Condition,
    ForceGoal,
    conditions,
    draw_aims,
)
from experiments.force.overactuated import InternalForce, use_internal_force
from experiments.force.prescribed import Held, elastic_torques, hold_prescribed
from experiments.force.rig import Readings, hold, press, with_fixture
from experiments.force.tradeoff import Tradeoff, trade
from experiments.output.parallel import in_parallel
from sim import HEXAPOD_MJCF, weightless

DRAWS = 4


@dataclass(frozen=True)
class Trial:
    """One condition under one goal; one load for each aim.

    Attributes:
        answer: The mapping's.
        pressed: Against the fixture.
        held: Without it, against the wrench that the mapping exerts.
    """

    answer: Answer
    pressed: Readings
    held: Readings


@dataclass(frozen=True)
class Examination:
    """One condition of the hexapod.

    Attributes:
        condition: What was broken.
        trials: By goal.
        prescribed: All that was asked for, held by the rigid mapping's torques, and with a free
            strut by the elastic one's; not tried on a strut that no spring holds.
    """

    condition: Condition
    trials: tuple[Trial, ...]
    prescribed: tuple[Held, ...]

    def trial(self, goal: ForceGoal) -> Trial:
        """The one under a goal."""
        return next(trial for trial in self.trials if trial.answer.goal == goal)


@dataclass(frozen=True)
class Force:
    """All of the experiment.

    Attributes:
        aims: What was asked for in every condition.
        examinations: By condition.
        tradeoff: The mapping beside other torques.
        internal: The over-actuated platform.
    """

    aims: Aims
    examinations: list[Examination]
    tradeoff: Tradeoff
    internal: tuple[InternalForce, ...]


def run_force(
    *, seed: int, quick: bool, on_progress: Callable[[int, int], None] = lambda done, total: None
) -> Force:
    """Examine every condition, side by side on the machine's cores.

    Args:
        seed: Of the directions of all forces.
        quick: Only strut 1 fails.
        on_progress: Called with finished and total number of examinations.

    Raises:
        sim.SimulationDiverged: The physics left the finite numbers.
    """
    rng = np.random.default_rng(seed)
    aims = draw_aims(rng, DRAWS)
    tradeoff = trade(aims, rng)
    internal = use_internal_force(rng, DRAWS)
    calls = [
        {"condition": condition, "aims": aims} for condition in conditions(1 if quick else STRUTS)
    ]
    return Force(aims, in_parallel(examine, calls, on_progress), tradeoff, internal)


def examine(condition: Condition, aims: Aims) -> Examination:
    """Ask the mapping, then press and hold with its torques.

    On the ground, where the preload carries the weight; a strut that loses its spring loses its
    preload too, and is looked at in orbit.
    """
    model, system = with_fixture(HEXAPOD_MJCF), told(condition)
    if condition.kind == "loose":
        model = weightless(model)

    def trial(goal: ForceGoal) -> Trial:
        said = answer(system, goal, aims)
        return Trial(
            said,
            press(model, condition.failures, said.torques),
            hold(model, condition.failures, said.torques, said.wrench),
        )

    examined = Examination(condition, tuple(trial(goal) for goal in GOALS), prescribed=())
    if condition.kind == "loose":
        return examined
    torques = {"rigid": examined.trial(PRESCRIBED).answer.torques}
    if system.failures.free:
        torques["elastic"] = elastic_torques(system.failures, aims)
    held = [
        hold_prescribed(model, condition.failures, system.failures, aims, *way)
        for way in torques.items()
    ]
    return replace(examined, prescribed=tuple(held))
