"""Everything that is timed, in one process on one thread.

The modules that need the packages of the extra `bench` are imported when these are known to be
installed.
"""

from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from itertools import cycle
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from experiments.benchmark.latency import latencies
from experiments.benchmark.measurement import Agreement, Contender, by_turns, questions
from experiments.benchmark.ratios import saved
from experiments.benchmark.replay import recorded
from experiments.rig.hexapod.choices import JacobianChoice
from experiments.rig.hexapod.columns import COLUMNS
from experiments.rig.hexapod.controller import controller_for, nominal_loops
from experiments.rig.hexapod.simulation import SpiralRun, track_path, track_spiral
from experiments.rig.hexapod.testbed import Testbed, TestbedConfig
from experiments.study.files import usable_file
from experiments.study.study import NotInstalled, OnProgress
from ftc.controller import Measurement
from sim import Array, Plant, Pose, hexapod, load_model

PACKAGES = ("mink", "placo", "daqp", "qpsolvers", "threadpoolctl")
"""The peers, the interface between mink and daqp, and what keeps all of them to one thread."""
GOAL = COLUMNS[0].goal
"""W_a, all struts sound."""


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


_BATCHES = (1, 10, 100, 1_000, 10_000, 100_000)
FULL = Effort(TestbedConfig().duration_s, rounds=7, ticks=100_000, batches=_BATCHES)
QUICK = Effort(2.0, rounds=5, ticks=2_000, batches=_BATCHES[:-1])


@dataclass(frozen=True)
class Timed:
    """What was measured: `samples_us` by name, shape (rounds, samples), after the `agreements`.

    `active_limits`: for each question with limits, how many problems have 0, 1, ... rates at one.
    `out_of_reach`: whether weights change a major task that limits hold back. `latency`: of single
    ticks, by name and setting of the garbage collector.

    The numbers are also written to `save`, compared with those of the saved file `before`, and
    unsound beyond their bounds if `check`.
    """

    seed: int
    effort: Effort
    agreements: list[Agreement]
    samples_us: dict[str, Array]
    active_limits: dict[str, list[int]]
    out_of_reach: dict[str, Any]
    latency: dict[str, Any]
    save: Path | None = None
    before: dict[str, Any] | None = None
    check: bool = False


def run_bench(
    *,
    seed: int,
    quick: bool,
    save: Path | None,
    compare: Path | None,
    check: bool,
    on_progress: OnProgress,
) -> Timed:
    """Compare all answers, then time the contenders who gave them.

    Raises:
        NotInstalled: A package is missing.
        WrongInput: `compare` is no saved file.
        OutputError: `save` cannot be written.
        Unsound: Two answers to the same question differ; nothing is timed.
    """
    if absent := [name for name in PACKAGES if find_spec(name) is None]:
        raise NotInstalled(
            f"fjh bench compares with packages that are not installed, {', '.join(absent)}: "
            'pip install "fault-tolerant-hexapod[bench]", on Python 3.11 to 3.13'
        )
    from threadpoolctl import threadpool_limits

    from experiments.benchmark import limited, out_of_reach, pointing, robots, solvers

    if save is not None:
        usable_file(save, ".json", option="--save")
    before = None if compare is None else saved(compare)
    effort, rng = QUICK if quick else FULL, np.random.default_rng(seed)
    # Set at run time, since NumPy may long have been imported: OpenBLAS keeps to one thread.
    with threadpool_limits(1):
        model, bench = load_model(), TestbedConfig()
        asked = questions(effort.actuators, effort.batches, rng)
        cases = pointing.random_cases(model, 8, rng)
        limits = [limited.random_limited(6, rng) for _ in range(64)]
        others = {robot: robots.random_cases(robot, 8, rng) for robot in robots.robots()}
        agreed = [*solvers.agreements(asked), *limited.agreements(limits)]
        agreed.append(pointing.agreement(model, cases))
        agreed += [robots.agreement(robot, cases) for robot, cases in others.items()]
        for each in agreed:
            each.check()
        testbed = Testbed(model, bench, nominal_loops(model, bench))
        loop = ClosedLoop(testbed, effort.seconds, seed)
        contenders = whole(loop) + parts(loop)
        contenders += pointing.contenders(model, cases) + solvers.contenders(asked)
        contenders += limited.contenders(limits)
        for robot, cases_there in others.items():
            contenders += robots.contenders(robot, cases_there)
        run = recorded(testbed, GOAL, seed)
        contenders.append(run.diagnosis())
        samples_us = by_turns(contenders, effort.rounds, on_progress)
        general = cycle((case.pointing_rad, case.qpos) for case in cases)
        tick = pointing.pointing_tick(model)
        ticks = {"controller": run.controlling(), "tick": lambda: tick(*next(general))}
        latency = latencies(ticks, effort.ticks, on_progress)
        active, weights = limited.active_limits(limits), out_of_reach.compared(seed)
        active |= {
            robots.question(each): robots.active_limits(each, others[each]) for each in others
        }
    return Timed(seed, effort, agreed, samples_us, active, weights, latency, save, before, check)


@dataclass(frozen=True)
class ClosedLoop:
    """The run that is timed: `seconds` of the spiral after settling, noise of this seed."""

    testbed: Testbed
    seconds: float
    seed: int

    @property
    def ticks(self) -> int:
        """Of control."""
        return len(self.testbed.bench.time_s(self.seconds))

    @property
    def steps(self) -> int:
        """Of physics, those of settling too."""
        seconds = self.testbed.bench.settling_s + self.seconds
        return round(seconds / self.testbed.model.opt.timestep)

    def run(self, jacobian: JacobianChoice) -> None:
        """The whole closed loop, its log kept in memory."""
        run = SpiralRun(GOAL, jacobian=jacobian, seed=self.seed, duration_s=self.seconds)
        track_spiral(self.testbed, run)

    def step(self) -> None:
        """MuJoCo alone, in one call."""
        model = self.testbed.model
        mujoco.mj_step(model, mujoco.MjData(model), self.steps)


def whole(loop: ClosedLoop) -> list[Contender]:
    """Times per control tick: bare physics, and the loop with either Jacobian."""
    return [
        Contender("mj_step", loop.step, lambda: [()], loop.ticks),
        Contender("closed_loop", loop.run, lambda: [("analytic",)], loop.ticks),
        Contender("closed_loop_constant", loop.run, lambda: [("constant",)], loop.ticks),
    ]


def parts(loop: ClosedLoop) -> list[Contender]:
    """Times of what a control tick is made of, each part alone, 0.2 s after the start of a run."""
    model, bench = loop.testbed.model, loop.testbed.bench
    controller = controller_for(loop.testbed, GOAL)
    _, state = track_path(loop.testbed, controller, seed=loop.seed, duration_s=0.2)
    mapping, amplifier = controller.mapping, controller.amplifier
    command_m, asked_rad = amplifier.displacement_m(state.input_percent), state.asked.demand
    detector, strut_sensors = bench.detector(), bench.strut_sensors()
    rng, plant, bare = np.random.default_rng(loop.seed), Plant(model), mujoco.MjData(model)
    period_s = bench.control_period_s
    # Without what the estimate has already computed from this pose.
    bare_pose = Pose(state.pose.rotation, state.pose.translation_m)

    def sense() -> Measurement:
        plant.closure_residual_m()
        return Measurement(
            output=detector.read(plant.pose().rotation, rng),
            displacement=strut_sensors.read(plant.displacements(), rng),
        )

    timed: dict[str, tuple[Callable[..., Any], *tuple[Any, ...]]] = {
        "mj_step": (mujoco.mj_step, model, bare, round(period_s / model.opt.timestep)),
        "plant_step": (plant.step, command_m, period_s),
        "sensors": (sense,),
        "controller": (controller.step, state, asked_rad, sense()),
        "estimate": (mapping.estimate, command_m, state.pose),
        "mapping": (mapping.displacements, asked_rad, state.pose),
        "jacobian": (hexapod(model).inverse_jacobian, bare_pose),
        "converter": (amplifier.input_percent, command_m),
    }
    return [
        Contender(f"part_{name}", call, lambda given=tuple(given): [given] * 32, 32, samples=5)
        for name, (call, *given) in timed.items()
    ]
