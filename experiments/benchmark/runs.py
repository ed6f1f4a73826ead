"""Everything that is timed, in one process on one thread.

The modules that need the packages of the extra `bench` are imported when these are known to be
installed.
"""

from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any

import numpy as np

from experiments.benchmark.closed_loop import (
    GOAL,
    LOOPS,
    ClosedLoop,
    RobotLoop,
    recorded,
    whole,
)
from experiments.benchmark.latency import latencies
from experiments.benchmark.measurement import Agreement, Entry, by_turns, questions
from experiments.rig.hexapod.controller import controller_for, nominal_loops
from experiments.rig.hexapod.rig import hexapod_rig
from experiments.rig.hexapod.testbed import Testbed, TestbedConfig
from experiments.study.study import NotInstalled, OnProgress
from sim import Array, load_model

LATENCY = ("fjh_tick", "humanoid_tick", "ik_humanoid")
"""Ticks timed one by one besides those of the hexapod's controllers."""
PACKAGES = ("mink", "placo", "daqp", "qpsolvers")
"""The peers, the interface between mink and daqp, and what keeps all of them to one thread."""


@dataclass(frozen=True)
class Effort:
    """How much is timed: `seconds` of the spiral, and sizes of problems, ascending.

    Every contender has its turn in each of the `rounds`; one more goes before, to warm up. Of each
    tick whose latency is measured so many `ticks`.
    """

    seconds: float
    rounds: int
    ticks: int
    batches: tuple[int, ...]
    actuators: tuple[int, ...] = (6, 10, 20, 50, 100, 200)


_CIRCLE_S = 3.0
"""Of the runs of bundled robots, at most."""
_BATCHES = (1, 10, 100, 1_000, 10_000, 100_000)
FULL = Effort(TestbedConfig().duration_s, rounds=7, ticks=50_000, batches=_BATCHES)
QUICK = Effort(2.0, rounds=5, ticks=2_000, batches=_BATCHES[:-1])


@dataclass(frozen=True)
class Timed:
    """What was measured: `samples_us` by name, shape (rounds, samples), after the `agreements`.

    `active_limits`: for each question with limits, how many problems have 0, 1, ... rates at one.
    `out_of_reach`: whether weights change a major task that limits hold back. `latency`: of single
    ticks, by name and setting of the garbage collector. `slowest`: mean and slowest tick of
    supervised robots of which an actuator locks.

    The numbers are unsound beyond their bounds if `check`.
    """

    seed: int
    effort: Effort
    agreements: list[Agreement]
    samples_us: dict[str, Array]
    active_limits: dict[str, list[int]]
    out_of_reach: dict[str, Any]
    latency: dict[str, Any]
    slowest: dict[str, dict[str, float]]
    check: bool = False


def run_bench(*, seed: int, quick: bool, check: bool, on_progress: OnProgress) -> Timed:
    """Compare all answers, then time the contenders who gave them.

    Raises:
        NotInstalled: A package is missing.
        Unsound: Two answers to the same question differ; nothing is timed.
    """
    if absent := [name for name in PACKAGES if find_spec(name) is None]:
        raise NotInstalled(
            f"fjh bench compares with packages that are not installed, {', '.join(absent)}: "
            'pip install "fault-tolerant-hexapod[bench]", on Python 3.11 to 3.13'
        )
    from threadpoolctl import threadpool_limits

    from experiments.benchmark import ik, limited, mechanisms, pointing, robots, solvers

    effort, rng = QUICK if quick else FULL, np.random.default_rng(seed)
    # Set at run time, since NumPy may long have been imported: OpenBLAS keeps to one thread.
    with threadpool_limits(1):
        model, bench = load_model(), TestbedConfig()
        cases = pointing.random_cases(model, 8, rng)
        limits = [limited.random_limited(6, rng) for _ in range(64)]
        testbed = Testbed(model, bench, nominal_loops(model, bench))
        loop = ClosedLoop(testbed, effort.seconds, seed)
        entries = [
            solvers.entry(questions(effort.actuators, effort.batches, rng)),
            limited.entry(limits),
            pointing.entry(model, cases),
            *(robots.entry(each, robots.random_cases(each, 8, rng)) for each in robots.robots()),
            *(ik.entry(each, ik.random_cases(each, 8, rng)) for each in ik.ROBOTS),
            mechanisms.entry(rng),
        ]
        agreed = [each for entry in entries for each in entry.agreements]
        for each in agreed:
            each.check()
        run = recorded(testbed, controller_for(testbed, GOAL), seed)
        seconds = min(effort.seconds, _CIRCLE_S)
        loops = [RobotLoop.of(name, seconds, seed) for name in ("hexapod", *LOOPS)]
        flown = [each for one in loops for each in one.contenders()]
        entries.append(Entry([*whole(loop), *run.diagnosis(), *flown]))
        contenders = [each for entry in entries for each in entry.contenders]
        samples_us = by_turns(contenders, effort.rounds, on_progress)
        diagnosing = recorded(testbed, hexapod_rig(testbed).supervisor(goal=GOAL), seed)
        ticks = {"controller": run.controlling(), "supervisor": diagnosing.controlling()}
        ticks |= {each.name: each.single() for each in contenders if each.name in LATENCY}
        latency = latencies(ticks, effort.ticks, on_progress)
        slowest = {each.name: each.slowest() for each in loops}
        active = {
            question: counts for entry in entries for question, counts in entry.at_limits.items()
        }
        weights = limited.compared(seed)
    return Timed(seed, effort, agreed, samples_us, active, weights, latency, slowest, check)
