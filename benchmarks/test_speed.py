"""Time all candidates for all questions with pytest-benchmark; `make bench` makes the table."""

from collections.abc import Callable
from functools import cache, partial

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from benchmarks import ik, loops, robots, solvers
from benchmarks.candidate import Candidate
from benchmarks.table import candidates

TURNS = 10
"""Number of turns, in which candidates alternate so that disturbances affect all of them."""
QUESTIONS: dict[str, Callable[[np.random.Generator], dict[str, Candidate]]] = {
    **{f"loop_{name}": partial(loops.loop, name) for name in ("hexapod", *loops.MAJOR)},
    **{f"tick_{name}": partial(robots.tick, name) for name in robots.ROBOTS},
    **{f"ik_{name}": partial(ik.ik, name) for name in ik.ROBOTS},
    "problem_1": solvers.problem_1,
    "limited": solvers.limited,
    "three_levels": solvers.three_levels,
    "batch": solvers.batch,
    "many_actuators": solvers.many_actuators,
}


@cache
def candidates_of(question: str) -> dict[str, Candidate]:
    """Return the candidates for a question; raise ValueError if their solutions differ."""
    return QUESTIONS[question](np.random.default_rng(0))


@pytest.mark.parametrize(
    ("question", "turn", "name"),
    [
        (question, turn, name)
        for question, names in candidates().items()
        for turn in range(TURNS)
        for name in (names if turn % 2 else names[::-1])
    ],
)
def test_time(benchmark, question, turn, name):
    """Time one candidate on one thread, with garbage collection."""
    candidate = candidates_of(question)[name]

    def run_round(calls: list[tuple]) -> None:
        call = candidate.call
        for arguments in calls:
            call(*arguments)

    benchmark.group = f"{question}, turn {turn}"
    benchmark.extra_info.update(question=question, turn=turn, name=name, units=candidate.units)
    with threadpool_limits(1):
        benchmark.pedantic(
            run_round,
            setup=lambda: ((candidate.arguments(),), {}),
            rounds=candidate.rounds,
            warmup_rounds=int(candidate.rounds > 1),
        )
