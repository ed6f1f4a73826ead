"""The constant Jacobian in closed loop, and on the geometry alone, as spiral and stroke grow.

On the geometry alone there is no inertia and no noise, and every strut goes where it is commanded.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from experiments.jacobian.variation import NORMS, Norm, relative_change
from experiments.rig.hexapod.columns import COLUMNS, MAJOR, secondary
from experiments.rig.hexapod.controller import NO_COMMAND, StrutMapping
from experiments.rig.hexapod.rig import hexapod_rig, nominal_testbed
from experiments.rig.hexapod.testbed import Testbed
from experiments.rig.options import JacobianChoice
from experiments.rig.run import Run
from experiments.study.parallel import in_parallel
from ftc.control.local_mapping import PreviousCommand
from ftc.control.mapping import DisplacementForm
from ftc.goal import Goal
from sim import (
    NOMINAL,
    Array,
    Hexapod,
    forward_kinematics,
    hexapod,
    pointing_angles,
    secondary_motion,
)

VARIANTS: dict[str, tuple[JacobianChoice, DisplacementForm]] = {
    "constant": ("constant", "absolute"),
    "analytic": ("analytic", "absolute"),
    "incremental": ("analytic", "incremental"),
    "relinearized": ("analytic", "gauss_newton"),
}
"""The constant Jacobian, and three ways to use the one at the present pose."""


class Growth(NamedTuple):
    """A larger machine task: how many times the stroke, how many times the spiral."""

    stroke: float
    spiral: float

    def __str__(self) -> str:
        if self.stroke == self.spiral:
            return f"x{self.spiral:g}"
        return f"x{self.spiral:g} on stroke x{self.stroke:g}"


GROWTHS = (
    *(Growth(times, times) for times in (1, 3, 10, 30, 100)),
    # A longer stroke would not leave the struts' triangle whole; the spiral has room to grow.
    Growth(100, 300),
    Growth(100, 1000),
)

BY_NAME = {column.name: column for column in COLUMNS}
GROWN = "W_e"
"""The column that grows: strut 1 locked, t_x and t_y to be small. Curvature costs it the most."""
AT_NOMINAL = ("W_a", "W_d", "W_e")
RECORDED = (Growth(1, 1), Growth(100, 100), Growth(100, 1000))
"""Sizes at which runs of GROWN are kept whole, data and recording."""

STRIDE_S = 0.16
"""Between the instants at which a run is compared with the optimum, a dozen a turn."""
_VISITED_STRIDE_S = 0.008  # between those whose strut lengths count as visited
_MOST_STEPS = 20
_TICKS_A_POINT = 4  # enough to settle: each leaves a part e, eq. (40), of the error before


@dataclass(frozen=True)
class LoopRun:
    """One run to be simulated: a column of Table I, its size, a key of VARIANTS, the noise seed."""

    column: str
    growth: Growth
    variant: str
    seed: int

    @property
    def name(self) -> str:
        """What its files are called."""
        return f"{self.column}_x{self.growth.spiral:g}_{self.variant}_seed{self.seed}"

    @property
    def is_recorded(self) -> bool:
        """Whether its data and recording are kept."""
        return self.column == GROWN and self.growth in RECORDED


@dataclass(frozen=True)
class Tracked:
    """A run, and what its Jacobian cost."""

    run: Run
    extra_percent: float  # distance from the optimum at the same pointing, of its cost
    static_extra_percent: float  # the same on the geometry alone
    e_visited: dict[Norm, float]  # eq. (40) over the strut displacements that were visited
    loop_gain_error: float  # largest ||J_m M_0 - I|| over them, M_0 the constant mapping


def loop_runs(seed: int, quick: bool) -> list[LoopRun]:
    """Every variant: at nominal size for three columns, and another seed; grown for one column."""
    nominal, growths = GROWTHS[0], GROWTHS[3::3] if quick else GROWTHS[1:]
    columns = (GROWN,) if quick else AT_NOMINAL
    chosen = [LoopRun(c, nominal, v, seed) for c in columns for v in VARIANTS]
    chosen += [LoopRun(c, nominal, "analytic", seed + 1) for c in columns]
    return chosen + [LoopRun(GROWN, g, v, seed) for g in growths for v in VARIANTS]


def run_loop(
    *, seed: int, quick: bool, on_progress: Callable[[int, int], None]
) -> dict[LoopRun, Tracked]:
    """Track the spiral with each variant, in parallel on the machine's cores.

    Raises:
        sim.SimulationDiverged: The physics left the finite numbers.
    """
    testbed = nominal_testbed()
    bench = testbed.bench
    duration_s = bench.quick_duration_s if quick else bench.duration_s
    runs = loop_runs(seed, quick)
    calls = [{"testbed": testbed, "duration_s": duration_s, "run": run} for run in runs]
    return dict(zip(runs, in_parallel(_track, calls, on_progress), strict=True))


def _track(testbed: Testbed, duration_s: float, run: LoopRun) -> Tracked:
    column, (jacobian, form) = BY_NAME[run.column], VARIANTS[run.variant]
    grown, bench = testbed.scaled(**run.growth._asdict()), testbed.bench
    rig = hexapod_rig(grown, column.goal, jacobian=jacobian, form=form)
    path, how = grown.bench.spiral_rad(duration_s), {"failures": column.failures, "seed": run.seed}
    done = rig.fly(rig.controller(), path, **how)
    geometry, goal = hexapod(testbed.model), column.goal
    compared = slice(None, None, round(STRIDE_S / bench.control_period_s))
    passed = slice(None, None, round(_VISITED_STRIDE_S / bench.control_period_s))
    strut_m, visited_m = (done.displacement[part] for part in (compared, passed))
    seen = Visited(strut_m, done.true[compared], secondary(done)[compared])
    mapping = StrutMapping(geometry, goal, jacobian, form=form)
    static = follow(mapping, path[compared])
    return Tracked(
        run=done,
        extra_percent=extra_percent(geometry, goal, seen),
        static_extra_percent=extra_percent(geometry, goal, static),
        e_visited={n: float(relative_change(geometry, visited_m, n).max()) for n in NORMS},
        loop_gain_error=loop_gain_error(StrutMapping(geometry, goal, "constant"), visited_m),
    )


@dataclass(frozen=True)
class Visited:
    """Where a path leads: displacements (T, 6), (alpha, beta) (T, 2), secondary motion (T, 4)."""

    strut_m: Array
    pointing_rad: Array
    secondary: Array


def visit(geometry: Hexapod, strut_m: Array) -> Visited:
    """Where strut displacements (T, 6) lead."""
    pose = forward_kinematics(geometry, strut_m)
    secondary = secondary_motion(pose.rotation, pose.translation_m)
    return Visited(strut_m, pointing_angles(pose.rotation), secondary)


def follow(mapping: StrutMapping, desired_rad: Array) -> Visited:
    """The path of a pointing loop that settles at every desired (alpha, beta), (T, 2)."""
    pose, pointing, last = NOMINAL, np.zeros(2), NO_COMMAND
    visited_m = []
    for desired in desired_rad:
        for _ in range(_TICKS_A_POINT):
            pointing = pointing + desired - pointing_angles(pose.rotation)
            commanded_m = mapping.displacements(pointing, pose, last.displacements, last)
            last = PreviousCommand(pointing, commanded_m, last.secondary_reference)
            pose = forward_kinematics(mapping.geometry, commanded_m, start=pose)
        visited_m.append(last.displacements)
    return visit(mapping.geometry, np.array(visited_m))


def optimum(geometry: Hexapod, goal: Goal, pointing_rad: Array) -> Visited:
    """The strut displacements that point exactly and meet the goal best, curvature and all.

    Minimizes |W1 l|^2 + |W2 s|^2 over all poses with this pointing (T, 2), s the secondary motion:
    Gauss-Newton, each step the mapping at the present pose.

    Raises:
        RuntimeError: It does not converge.
    """
    mapping = StrutMapping(geometry, goal, "analytic", form="gauss_newton")
    strut_m, pose, best_m = np.zeros(6), NOMINAL, []
    for pointing in pointing_rad:
        for _ in range(_MOST_STEPS):
            change_m = mapping.displacements(pointing, pose, strut_m) - strut_m
            strut_m = strut_m + change_m
            pose = forward_kinematics(geometry, strut_m, start=pose)
            if np.abs(change_m).max() < 1e-13:
                break
        else:
            raise RuntimeError(f"no optimum found at (alpha, beta) = {pointing} rad")
        best_m.append(strut_m)
    return visit(geometry, np.array(best_m))


def goal_vector(goal: Goal, visited: Visited) -> Array:
    """What the goal keeps small: [W1 l; W2 s], shape (T, 10)."""
    w1 = np.zeros(6) if goal.joint_weight is None else np.array(goal.joint_weight)
    w2 = np.zeros(4) if goal.secondary_weight is None else np.array(goal.secondary_weight)
    return np.hstack([w1 * visited.strut_m, w2 * visited.secondary[:, [1, 2, 3, 0]]])


def extra_percent(geometry: Hexapod, goal: Goal, visited: Visited) -> float:
    """RMS distance of a path from the optimum at the same pointing, in percent of its cost."""
    least = goal_vector(goal, optimum(geometry, goal, visited.pointing_rad))
    return 100 * float(np.linalg.norm(goal_vector(goal, visited) - least) / np.linalg.norm(least))


def loop_gain_error(mapping: StrutMapping, strut_m: Array) -> float:
    """Largest ||J_m(l) M - I|| over strut displacements (T, 6), M the constant mapping."""
    pose = forward_kinematics(mapping.geometry, strut_m)
    J_m = np.linalg.inv(mapping.geometry.inverse_jacobian(pose))[:, MAJOR]
    off = J_m @ mapping.major_gain() - np.eye(2)
    return float(np.linalg.norm(off, 2, axis=(-2, -1)).max())
