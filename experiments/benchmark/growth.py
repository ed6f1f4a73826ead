"""How the time grows: with the number of actuators, and with the mappings in one call."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from experiments.benchmark.agreement import Agreement, compare
from experiments.benchmark.problem import Problem, random_problem
from experiments.benchmark.solvers import DAQP, GROWING, LAPACK, OURS
from experiments.benchmark.stopwatch import Contender

ACTUATORS = (6, 10, 20, 50, 100, 200)
BATCHES = (1, 10, 100, 1_000, 10_000, 100_000)
BATCHED = "batched"
"""Name of the largest batch."""
_SAMPLES = 3
_COMPARED = 64


@dataclass(frozen=True)
class Series:
    """One solver at several sizes.

    Attributes:
        solver: Its name.
        sizes: Ascending.
        names: Of the contender at each.
    """

    solver: str
    sizes: tuple[int, ...]
    names: tuple[str, ...]


def actuator_problems(sizes: Sequence[int], rng: np.random.Generator) -> dict[int, list[Problem]]:
    """Fewer where each takes longer."""
    return {n: [random_problem(n, rng) for _ in range(max(2, 400 // n))] for n in sizes}


def batch_problems(sizes: Sequence[int], rng: np.random.Generator) -> dict[int, list[Problem]]:
    """As many mappings in each sample as in the largest call, but no more than 20 calls."""
    return {
        size: [random_problem(6, rng, (size,)) for _ in range(min(20, sizes[-1] // size))]
        for size in sizes
    }


def with_actuators(
    problems: Mapping[int, list[Problem]],
) -> tuple[list[Series], list[Contender]]:
    """Every solver that can, at every number of actuators."""
    by_solver = {
        solver.name: [
            solver.contender(given, name=f"{solver.name}_n{n}", samples=_SAMPLES)
            for n, given in problems.items()
        ]
        for solver in GROWING
    }
    series = [
        Series(name, tuple(problems), tuple(each.name for each in contenders))
        for name, contenders in by_solver.items()
    ]
    return series, [each for contenders in by_solver.values() for each in contenders]


def in_batches(problems: Mapping[int, list[Problem]]) -> tuple[Series, list[Contender]]:
    """Our one call for all; times are per mapping."""
    sizes = tuple(problems)
    names = (*(f"{OURS.name}_batch{size}" for size in sizes[:-1]), BATCHED)
    contenders = [
        OURS.contender(given, name=name, samples=_SAMPLES, units=size)
        for name, (size, given) in zip(names, problems.items(), strict=True)
    ]
    return Series(OURS.name, sizes, names), contenders


def actuator_agreements(problems: Mapping[int, list[Problem]], tolerance: float) -> list[Agreement]:
    """All solvers, at every number of actuators."""
    return [
        compare(
            f"Problem 1 with {n} actuators",
            {solver.name: solver.answers(given) for solver in GROWING},
            tolerance,
        )
        for n, given in problems.items()
    ]


def batch_agreement(batch: Problem, tolerance: float) -> Agreement:
    """The batch beside its first problems one by one."""
    alone = [batch.one(k) for k in range(min(_COMPARED, len(batch.J)))]
    answers = {solver.name: solver.answers(alone) for solver in (OURS, DAQP, LAPACK)}
    return compare(
        f"a batch of {len(batch.J)}",
        answers | {BATCHED: OURS.solve(batch)[: len(alone)]},
        tolerance,
    )


@dataclass(frozen=True)
class PowerLaw:
    """Time as a power of size.

    Attributes:
        exponent: Of the straight line that fits log time against log size best.
        least: Slope of the flattest piece between neighbouring sizes, `most`: of the steepest.
    """

    exponent: float
    least: float
    most: float


def fitted(sizes: Sequence[int], time_us: ArrayLike) -> PowerLaw:
    """The power law of times (k,) at sizes (k,)."""
    x, y = np.log(sizes), np.log(time_us)
    slopes = np.diff(y) / np.diff(x)
    exponent = np.polynomial.Polynomial.fit(x, y, 1).convert().coef[1]
    return PowerLaw(float(exponent), float(slopes.min()), float(slopes.max()))
