"""Everything that is timed, in one process on one thread.

The modules that need the packages of the extra `bench` are imported when these are known to be
installed.
"""

from dataclasses import dataclass
from importlib.metadata import version
from importlib.util import find_spec
from typing import Annotated, Any

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
from experiments.study.errors import NotInstalled
from experiments.study.option import Option, seed_of
from experiments.study.provenance import machine
from experiments.study.result import Result, origin
from experiments.study.terminal import OnProgress
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


_CIRCLE_S = 3.0  # of the runs of bundled robots, at most
_BATCHES = (1, 10, 100, 1_000, 10_000, 100_000)
FULL = Effort(TestbedConfig().duration_s, rounds=7, ticks=50_000, batches=_BATCHES)
QUICK = Effort(2.0, rounds=5, ticks=2_000, batches=_BATCHES[:-1])


@dataclass(frozen=True)
class Timed:
    """What was measured, after the agreement of all answers."""

    effort: Effort
    agreements: list[Agreement]
    samples_us: dict[str, Array]  # by name, shape (rounds, samples)
    active_limits: dict[str, list[int]]  # of each question: problems with 0, 1, ... rates at one
    out_of_reach: list[dict[str, Any]]  # whether weights change a task that limits hold back
    latency: list[dict[str, Any]]  # of single ticks, with each setting of the garbage collector
    slowest: list[dict[str, Any]]  # ticks of supervised robots of which an actuator locks


def bench(
    *,
    seed: Annotated[int, seed_of("the detector noise and the random problems")] = 0,
    quick: Annotated[
        bool,
        Option(help="2 s of the spiral, fewer rounds, batches up to 10,000."),
    ] = False,
    check: Annotated[
        bool, Option(help="Exit with 1 if a stable ratio exceeds three times its bound.")
    ] = False,
    on_progress: OnProgress,
) -> Result:
    """Time the control loop and the mapping against physics and other libraries.

    The benchmark compares the closed loop with the physics alone, one control tick with mink, one
    Problem 1 with daqp, PlaCo, LAPACK and the paper's formula, for several numbers of actuators and
    batch sizes, and Problem 1 and three levels under limits with daqp. All results are compared
    before the timing; the calls take turns in one process. 2 minutes, one with --quick; do not run
    other work meanwhile.

    Writes bench.json (times in us, medians and their ranges), the tables as bench.md, and a figure.

    Example: fjh bench --quick --out /tmp/before
    """
    if absent := [name for name in PACKAGES if find_spec(name) is None]:
        raise NotInstalled(
            f"fjh bench compares with packages that are not installed, {', '.join(absent)}: "
            'pip install "fault-tolerant-hexapod[bench]", on Python 3.11 to 3.13'
        )
    return result_of(measured(QUICK if quick else FULL, seed, on_progress), seed, check=check)


def result_of(timed: Timed, seed: int, *, check: bool) -> Result:
    """What is published; checked against the bounds if that is asked."""
    from experiments.benchmark import results

    found = origin(seed)
    settings = found | {
        "versions": found["versions"] | {name: version(name) for name in PACKAGES},
        "machine": machine(),
        "numerical_threads": 1,
        "simulated_s": timed.effort.seconds,
        "rounds": timed.effort.rounds,
        "ticks": timed.effort.ticks,
    }
    tables = results.tables_of(timed)
    return Result(
        settings=settings,
        tables=tables,
        checks=results.checks(tables["ratios"]) if check else [],
        shown=results.shown(tables, timed.effort.seconds),
        notes=results.notes(tables, settings, PACKAGES),
        pictures=[results.picture(tables["ratios"], tables["timings"])],
    )


def measured(effort: Effort, seed: int, on_progress: OnProgress) -> Timed:
    """Everything, in turns, on one thread.

    Raises:
        Unsound: Two answers to the same question differ; nothing is timed.
    """
    from threadpoolctl import threadpool_limits

    from experiments.benchmark import ik, limited, mechanisms, pointing, robots, solvers

    rng = np.random.default_rng(seed)
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
        slowest = [{"robot": each.name} | each.slowest() for each in loops]
        active = {
            question: counts for entry in entries for question, counts in entry.at_limits.items()
        }
        weights = limited.compared(seed)
    return Timed(effort, agreed, samples_us, active, weights, latency, slowest)
