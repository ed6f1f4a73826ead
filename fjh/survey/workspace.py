"""How much of a subject is examined; and what failures leave over the workspace of a robot."""

import copy
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from math import ceil, comb, log2, pi
from time import perf_counter
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from argument_checks.ties import least
from fjh.rig.conditions import KINDS, few_failures
from fjh.rig.examined import Examined, examine
from fjh.rig.robot import Robot
from fjh.study.option import OnProgress
from fjh.study.workers import in_parallel
from fjh.survey.subject import Subject
from sim import Array, ClosureError, JacobianReader, assemble, ranges
from sim.mjcf.ranges import joint_positions, one_axis
from sim.mjcf.transmission import drives

MOST_CONDITIONS = 20_000  # of one posture: a second or two for ten actuators
MOST_SETS = 1_000_000
"""Sets of actuators that are tried for the worst directions of all conditions: a few seconds."""
BOTH_UP_TO = 12
"""Actuators; with more, other postures than the start are examined for single failures alone."""
_SLIDES = 0.5  # of the model's extent, either way: range of a slide that has no limits
_BEYOND = 1e-6  # [rad] or [m], by which round-off may put a joint outside its range
_ALONE_S = 4.0  # work that starting further processes is not worth


@dataclass(frozen=True)
class Extent:
    """What can be examined within seconds: up to how many failures at once, and which numbers."""

    listed: int  # every condition is in the table
    counted: int  # conditions are counted
    elsewhere: int  # at other postures than the start
    speed: bool  # whether the worst speed is computed
    force: bool  # whether the worst force is

    def left_out(self, subject: Subject) -> Iterator[str]:
        """What is not examined, a sentence each."""
        n = len(subject.actuators)
        if self.counted < n:
            few = f"at most {self.counted} failures ({conditions_up_to(n, self.counted):,})"
            yield f"Of the {len(KINDS) + 1}^{n} conditions those with {few} were examined."
        wanted = {subject.measure: self.speed}
        if subject.torques is not None:
            wanted["force"] = self.force
        for what, computed in wanted.items():
            if not computed:
                yield (
                    f"The {what} left in the worst direction was not computed: too many sets of "
                    "actuators would have to be tried; fewer major rows need fewer."
                )
        if not self.speed:
            yield f"Limits of the {subject.measure} did not decide whether a failure is survived."
        if subject.robot is not None and self.elsewhere < self.listed:
            yield "At other postures than the start single failures alone were examined."


def extent_of(subject: Subject) -> Extent:
    """What is examined, from the numbers of actuators, rows and constraints."""
    n, m1, kin = len(subject.actuators), len(subject.major), subject.system.kinematics()
    possible = (k for k in range(n, 1, -1) if conditions_up_to(n, k) <= MOST_CONDITIONS)
    counted = next(possible, min(n, 1))
    listed = min(counted, 2)
    # Of the torques so many are held by forces at the task and inside the loops.
    held = int(np.linalg.matrix_rank(np.vstack([kin.J, kin.active_constraint])))
    speed, force = (
        # A facet is orthogonal to all but one of the columns' independent directions.
        conditions_up_to(n, listed) * comb(n, max(rank - 1, 0)) <= MOST_SETS
        for rank in (m1 + len(kin.active_constraint), m1 + n - held)
    )
    return Extent(listed, counted, listed if n <= BOTH_UP_TO else min(listed, 1), speed, force)


def conditions_up_to(n: int, failures: int) -> int:
    """Number of conditions with at most so many failures, the sound one among them."""
    return sum(comb(n, count) * len(KINDS) ** count for count in range(failures + 1))


@dataclass(frozen=True, eq=False)
class Workspace:
    """The first C conditions of the start at P other postures."""

    qpos: Array  # of the model that the task involves, shape (P, nq)
    survived: NDArray[np.bool_]  # (P, C)
    speed: Array | None  # worst major speed, (P, C); None where it is not computed
    speed_left: Array  # the same over that of the sound robot, NaN where that has none, (P, C)
    relative: Array  # manipulability; NaN where the sound robot cannot do the task, (P, C)
    largest_gain: Array  # infinite where the task is lost, (P, C)
    tried: int  # postures drawn; the others could not be closed within the joint ranges


def workspace_of(
    subject: Subject, robot: Robot, extent: Extent, count: int, seed: int, on_progress: OnProgress
) -> Workspace | None:
    """The numbers at so many postures of a robot; None where it has no other that can be closed.

    Args:
        subject: The robot as it is surveyed.
        robot: Its model.
        extent: What is examined.
        count: Of the postures that are drawn.
        seed: Of the scrambling of Sobol's sequence.
        on_progress: Called with the examined and the total number.
    """
    closed = [data for qpos in drawn(robot, count, seed) if (data := _closed(robot, qpos))]
    scene = robot.scene
    reader = JacobianReader(scene.own, scene.frame, robot.options.axes)
    examined_at = partial(
        examine,
        major=subject.major,
        codes=few_failures(len(subject.actuators), extent.elsewhere),
        rates=subject.rates.values if extent.speed else None,
        torques=subject.torques.values if subject.torques and extent.force else None,
    )
    systems = [{"system": subject.system.at_pose(reader.at(data))} for data in closed]
    found = _all(examined_at, systems, on_progress)
    if not found:
        return None
    computed = found[0].left.worst_speed is not None
    return Workspace(
        qpos=np.array([data.qpos for data in closed]),
        survived=np.array([each.survived for each in found]),
        speed=np.array([each.left.worst_speed for each in found]) if computed else None,
        speed_left=np.array([each.speed_left for each in found]),
        relative=np.array([each.relative_manipulability for each in found]),
        largest_gain=np.array([each.largest_gain for each in found]),
        tried=count,
    )


def drawn(robot: Robot, count: int, seed: int) -> Array:
    """Joint positions (count, nq) with slides and hinges over their ranges, others as at the start.

    Where loops tie them, driven ones alone; none (0, nq) where there are no such joints. A hinge
    without limits turns by pi either way; a slide moves by half the model's extent.
    """
    from scipy.stats.qmc import Sobol  # late: a matrix does not wait for it

    model, start = robot.scene.own, robot.scene.own_start.qpos
    joints = np.flatnonzero(one_axis(model))
    if robot.scene.own_start.eq_active.any():
        joints = np.intersect1d(joints, [d.joint for d in drives(model) if d.joint is not None])
    if not joints.size:
        return np.zeros((0, model.nq))
    at, velocities = model.jnt_qposadr[joints], model.jnt_dofadr[joints]
    low, high = ranges(model).joint[velocities].T
    turns = model.jnt_type[joints] == mujoco.mjtJoint.mjJNT_HINGE
    reach = np.where(turns, pi, _SLIDES * model.stat.extent)
    low = np.where(np.isfinite(low), low, start[at] - reach)
    high = np.where(np.isfinite(high), high, start[at] + reach)
    sequence = Sobol(len(joints), scramble=True, rng=np.random.default_rng(seed))
    points = sequence.random_base2(ceil(log2(count)) if count > 1 else 0)[:count]
    qpos = np.tile(start, (count, 1))
    qpos[:, at] = low + points * (high - low)
    return qpos


def at_best_posture(subject: Subject, robot: Robot, workspace: Workspace, lost: str) -> Subject:
    """The robot at the posture with the least gain from the task to the actuators.

    Args:
        subject: The robot at a start at which the task is not possible.
        robot: Its model.
        workspace: Where it is possible at some postures.
        lost: Why it is not at the start.
    """
    best = least(workspace.largest_gain[:, 0])
    scene, own = robot.scene, copy.copy(robot.scene.own_start)
    own.qpos[:] = workspace.qpos[best]
    mujoco.mj_fwdPosition(scene.own, own)
    start = own
    if scene.part is not None:
        start = copy.copy(scene.start)
        start.qpos[scene.part.positions] = own.qpos
        mujoco.mj_fwdPosition(scene.whole, start)
    moved = replace(robot, scene=replace(scene, start=start, own_start=own))
    said = f"At the start {lost}: instead of it stands the best of the postures, number {best}"
    return replace(
        subject,
        robot=moved,
        system=subject.system.at_pose(moved.rigid.nominal),
        instead=f"{said}.",
    )


def _closed(robot: Robot, qpos: Array) -> mujoco.MjData | None:
    """The nearest posture with closed loops; None without one inside the joint ranges."""
    model, data = robot.scene.own, copy.copy(robot.scene.own_start)
    data.qpos[:] = qpos
    try:
        closed = assemble(model, data)
    except ClosureError:
        return None
    low, high = ranges(model).joint.T
    q = joint_positions(model, closed.qpos)
    inside = (q >= low - _BEYOND) & (q <= high + _BEYOND)
    return closed if inside.all() else None


def _all(
    examined_at: partial[Examined], systems: list[dict[str, Any]], on_progress: OnProgress
) -> list[Examined]:
    """Of all postures; in parallel once those so far show that it takes long."""
    found, begun = [], perf_counter()
    for done, system in enumerate(systems):
        on_progress(done, len(systems))
        spent = perf_counter() - begun
        if found and spent / done * (len(systems) - done) > _ALONE_S:
            break
        found.append(examined_at(**system))
    return found + in_parallel(examined_at, systems[len(found) :], on_progress)
