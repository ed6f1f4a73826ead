"""Each contender on each question, timed by pytest-benchmark; `make bench` makes a table of it."""

from collections.abc import Callable
from functools import cache, partial
from typing import Any

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from benchmarks import ik, loops, robots, solvers
from benchmarks.contender import Contender, Question

TURNS = 5
"""All contenders of a question take turns, so that disturbances affect all alike."""
LOOPS = ("hexapod", *loops.MAJOR)
TICKS = ("hexapod", "arm", "ur5e", "humanoid_one_foot", "humanoid")
SOLVED = ("prioritized", "daqp", "daqp_built", "placo", "placo_built", "pinv_formula", "dgglse")
IK = tuple(each.name for each in ik.ROBOTS)
QUESTIONS: dict[str, tuple[Callable[[np.random.Generator], Question], list[str]]] = {
    "problem_1": (solvers.problem_1, [*SOLVED]),
    "limited": (
        solvers.limited,
        ["prioritized_limited", "daqp_limited", "daqp_built_limited"],
    ),
    "three_levels": (solvers.three_levels, ["levels", "daqp_levels", "daqp_levels_built"]),
    "n200": (
        solvers.many_actuators,
        [f"{name}_n200" for name in SOLVED if not name.endswith("built")],
    ),
    "batch": (solvers.batch, ["prioritized_batch"]),
    **{
        f"tick_{name}": (partial(robots.tick, name), [f"{name}_tick", f"{name}_mink"])
        for name in TICKS
    },
    **{f"ik_{name}": (partial(ik.ik, name), [f"ik_{name}", f"ik_{name}_mink"]) for name in IK},
    **{
        f"loop_{name}": (
            partial(loops.loop, name),
            [f"{name}_{kind}" for kind in ("physics", "loop", "supervised")],
        )
        for name in LOOPS
    },
}
"""Each question, and the names of its contenders."""


@cache
def asked(name: str) -> Question:
    """A question, once all agree on the answers.

    Raises:
        ValueError: They do not; it is not timed.
    """
    found = QUESTIONS[name][0](np.random.default_rng(0))
    found.check()
    return found


def _all_of(contender: Contender) -> Callable[[Any], None]:
    call = contender.call

    def once(given: Any) -> None:
        for each in given:
            call(*each)

    return once


@pytest.mark.parametrize(
    ("question", "turn", "name"),
    [
        (question, turn, name)
        for question, (_, names) in QUESTIONS.items()
        for turn in range(TURNS)
        for name in names
    ],
)
def test_time(benchmark, question, turn, name):
    """The library and its peers on the same problems, on one thread, garbage collection on."""
    with threadpool_limits(1):
        contender = asked(question).contenders[name]
        benchmark.group = f"{question}, turn {turn}"
        benchmark.extra_info.update(name=name, units=contender.units)
        benchmark.pedantic(
            _all_of(contender),
            setup=lambda: ((contender.arguments(),), {}),
            rounds=contender.rounds,
            warmup_rounds=1,
        )
