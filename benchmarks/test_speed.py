"""Each contender on each question, timed by pytest-benchmark; `make bench` makes a table of it."""

from collections.abc import Callable
from functools import cache, partial

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from benchmarks import ik, loops, robots, solvers
from benchmarks.contender import Contender
from benchmarks.table import contenders

TURNS = 10
"""All contenders of a question take turns, so that disturbances affect all alike."""
QUESTIONS: dict[str, Callable[[np.random.Generator], dict[str, Contender]]] = {
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
def asked(question: str) -> dict[str, Contender]:
    """Who answers a question, once all agree on the answers; a ValueError if they do not."""
    return QUESTIONS[question](np.random.default_rng(0))


@pytest.mark.parametrize(
    ("question", "turn", "name"),
    [
        (question, turn, name)
        for question, names in contenders().items()
        for turn in range(TURNS)
        for name in (names if turn % 2 else names[::-1])
    ],
)
def test_time(benchmark, question, turn, name):
    """The library and its peers on the same problems, on one thread, garbage collection on."""
    one = asked(question)[name]

    def round_of(given: list[tuple]) -> None:
        call = one.call
        for each in given:
            call(*each)

    benchmark.group = f"{question}, turn {turn}"
    benchmark.extra_info.update(question=question, turn=turn, name=name, units=one.units)
    with threadpool_limits(1):
        benchmark.pedantic(
            round_of,
            setup=lambda: ((one.arguments(),), {}),
            rounds=one.rounds,
            warmup_rounds=int(one.rounds > 1),
        )
