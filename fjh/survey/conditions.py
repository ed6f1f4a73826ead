"""What is examined of a subject, and where; every condition at every posture in one data frame."""

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
from fjh.survey.subject import Subject, common
from ftc import is_possible
from sim import Array, ClosureError, JacobianReader, assemble, ranges
from sim.mjcf import drives, joint_positions, one_axis

MOST_CONDITIONS = 20_000  # of one posture: a second or two for ten actuators
MOST_SETS = 1_000_000
"""Sets of actuators that are tried for the worst directions of all conditions: a few seconds."""
BOTH_UP_TO = 12
"""Actuators; with more, other postures than the start are examined for single failures alone."""
_SLIDES = 0.5  # of the model's extent, either way: range of a slide that has no limits
_BEYOND = 1e-6  # [rad] or [m], by which round-off may put a joint outside its range
_ALONE_S = 4.0  # work that starting further processes is not worth
_RECHECKED = 24  # conditions that are examined alone as well: a fraction of a second
_ALIKE = 0.02  # part by which equal losses may differ: no drawn postures are quite symmetric


class Survey(NamedTuple):
    """What was examined.

    Attributes:
        subject: At the start, or at the posture that stands for it.
        start: All conditions with few failures there, the sound one first.
        rows: What is left at each `posture` (0: the start) in each `condition` (its number in
            `start`), a row each as of :func:`numbers_of`; `possible`: whether the sound robot does
            the task at that posture.
        postures: Joint positions `qpos` (nq,) at the other postures, a row each, by number.
        counts: How many conditions survive at the start, a row for each number of failures.
    """

    subject: Subject
    start: ConditionAnalysis
    rows: pd.DataFrame
    postures: pd.DataFrame
    counts: pd.DataFrame

    def left_out(self) -> Iterator[str]:
        """What was not examined, in two sentences at most."""
        n, most = len(self.subject.actuators), int(self.counts.failures.max())
        if most < n:
            few = f"at most {most} failures ({self.counts.conditions.sum():,})"
            if self.rows.condition.iloc[-1] < len(self.start.codes) - 1:
                few += ", at other postures than the start with one,"
            yield f"Of the {len(KINDS) + 1}^{n} conditions those with {few} were examined."
        left = self.start.classes
        worst = {self.subject.measure: left.worst_speed}
        worst |= {} if self.subject.torques is None else {"force": left.worst_force}
        if missing := " and ".join(what for what, values in worst.items() if values is None):
            yield (
                f"The {missing} left in the worst direction was not computed: too many sets of "
                "actuators would have to be tried; fewer major rows need fewer."
            )


def surveyed(subject: Subject, postures: int, seed: int, on_progress: OnProgress) -> Survey:
    """Examine a subject at its start, and a robot at so many postures that are drawn."""
    most, found, qpos = (
        most_failures(len(subject.actuators)),
        list[ConditionAnalysis](),
        list[Array](),
    )
    at_start = of_conditions(subject, min(most, 2))
    start = at_start(subject.system, on_progress=on_progress)
    if (robot := subject.robot) is not None and postures > 0:
        qpos, found = examined_elsewhere(subject, robot, postures, seed, on_progress)
        if not start.survived[0] and any(each.survived[0] for each in found):
            best = least([each.largest_gain[0] for each in found])
            said = (
                f"At the start {start.reason(0)}: posture {best + 1} of the others stands for it."
            )
            subject = at_posture(subject, robot, qpos[best], said)
            start = at_start(subject.system, on_progress=on_progress)
    every = start
    if most > 2:
        every = of_conditions(subject, most)(subject.system, on_progress=on_progress)
    survived = pd.Series(every.survived).groupby(every.failures)
    counts = survived.agg(conditions="size", survived="sum").rename_axis("failures").reset_index()
    frames = dict(enumerate(numbers_of(subject, each) for each in (start, *found)))
    rows = pd.concat(frames, names=["posture", "condition"]).reset_index()
    rows["possible"] = rows.groupby("posture").survived.transform("first")
    drawn = pd.DataFrame({"posture": range(1, len(qpos) + 1), "qpos": qpos})
    return Survey(subject, start, rows, drawn, counts)


def most_failures(n: int) -> int:
    """At once, so that the conditions of one posture are examined within seconds."""
    possible = (k for k in range(n, 1, -1) if conditions_up_to(n, k) <= MOST_CONDITIONS)
    return next(possible, min(n, 1))


def conditions_up_to(n: int, failures: int) -> int:
    """Number of conditions with at most so many failures, the sound one among them."""
    return sum(comb(n, count) * len(KINDS) ** count for count in range(failures + 1))


def of_conditions(subject: Subject, failures: int) -> partial[ConditionAnalysis]:
    """A function of a system: what all conditions with at most so many failures leave of it.

    What is left in the worst direction is computed where that takes seconds.
    """
    n, m1, kin = len(subject.actuators), len(subject.major), subject.system.kinematics()
    # Of the torques so many are held by forces at the task and inside the loops.
    held = int(np.linalg.matrix_rank(np.vstack([kin.J, kin.active_constraint])))
    speed, force = (
        # A facet is orthogonal to all but one of the columns' independent directions.
        conditions_up_to(n, min(most_failures(n), 2)) * comb(n, max(rank - 1, 0)) <= MOST_SETS
        for rank in (m1 + len(kin.active_constraint), m1 + n - held)
    )
    codes = few_failures(n, failures)
    return partial(
        analyze_conditions,
        major=subject.major,
        codes=codes,
        rates=subject.limits_about_rest(codes) if speed else None,
        torques=subject.torques if force else None,
        are_joints=subject.robot is not None,
    )


def examined_elsewhere(
    subject: Subject, robot: Robot, count: int, seed: int, on_progress: OnProgress
) -> tuple[list[Array], list[ConditionAnalysis]]:
    """The first conditions of the start at other postures of a robot, as far as these close.

    Args:
        subject: The robot as it is surveyed.
        robot: Its model.
        count: Of the postures that are drawn.
        seed: Of the scrambling of Sobol's sequence.
        on_progress: Called with the examined and the total number.

    Returns:
        Joint positions (nq,) of the model that the task involves, and what is left there, of each.
    """
    closed = [data for qpos in drawn(robot, count, seed) if (data := _closed(robot, qpos))]
    reader = JacobianReader(robot.scene.task_model, robot.scene.frame, robot.options.axes)
    systems = [{"system": subject.system.at_pose(reader.at(data))} for data in closed]
    n = len(subject.actuators)
    examined_at = of_conditions(subject, min(most_failures(n), 2 if n <= BOTH_UP_TO else 1))
    found, begun = list[ConditionAnalysis](), perf_counter()
    for done, system in enumerate(systems):  # in parallel once those so far show that it takes long
        on_progress(done, len(systems))
        if done and (perf_counter() - begun) * (len(systems) / done - 1) > _ALONE_S:
            break
        found.append(examined_at(**system))
    found += in_parallel(examined_at, systems[len(found) :], on_progress)
    return [np.array(data.qpos) for data in closed], found


def drawn(robot: Robot, count: int, seed: int) -> Array:
    """Joint positions (count, nq) with slides and hinges over their ranges, others as at the start.

    Where loops tie them, driven ones alone; none (0, nq) where there are no such joints. A hinge
    without limits turns by pi either way; a slide moves by half the model's extent.
    """
    from scipy.stats.qmc import Sobol  # late: a matrix does not wait for it

    model, start = robot.scene.task_model, robot.scene.task_start.qpos
    joints = np.flatnonzero(one_axis(model))
    if robot.scene.task_start.eq_active.any():
        joints = np.intersect1d(joints, [d.joint for d in drives(model) if d.joint is not None])
    if not joints.size:
        return np.zeros((0, model.nq))
    at, limits = model.jnt_qposadr[joints], ranges(model).joint[model.jnt_dofadr[joints]]
    turns = model.jnt_type[joints] == mujoco.mjtJoint.mjJNT_HINGE
    reach = np.where(turns, pi, _SLIDES * model.stat.extent)
    usual = start[at] + np.array([-reach, reach])
    low, high = np.where(np.isfinite(limits.T), limits.T, usual)
    sequence = Sobol(len(joints), scramble=True, rng=np.random.default_rng(seed))
    points = sequence.random_base2(ceil(log2(count)) if count > 1 else 0)[:count]
    qpos = np.tile(start, (count, 1))
    qpos[:, at] = low + points * (high - low)
    return qpos


def _closed(robot: Robot, qpos: Array) -> mujoco.MjData | None:
    """The nearest posture with closed loops; None without one inside the joint ranges."""
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


def at_posture(subject: Subject, robot: Robot, qpos: Array, said: str) -> Subject:
    """A robot at another posture (nq,) than its start, and the sentence that says so."""
    part, at = robot.scene.part, np.array(robot.scene.start.qpos)
    at[... if part is None else part.positions] = qpos
    moved = robot_of(subject.file, robot.options, at, settle=False)
    system = subject.system.at_pose(moved.rigid.nominal)
    return replace(subject, robot=moved, system=system, instead=said)


def numbers_of(subject: Subject, at: ConditionAnalysis) -> pd.DataFrame:
    """What each condition leaves at a posture; NaN where it is infinite or there is none.

    Columns have the units of the subject.
    """
    major = common(tuple(subject.row_units[row] for row in subject.major))
    units = common(subject.units)
    speed, force = _WORST[major]
    found = {
        "survived": at.survived,
        speed: at.classes.worst_speed,
        f"{subject.measure}_left": at.speed_left,
        force: at.classes.worst_force,
        "force_left": at.force_left,
        "relative_manipulability": at.relative_manipulability,
        "best_possible": at.best_possible,
        _ratio("largest_gain", units, major): at.largest_gain,
        _ratio("error_gain", major, units): at.error_gain,
        "rank_gap": at.classes.gap,
    }
    if subject.torques is None:
        del found[force], found["force_left"]
    frame = pd.DataFrame(found, index=range(len(at.codes)))
    return frame.astype(dict.fromkeys(frame.columns[1:], float)).replace([np.inf, -np.inf], np.nan)


_WORST = {
    "rad": ("worst_speed_rad_per_s", "worst_torque_nm"),
    "m": ("worst_speed_m_per_s", "worst_force_n"),
    "mixed": ("worst_speed_rad_and_m_per_s", "worst_force_n_and_nm"),
    "1": ("worst_effect", ""),
}
"""Of the worst speed and force, by the unit of the major task."""


def _ratio(name: str, over: str, under: str) -> str:
    """Column of a gain, with its unit where it has one."""
    unit = "" if over == under else f"_{over}_per_{under}"
    return name + unit.replace("mixed", "rad_and_m")


def condition_frame(found: Survey) -> pd.DataFrame:
    """A row for each condition at the start: words, numbers, and of a robot those over postures."""
    subject, start, codes = found.subject, found.start, found.start.codes
    names, secondary = subject.actuators, [subject.rows[row] for row in subject.secondary]
    words = {
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
    numbers = found.rows[found.rows.posture == 0].drop(columns=["posture", "condition", "possible"])
    frame = pd.concat([pd.DataFrame(words), numbers], axis=1)
    if subject.robot is None:
        return frame
    able = found.rows[found.rows.possible].groupby("condition").survived
    frame["share_of_postures"] = able.mean().where(able.size() > 1)
    elsewhere = found.rows[found.rows.posture > 0].groupby("condition")
    for of, extreme in _OVER_POSTURES.items():
        (name,) = (each for each in numbers if each.startswith(of))
        worst = elsewhere[name].min() if extreme == "least" else elsewhere[name].max()
        frame[f"{name}_median_over_postures"] = elsewhere[name].median()
        frame[f"{name}_{extreme}_over_postures"] = worst
    return frame


_OVER_POSTURES = {
    "worst_speed": "least",
    "relative_manipulability": "least",
    "largest_gain": "greatest",
}
"""Numbers of which the median and the worst over postures are told."""


def actuator_frame(found: Survey) -> pd.DataFrame:
    """A row for each actuator: its limits, and what its failures leave.

    `left_locked`, `left_free`: of the speed, or effect, of the sound robot in the worst direction,
    in the mean over start and workspace. `doubles_survived`: part of the double failures with it
    that are survived at the start. `costs_most`: it leaves least in the mean of locked and free,
    then has the fewest doubles, as have all others that are marked.
    """
    subject, start, able = found.subject, found.start, found.rows[found.rows.possible]
    frame = pd.DataFrame({"actuator": subject.actuators, "unit": subject.units})
    frame["lower"], frame["upper"] = subject.rates
    if subject.torques is not None:
        frame["lower_force"], frame["upper_force"] = subject.torques
    kept = able[f"{subject.measure}_left"].where(able.survived, 0.0).groupby(able.condition).mean()
    left = kept.reindex(start.singles.ravel()).to_numpy().reshape(-1, 2)
    frame["left_locked"], frame["left_free"] = left.T
    pairs = start.failures == 2
    has = start.codes[pairs] != HEALTHY
    doubles = pd.Series((has & start.survived[pairs, None]).sum(axis=0)) / has.sum(axis=0)
    frame["doubles_survived"] = doubles
    loss, doubles = 1.0 - left.mean(axis=1), doubles.fillna(1.0).to_numpy()
    near = ~exceeds(loss.max(), loss, _ALIKE) & np.isfinite(loss)
    fewest = np.where(near, doubles, np.inf).min()
    frame["costs_most"] = near & ~exceeds(doubles, fewest, _ALIKE)
    return frame.replace([np.inf, -np.inf], np.nan)


def checks(subject: Subject, start: ConditionAnalysis) -> list[Check]:
    """Some conditions each classified alone: verdicts that differ, and what is left."""
    codes, differ, off = start.codes, 0, [0.0]
    limits = [np.broadcast_to(side, codes.shape) for side in subject.limits_about_rest(codes)]
    for row in range(0, len(codes), max(1, len(codes) // _RECHECKED)):
        locked, free = np.flatnonzero(codes[row] == LOCKED), np.flatnonzero(codes[row] == FREE)
        if not start.are_joints:
            locked, free = np.flatnonzero(codes[row]), free[:0]
        kin = subject.system.with_failures(locked.tolist(), free.tolist()).kinematics()
        differ += start.classes.possible[row] != is_possible(kin.manipulability(subject.major))
        if (speeds := start.classes.worst_speed) is not None:
            alone = kin.attainable(subject.major, (limits[0][row], limits[1][row])).radius
            if alone != speeds[row]:
                off.append(abs(alone - speeds[row]) / max(alone, speeds[row]))
    found = check("verdicts that differ", differ, 0.5, "one by one")
    return found + check("relative difference of what is left", np.max(off), 1e-6, "one by one")
