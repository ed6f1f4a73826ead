"""Everything that is timed, in one process on one thread."""

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np
from threadpoolctl import threadpool_limits

from experiments.benchmark import growth, loop, pointing
from experiments.benchmark.agreement import Agreement, compare
from experiments.benchmark.case import Case, random_cases
from experiments.benchmark.growth import Series
from experiments.benchmark.problem import Problem, random_problem
from experiments.benchmark.solvers import SOLVERS
from experiments.benchmark.stopwatch import by_turns
from experiments.hexapod.simulation import nominal_loops
from experiments.hexapod.testbed import Bench
from sim import Array, load_model

TOLERANCE = 1e-9
"""Of the solvers, as a fraction of the rates."""
_PROBLEMS, _CASES, _SAMPLES = 64, 8, 20


@dataclass(frozen=True)
class Effort:
    """How much is timed.

    Attributes:
        seconds: Of the spiral.
        rounds: In which every contender has its turn; one more goes before, to warm up.
        batches: Sizes of batches.
        actuators: Numbers of actuators.
    """

    seconds: float
    rounds: int
    batches: tuple[int, ...]
    actuators: tuple[int, ...] = growth.ACTUATORS


FULL = Effort(seconds=Bench().duration_s, rounds=7, batches=growth.BATCHES)
QUICK = Effort(seconds=2.0, rounds=5, batches=growth.BATCHES[:-1])


@dataclass(frozen=True)
class Questions:
    """What is asked of everybody, drawn from one seed.

    Attributes:
        problems: Of the hexapod's size.
        by_actuators: By number of actuators.
        by_batch: By size of the batch, ascending.
        cases: Of the hexapod, strut 1 locked.
    """

    problems: list[Problem]
    by_actuators: dict[int, list[Problem]]
    by_batch: dict[int, list[Problem]]
    cases: list[Case]


@dataclass(frozen=True)
class Timed:
    """What was measured.

    Attributes:
        effort: How much was timed.
        flight: The run that was.
        agreements: Of all answers, before.
        samples_us: By name, shape (rounds, samples).
        actuators: One series for each solver.
        batches: Ours, per mapping.
    """

    effort: Effort
    flight: loop.Flight
    agreements: list[Agreement]
    samples_us: dict[str, Array]
    actuators: list[Series]
    batches: Series


def measure(*, seed: int, effort: Effort, on_progress: Callable[[int, int], None]) -> Timed:
    """Compare all answers, then time who gave them.

    Raises:
        Unsound: Two answers to the same question differ; nothing is timed.
    """
    # Set at run time, since NumPy may long have been imported: OpenBLAS keeps to one thread.
    with threadpool_limits(1):
        model, bench = load_model(), Bench()
        asked = questions(model, effort, seed)
        agreed = agreements(model, asked)
        for each in agreed:
            each.check()
        flight = loop.Flight(model, bench, nominal_loops(model, bench), effort.seconds, seed)
        actuators, alone = growth.with_actuators(asked.by_actuators)
        batches, together = growth.in_batches(asked.by_batch)
        contenders = [
            *loop.whole(flight),
            *loop.parts(flight),
            *pointing.contenders(model, asked.cases),
            *(each.contender(asked.problems, samples=_SAMPLES) for each in SOLVERS),
            *alone,
            *together,
        ]
        samples_us = by_turns(contenders, effort.rounds, on_progress)
    return Timed(effort, flight, agreed, samples_us, actuators, batches)


def questions(model: mujoco.MjModel, effort: Effort, seed: int) -> Questions:
    """Random, the same for the same seed."""
    rng = np.random.default_rng(seed)
    return Questions(
        problems=[random_problem(6, rng) for _ in range(_PROBLEMS)],
        by_actuators=growth.actuator_problems(effort.actuators, rng),
        by_batch=growth.batch_problems(effort.batches, rng),
        cases=random_cases(model, _CASES, rng),
    )


def agreements(model: mujoco.MjModel, asked: Questions) -> list[Agreement]:
    """How far apart all answers to each question are."""
    weighted = {each.name: each.answers(asked.problems) for each in SOLVERS if not each.unit_rows}
    unit = [each.with_unit_rows() for each in asked.problems]
    largest = next(reversed(asked.by_batch.values()))[0]
    return [
        compare("Problem 1", weighted, TOLERANCE),
        compare(
            "Problem 1 with unit rows",
            {each.name: each.answers(unit) for each in SOLVERS},
            TOLERANCE,
        ),
        *growth.actuator_agreements(asked.by_actuators, TOLERANCE),
        growth.batch_agreement(largest, TOLERANCE),
        pointing.agreement(model, asked.cases),
    ]
