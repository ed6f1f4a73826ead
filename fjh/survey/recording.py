"""The directions that single failures cost, as motions of the robot: one recording, a cell each.

What the sound robot can do there and the failed one cannot; or, where a free actuator lets the
robot move with every other one held, that motion.
"""

from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from fjh.recording.file import RecordingInfo
from fjh.recording.layout import write_scenes
from fjh.recording.scene import Scene, condition_scene
from fjh.recording.signals import Plot
from fjh.rig.bodies import body_name
from fjh.rig.condition_analysis import ConditionAnalysis, directions_text
from fjh.rig.conditions import KINDS, condition_text, listed
from fjh.study.result import literal
from fjh.survey.subject import Subject, common
from prioritized import Kinematics
from sim import Array
from sim.mjcf import drives

MOST = 6  # cells that a screen has room for, one recording
_SIZE = 1e-3  # largest joint velocity times time, [rad] or [m]: loops stay closed to first order
_PERIOD_S, _RATE_HZ = 2.0, 25
_PART = 0.05  # smallest part of a direction that counts for its unit
_SAME = 0.02
"""Difference of unit vectors that a reader takes for one direction: springs give way a little."""


@dataclass(frozen=True, eq=False)
class Loss:
    """A direction of the task, and the failures that cost it or let the robot drift along it."""

    direction: Array  # of the task rows, a unit vector (m,)
    velocities: Array  # along it, of all joints, then of drives that are no joints, (N,)
    drifts: bool  # whether it is a self-motion of the failed robot
    rows: list[int]  # of the conditions

    def is_along(self, other: "Loss") -> bool:
        """Whether a reader takes both for the same."""
        apart = (np.abs(self.direction - s * other.direction).max() for s in (-1, 1))
        return self.drifts == other.drifts and min(apart) < _SAME


def losses(subject: Subject, start: ConditionAnalysis) -> list[Loss]:
    """Each direction once, with all single failures that cost it, in the order of these."""
    found = list[Loss]()
    if subject.robot is None or not start.survived[0]:
        return found
    for row in start.singles.T.ravel().tolist():
        for loss in _of_condition(subject, start, row):
            same = next((each for each in found if each.is_along(loss)), None)
            if same is None:
                found.append(loss)
            else:
                same.rows.append(row)
    return found


def _of_condition(subject: Subject, start: ConditionAnalysis, row: int) -> list[Loss]:
    """Lost major directions, lost secondary ones if the major task is kept, and self-motions."""
    major, secondary = list(subject.major), list(subject.secondary)
    failures = {word: np.flatnonzero(start.codes[row] == kind) for kind, word in KINDS.items()}
    sound = subject.system.kinematics()
    failed = subject.system.with_failures(**failures).kinematics()
    bases = failed.manipulability(major).bases
    mapping = sound.velocity_mapping(major, secondary_weight=np.ones(len(secondary)))
    lost = [(major, part) for part in bases["unmanipulable"].T]
    if start.survived[row]:
        lost += [(secondary, part) for part in start.lost(row).T]
    found = []
    for rows, part in lost:
        direction = np.zeros(len(subject.rows))
        direction[rows] = part
        rates = mapping(direction[major], secondary_velocity=direction[secondary])
        found.append(Loss(direction, sound.velocities(rates), False, [row]))
    return found + [
        Loss(each, self_motion(failed, subject.system.J_T, each), True, [row])
        for each in bases["unstable"].T
    ]


def self_motion(kin: Kinematics, J_T: Array, direction: Array) -> Array:
    """Velocities (N,) with every actuator at rest that move the task in a direction (m,)."""
    velocities, free = np.zeros(J_T.shape[1]), kin.passive_self_motion
    along = np.linalg.lstsq(J_T[:, kin.passive] @ free, direction, rcond=None)[0]
    velocities[kin.passive] = free @ along
    return velocities


def write_losses(
    subject: Subject, start: ConditionAnalysis, command: str, verdict: str, folder: Path
) -> None:
    """Write `survey.rrd`, and `survey_2.rrd` and so on where a screen is too small for all.

    Nothing is written where nothing is lost.
    """
    found = losses(subject, start)
    results = {"study": "survey", "robot": subject.title, "verdict": verdict}
    properties = {"model_sha256": subject.sha256, "command": command}
    for begin in range(0, len(found), MOST):
        shown, number = found[begin : begin + MOST], f"_{begin // MOST + 1}" * (begin > 0)
        titles = [title(subject, start, loss, most=99) for loss in shown]
        notes = "\n- ".join([f"# {literal(subject.title)}\n", *map(literal, titles)])
        notes += f"\n\n{len(shown)} of {len(found)} directions. Made by `{command}`."
        identity, name = f"survey-{subject.title}{number}", f"Survey of {subject.title}{number}"
        about = RecordingInfo(identity, name, notes, properties, results)
        scenes = {title(subject, start, loss): _scene(subject, start, loss) for loss in shown}
        write_scenes(folder / f"survey{number}.rrd", about, scenes, pages=False)


def title(subject: Subject, start: ConditionAnalysis, loss: Loss, most: int = 3) -> str:
    """The failures, of many the first, and the direction."""
    failures = [condition_text(start.codes[row], subject.actuators) for row in loss.rows]
    what = directions_text(loss.direction[:, None], subject.rows)
    return f"{listed(failures, 'or', most)}: {what} {'drifts' if loss.drifts else 'is lost'}"


def _scene(subject: Subject, start: ConditionAnalysis, loss: Loss) -> Scene:
    """All joints swing slowly about the start; bodies that failed actuators move are named."""
    assert subject.robot is not None  # a matrix has no losses
    model, nominal = subject.robot.scene.task_model, np.array(subject.robot.scene.task_start.qpos)
    joints = loss.velocities[: model.nv]  # behind them: of drives that are no joints
    # It ends at its largest: the viewer opens there.
    time_s = np.arange(round(1.25 * _PERIOD_S * _RATE_HZ) + 1) / _RATE_HZ
    wave = _SIZE / np.abs(joints).max() * np.sin(2 * np.pi * time_s / _PERIOD_S)
    qpos = np.tile(nominal, (len(time_s), 1))
    for each, size in zip(qpos, wave, strict=True):
        mujoco.mj_integratePos(model, each, joints, size)
    values = 1e6 * np.outer(wave, [not loss.drifts, loss.drifts])
    along = np.flatnonzero(np.abs(loss.direction) > _PART)
    unit = common(tuple(f"u{subject.row_units[k]}" for k in along)).replace("mixed", "1e-6 rad, m")
    names = ("without failures", "after the failure")
    plot = Plot("along", f"along the direction [{unit}]", names, time_s, values)
    failing, codes = [], start.codes[loss.rows]
    for drive, name, own in zip(drives(model), subject.actuators, codes.T, strict=True):
        if own.any() and drive.joint is not None:
            kinds = [word for kind, word in KINDS.items() if kind in own]
            body = body_name(model, int(model.jnt_bodyid[drive.joint]))
            failing.append(([body], [(0.0, f"{name} {listed(kinds, 'or')}")]))
    return condition_scene(model, time_s, qpos, [plot], nominal=nominal, failing=failing)
