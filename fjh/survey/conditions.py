"""Analysis of a system in all failure conditions at all postures, in one data frame."""

import copy
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from math import ceil, comb, log2, pi
from time import perf_counter
from typing import NamedTuple

import mujoco
import numpy as np
import pandas as pd

from argument_checks.ties import exceeds, least
from fjh.rig.condition_analysis import ConditionAnalysis, analyze_conditions, directions_text
from fjh.rig.conditions import FREE, HEALTHY, KINDS, LOCKED, condition_text, failed, few_failures
from fjh.rig.robot import Robot, robot_of
from fjh.study.option import OnProgress
from fjh.study.result import Check, check
from fjh.study.workers import in_parallel
from fjh.survey.system import AnalyzedSystem, common
from ftc import is_possible
from sim import Array, ClosureError, JacobianReader, assemble, ranges
from sim.mjcf import drives, joint_positions, one_axis

MOST_CONDITIONS = 20_000  # conditions of one posture: 1 to 2 s for ten actuators
MOST_SETS = 1_000_000
"""Largest number of actuator sets that are searched for worst directions, in a few seconds."""
BOTH_UP_TO = 12
"""Largest number of actuators for which double failures are analyzed also at other postures."""
_SLIDES = 0.5  # half the range of a slide without limits, as a fraction of the model's extent
_BEYOND = 1e-6  # [rad] or [m], by which round-off may put a joint outside its range
_ALONE_S = 4.0  # remaining work [s] below which further processes are not worth starting
_RECHECKED = 24  # conditions that are analyzed one by one as well: a fraction of a second
_LOSS_TIE = 0.02  # losses that differ by less are equal: sampled postures are not symmetric


class Survey(NamedTuple):
    """Results of a survey.

    Attributes:
        system: System at its start, or at the posture that replaces an infeasible start.
        start: Analysis of all conditions with few failures at this posture, the healthy one first.
        rows: Remaining capability at each `posture` (0: the start) in each `condition` (its number
            in `start`), with the columns of :func:`numbers_of`, and `possible`: whether the task is
            possible at this posture without failures.
        postures: Joint positions `qpos` (nq,) of the other postures, by number.
        counts: Numbers of conditions, and of survived ones at the start, by number of failures.
    """

    system: AnalyzedSystem
    start: ConditionAnalysis
    rows: pd.DataFrame
    postures: pd.DataFrame
    counts: pd.DataFrame

    def omissions(self) -> Iterator[str]:
        """Yield a sentence on each part of the survey that was not computed."""
        n, most = len(self.system.actuators), int(self.counts.failures.max())
        if most < n:
            few = f"at most {most} failures ({self.counts.conditions.sum():,})"
            if self.rows.condition.iloc[-1] < len(self.start.codes) - 1:
                few += ", at other postures than the start with one,"
            yield f"Of the {len(KINDS) + 1}^{n} conditions those with {few} were analyzed."
        left = self.start.classes
        worst = {self.system.measure: left.worst_speed}
        worst |= {} if self.system.torques is None else {"force": left.worst_force}
        if missing := " and ".join(name for name, values in worst.items() if values is None):
            yield (
                f"The {missing} left in the worst direction was not computed: too many sets of "
                "actuators would have to be searched; choose fewer major rows."
            )


def survey_system(
    system: AnalyzedSystem, postures: int, seed: int, on_progress: OnProgress
) -> Survey:
    """Analyze a system at its start, and a robot also at up to `postures` sampled postures."""
    most = most_failures(len(system.actuators))
    others, qpos = list[ConditionAnalysis](), list[Array]()
    at_start = condition_analysis(system, min(most, 2))
    start = at_start(system.constrained_system, on_progress=on_progress)
    if (robot := system.robot) is not None and postures > 0:
        qpos, others = analyze_postures(system, robot, postures, seed, on_progress)
        if not start.survived[0] and any(at.survived[0] for at in others):
            best = least([at.largest_gain[0] for at in others])
            sentence = f"At the start {start.reason(0)}: posture {best + 1} is used instead."
            system = at_posture(system, robot, qpos[best], sentence)
            start = at_start(system.constrained_system, on_progress=on_progress)
    every = start
    if most > 2:
        every = condition_analysis(system, most)(system.constrained_system, on_progress=on_progress)
    survived = pd.Series(every.survived).groupby(every.failures)
    counts = survived.agg(conditions="size", survived="sum").rename_axis("failures").reset_index()
    frames = dict(enumerate(numbers_of(system, at) for at in (start, *others)))
    rows = pd.concat(frames, names=["posture", "condition"]).reset_index()
    rows["possible"] = rows.groupby("posture").survived.transform("first")
    sampled = pd.DataFrame({"posture": range(1, len(qpos) + 1), "qpos": qpos})
    return Survey(system, start, rows, sampled, counts)


def most_failures(n: int) -> int:
    """Return the largest number of simultaneous failures that can be analyzed in seconds."""
    possible = (k for k in range(n, 1, -1) if conditions_up_to(n, k) <= MOST_CONDITIONS)
    return next(possible, min(n, 1))


def conditions_up_to(n: int, failures: int) -> int:
    """Return the number of conditions with at most `failures` failures, also without failure."""
    return sum(comb(n, count) * len(KINDS) ** count for count in range(failures + 1))


def condition_analysis(system: AnalyzedSystem, failures: int) -> partial[ConditionAnalysis]:
    """Return a function that analyzes a system in all conditions with at most `failures` failures.

    Worst directions are computed only if that takes seconds.
    """
    n, m1, kin = len(system.actuators), len(system.major), system.constrained_system.kinematics()
    # Number of torques that forces at the task and inside the loops can balance.
    balanced = int(np.linalg.matrix_rank(np.vstack([kin.J, kin.active_constraint])))
    speed, force = (
        # A facet is orthogonal to all but one of the columns' independent directions.
        conditions_up_to(n, min(most_failures(n), 2)) * comb(n, max(rank - 1, 0)) <= MOST_SETS
        for rank in (m1 + len(kin.active_constraint), m1 + n - balanced)
    )
    codes = few_failures(n, failures)
    return partial(
        analyze_conditions,
        major=system.major,
        codes=codes,
        rates=system.limits_about_rest(codes) if speed else None,
        torques=system.torques if force else None,
        are_joints=system.robot is not None,
    )


def analyze_postures(
    system: AnalyzedSystem, robot: Robot, count: int, seed: int, on_progress: OnProgress
) -> tuple[list[Array], list[ConditionAnalysis]]:
    """Analyze a robot at sampled postures, in the conditions with the fewest failures.

    Args:
        system: System of the robot at its start.
        robot: Robot of the system.
        count: Number of sampled postures; those whose loops do not close are left out.
        seed: Seed of the scrambling of Sobol's sequence.
        on_progress: Called with the number of analyzed postures and their total.

    Returns:
        Joint positions (nq,) of the task's part of the model, and the analysis, at each posture.
    """
    sampled = sample_postures(robot, count, seed)
    closed = [data for qpos in sampled if (data := _closed(robot, qpos))]
    reader = JacobianReader(robot.scene.task_model, robot.scene.frame, robot.options.axes)
    calls = [{"system": system.constrained_system.at_pose(reader.at(data))} for data in closed]
    n = len(system.actuators)
    analyze = condition_analysis(system, min(most_failures(n), 2 if n <= BOTH_UP_TO else 1))
    results, started = list[ConditionAnalysis](), perf_counter()
    for done, call in enumerate(calls):  # in parallel as soon as the rest is worth it
        on_progress(done, len(calls))
        if done and (perf_counter() - started) * (len(calls) / done - 1) > _ALONE_S:
            break
        results.append(analyze(**call))
    results += in_parallel(analyze, calls[len(results) :], on_progress)
    return [np.array(data.qpos) for data in closed], results


def sample_postures(robot: Robot, count: int, seed: int) -> Array:
    """Return joint positions (count, nq) that fill the ranges of slides and hinges evenly.

    With closed loops only driven joints are sampled. The shape is (0, nq) if there is no joint to
    sample. Without limits, a hinge has a range of pi [rad] to either side of the start, a slide one
    of half the model's extent [m].
    """
    from scipy.stats.qmc import Sobol  # late: not needed for a matrix

    model, start = robot.scene.task_model, robot.scene.task_start.qpos
    joints = np.flatnonzero(one_axis(model))
    if robot.scene.task_start.eq_active.any():
        joints = np.intersect1d(joints, [d.joint for d in drives(model) if d.joint is not None])
    if not joints.size:
        return np.zeros((0, model.nq))
    at, limits = model.jnt_qposadr[joints], ranges(model).joint[model.jnt_dofadr[joints]]
    turns = model.jnt_type[joints] == mujoco.mjtJoint.mjJNT_HINGE
    half_range = np.where(turns, pi, _SLIDES * model.stat.extent)
    default = start[at] + np.array([-half_range, half_range])
    low, high = np.where(np.isfinite(limits.T), limits.T, default)
    sequence = Sobol(len(joints), scramble=True, rng=np.random.default_rng(seed))
    points = sequence.random_base2(ceil(log2(count)) if count > 1 else 0)[:count]
    qpos = np.tile(start, (count, 1))
    qpos[:, at] = low + points * (high - low)
    return qpos


def _closed(robot: Robot, qpos: Array) -> mujoco.MjData | None:
    """Return the state with closed loops nearest to joint positions; None outside joint ranges."""
    model, data = robot.scene.task_model, copy.copy(robot.scene.task_start)
    data.qpos[:] = qpos
    try:
        closed = assemble(model, data)
    except ClosureError:
        return None
    low, high = ranges(model).joint.T
    q = joint_positions(model, closed.qpos)
    inside = (q >= low - _BEYOND) & (q <= high + _BEYOND)
    return closed if inside.all() else None


def at_posture(system: AnalyzedSystem, robot: Robot, qpos: Array, sentence: str) -> AnalyzedSystem:
    """Return a system at another posture (nq,), with a sentence on why."""
    part, at = robot.scene.part, np.array(robot.scene.start.qpos)
    at[... if part is None else part.positions] = qpos
    moved = robot_of(system.file, robot.options, at, settle=False)
    posed = system.constrained_system.at_pose(moved.rigid.nominal)
    return replace(system, robot=moved, constrained_system=posed, instead=sentence)


def numbers_of(system: AnalyzedSystem, at: ConditionAnalysis) -> pd.DataFrame:
    """Return a row for each condition at a posture, with the remaining capability.

    Names of columns include units. Infinite and undefined values are NaN.
    """
    major = common(tuple(system.row_units[row] for row in system.major))
    units = common(system.units)
    speed, force = _WORST[major]
    columns = {
        "survived": at.survived,
        speed: at.classes.worst_speed,
        f"{system.measure}_left": at.speed_left,
        force: at.classes.worst_force,
        "force_left": at.force_left,
        "relative_manipulability": at.relative_manipulability,
        "best_possible": at.best_possible,
        _ratio("largest_gain", units, major): at.largest_gain,
        _ratio("error_gain", major, units): at.error_gain,
        "rank_gap": at.classes.gap,
    }
    if system.torques is None:
        del columns[force], columns["force_left"]
    frame = pd.DataFrame(columns, index=range(len(at.codes)))
    return frame.astype(dict.fromkeys(frame.columns[1:], float)).replace([np.inf, -np.inf], np.nan)


_WORST = {
    "rad": ("worst_speed_rad_per_s", "worst_torque_nm"),
    "m": ("worst_speed_m_per_s", "worst_force_n"),
    "mixed": ("worst_speed_rad_and_m_per_s", "worst_force_n_and_nm"),
    "1": ("worst_effect", ""),
}
"""Columns of the worst speed and force, by the unit of the major task."""


def _ratio(name: str, over: str, under: str) -> str:
    """Return the name of a gain's column, with its unit unless this is 1."""
    unit = "" if over == under else f"_{over}_per_{under}"
    return name + unit.replace("mixed", "rad_and_m")


def condition_frame(survey: Survey) -> pd.DataFrame:
    """Return labels and numbers of each condition, at the start and for a robot over postures."""
    system, start, codes = survey.system, survey.start, survey.start.codes
    names, secondary = system.actuators, [system.rows[row] for row in system.secondary]
    labels = {
        "failed": [condition_text(code, names) for code in codes],
        "failures": start.failures,
        "locked": [failed(code, names, LOCKED) for code in codes],
        "free": [failed(code, names, FREE) for code in codes],
        "major_task": [start.classification(row) for row in range(len(codes))],
        "lost_secondary": [
            directions_text(start.lost(row), secondary) if secondary and survived else None
            for row, survived in enumerate(start.survived)
        ],
    }
    rows = survey.rows
    numbers = rows[rows.posture == 0].drop(columns=["posture", "condition", "possible"])
    frame = pd.concat([pd.DataFrame(labels), numbers], axis=1)
    if system.robot is None:
        return frame
    possible = rows[rows.possible].groupby("condition").survived
    frame["share_of_postures"] = possible.mean().where(possible.size() > 1)
    others = rows[rows.posture > 0].groupby("condition")
    for quantity, extreme in _OVER_POSTURES.items():
        (name,) = (column for column in numbers if column.startswith(quantity))
        worst = others[name].min() if extreme == "least" else others[name].max()
        frame[f"{name}_median_over_postures"] = others[name].median()
        frame[f"{name}_{extreme}_over_postures"] = worst
    return frame


_OVER_POSTURES = {
    "worst_speed": "least",
    "relative_manipulability": "least",
    "largest_gain": "greatest",
}
"""Columns that are summarized over postures, and which of their extremes is the worst."""


def actuator_frame(survey: Survey) -> pd.DataFrame:
    """Return a row for each actuator: its limits, and what remains after its failures.

    `left_locked`, `left_free`: remaining fraction of the speed, or effect, in the worst direction,
    averaged over start and postures. `doubles_survived`: fraction of double failures with this
    actuator that are survived at the start. `costs_most`: whether the mean loss, locked and free,
    is largest (of equal ones, with least `doubles_survived`).
    """
    system, start, able = survey.system, survey.start, survey.rows[survey.rows.possible]
    frame = pd.DataFrame({"actuator": system.actuators, "unit": system.units})
    frame["lower"], frame["upper"] = system.rates
    if system.torques is not None:
        frame["lower_force"], frame["upper_force"] = system.torques
    mean = able[f"{system.measure}_left"].where(able.survived, 0.0).groupby(able.condition).mean()
    left = mean.reindex(start.singles.ravel()).to_numpy().reshape(-1, 2)
    frame["left_locked"], frame["left_free"] = left.T
    pairs = start.failures == 2
    has = start.codes[pairs] != HEALTHY
    doubles = pd.Series((has & start.survived[pairs, None]).sum(axis=0)) / has.sum(axis=0)
    frame["doubles_survived"] = doubles
    loss, doubles = 1.0 - left.mean(axis=1), doubles.fillna(1.0).to_numpy()
    near = ~exceeds(loss.max(), loss, _LOSS_TIE) & np.isfinite(loss)
    fewest = np.where(near, doubles, np.inf).min()
    frame["costs_most"] = near & ~exceeds(doubles, fewest, _LOSS_TIE)
    return frame.replace([np.inf, -np.inf], np.nan)


def checks(system: AnalyzedSystem, start: ConditionAnalysis) -> list[Check]:
    """Return checks of class and speed in some conditions, analyzed again one by one."""
    codes, differ, off = start.codes, 0, [0.0]
    limits = [np.broadcast_to(side, codes.shape) for side in system.limits_about_rest(codes)]
    for row in range(0, len(codes), max(1, len(codes) // _RECHECKED)):
        locked, free = np.flatnonzero(codes[row] == LOCKED), np.flatnonzero(codes[row] == FREE)
        if not start.are_joints:
            locked, free = np.flatnonzero(codes[row]), free[:0]
        kin = system.constrained_system.with_failures(locked.tolist(), free.tolist()).kinematics()
        differ += start.classes.possible[row] != is_possible(kin.manipulability(system.major))
        if (speeds := start.classes.worst_speed) is not None:
            alone = kin.attainable(system.major, (limits[0][row], limits[1][row])).radius
            if alone != speeds[row]:
                off.append(abs(alone - speeds[row]) / max(alone, speeds[row]))
    results = check("classifications that differ", differ, 0.5, "one by one")
    what = f"relative difference of the {system.measure}"
    return results + check(what, np.max(off), 1e-6, "one by one")
