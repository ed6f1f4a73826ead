"""Postures over the workspace of a robot, and what failures leave at each of them."""

import copy
from dataclasses import replace
from functools import partial
from math import ceil, log2, pi
from time import perf_counter
from typing import Any

import mujoco
import numpy as np

from argument_checks.ties import least
from experiments.rig.conditions import few_failures
from experiments.rig.examined import Examined, examine
from experiments.rig.robot import Robot
from experiments.study.parallel import in_parallel
from experiments.study.study import OnProgress
from experiments.survey.extent import Extent
from experiments.survey.survey import Subject, Workspace
from sim import Array, ClosureError, JacobianReader, assemble, ranges
from sim.mjcf.ranges import joint_positions, one_axis
from sim.mjcf.transmission import drives

_SLIDES = 0.5
"""Of the model's extent, either way: range of a slide that has no limits."""
_BEYOND = 1e-6
"""[rad] or [m], by which round-off may put a joint outside its range."""
_ALONE_S = 4.0
"""Work that starting further processes is not worth."""


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
    return _stacked(found, [data.qpos for data in closed], count) if found else None


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


def _stacked(found: list[Examined], qpos: list[Array], tried: int) -> Workspace:
    computed = found[0].left.worst_speed is not None
    return Workspace(
        qpos=np.array(qpos),
        survived=np.array([each.survived for each in found]),
        speed=np.array([each.left.worst_speed for each in found]) if computed else None,
        speed_left=np.array([each.speed_left for each in found]),
        relative=np.array([each.relative_manipulability for each in found]),
        largest_gain=np.array([each.largest_gain for each in found]),
        tried=tried,
        unusable=tried - len(found),
    )
