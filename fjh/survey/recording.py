"""The directions that single failures cost, as motions of the robot: one recording, a cell each.

What the sound robot can do there and the failed one cannot; or, where a free actuator lets the
robot move with every other one held, that motion.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np

from fjh.recording.file import RecordingInfo
from fjh.recording.layout import write_scenes
from fjh.recording.machine import Failing
from fjh.recording.scene import Scene, condition_scene
from fjh.recording.signals import Plot
from fjh.rig.bodies import body_name
from fjh.rig.conditions import KINDS, listed
from fjh.rig.examined import Examined, directions_in_words
from fjh.study.result import literal
from fjh.survey.subject import Subject, common
from prioritized import Kinematics
from sim import Array
from sim.mjcf.transmission import drives

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
    rows: tuple[int, ...]  # of the conditions


def losses(subject: Subject, start: Examined) -> list[Loss]:
    """Each direction once, with all single failures that cost it, in the order of these."""
    if subject.robot is None or not start.survived[0]:
        return []
    found: list[Loss] = []
    for row in start.singles.T.ravel().tolist():
        for loss in _of_condition(subject, start, row):
            same = next((k for k, other in enumerate(found) if _are_same(loss, other)), None)
            if same is None:
                found.append(loss)
            else:
                found[same] = replace(found[same], rows=(*found[same].rows, row))
    return found


def _are_same(one: Loss, other: Loss) -> bool:
    return one.drifts == other.drifts and (
        min(np.abs(one.direction + sign * other.direction).max() for sign in (-1, 1)) < _SAME
    )


def _of_condition(subject: Subject, start: Examined, row: int) -> list[Loss]:
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
        found.append(Loss(direction, sound.velocities(rates), False, (row,)))
    return found + [
        Loss(each, self_motion(failed, subject.system.J_T, each), True, (row,))
        for each in bases["unstable"].T
    ]


def self_motion(kin: Kinematics, J_T: Array, direction: Array) -> Array:
    """Velocities (N,) with every actuator at rest that move the task in a direction (m,)."""
    velocities, free = np.zeros(J_T.shape[1]), kin.passive_self_motion
    along = np.linalg.lstsq(J_T[:, kin.passive] @ free, direction, rcond=None)[0]
    velocities[kin.passive] = free @ along
    return velocities


def write_losses(
    subject: Subject, start: Examined, command: str, verdict: str, folder: Path
) -> None:
    """Write `survey.rrd`, and `survey_2.rrd` and so on where a screen is too small for all.

    Nothing is written where nothing is lost.
    """
    found = losses(subject, start)
    results = {"study": "survey", "robot": subject.title, "verdict": verdict}
    properties = {"model_sha256": subject.sha256, "command": command}
    for part, begin in enumerate(range(0, len(found), MOST), start=1):
        shown = found[begin : begin + MOST]
        scenes = {title(subject, start, loss): _scene(subject, start, loss) for loss in shown}
        notes = [
            f"# {literal(subject.title)}",
            "",
            *(f"- {literal(title(subject, start, loss, most=99))}" for loss in shown),
            "",
            f"{len(shown)} of {len(found)} directions. Made by `{command}`.",
        ]
        number = "" if part == 1 else f"_{part}"
        identity, name = f"survey-{subject.title}{number}", f"Survey of {subject.title}{number}"
        about = RecordingInfo(identity, name, "\n".join(notes), properties, results)
        write_scenes(folder / f"survey{number}.rrd", about, scenes, pages=False)


def title(subject: Subject, start: Examined, loss: Loss, most: int = 3) -> str:
    """The failures, of many the first, and the direction."""
    codes, parts = start.codes[list(loss.rows)], []
    for kind, word in KINDS.items():
        if names := [subject.actuators[k] for k in np.nonzero(codes == kind)[1]]:
            parts.append(f"{listed(names, 'or', most)} {word}")
    what = directions_in_words(loss.direction[:, None], subject.rows)
    return f"{', or '.join(parts)}: {what} {'drifts' if loss.drifts else 'is lost'}"


def _scene(subject: Subject, start: Examined, loss: Loss) -> Scene:
    """All joints swing slowly about the start; bodies that failed actuators move are named."""
    assert subject.robot is not None  # a matrix has no losses
    model, nominal = subject.robot.scene.own, np.array(subject.robot.scene.own_start.qpos)
    joints = loss.velocities[: model.nv]  # behind them: of drives that are no joints
    # It ends at its largest: the viewer opens there.
    time_s = np.arange(round(1.25 * _PERIOD_S * _RATE_HZ) + 1) / _RATE_HZ
    wave = _SIZE / np.abs(joints).max() * np.sin(2 * np.pi * time_s / _PERIOD_S)
    qpos = np.tile(nominal, (len(time_s), 1))
    for each, size in zip(qpos, wave, strict=True):
        mujoco.mj_integratePos(model, each, joints, size)
    still = np.zeros_like(wave)
    values = 1e6 * np.column_stack([still, wave] if loss.drifts else [wave, still])
    along = np.flatnonzero(np.abs(loss.direction) > _PART)
    unit = common(tuple(subject.row_units[k] for k in along))
    names = ("without failures", "after the failure")
    unit = "1e-6 rad, m" if unit == "mixed" else f"u{unit}"
    plot = Plot("along", f"along the direction [{unit}]", names, time_s, values)
    failing, driven, codes = list[Failing](), drives(model), start.codes[list(loss.rows)]
    for actuator in np.flatnonzero(codes.any(axis=0)).tolist():
        if (joint := driven[actuator].joint) is not None:
            kinds = [word for kind, word in KINDS.items() if (codes[:, actuator] == kind).any()]
            body = body_name(model, int(model.jnt_bodyid[joint]))
            said = f"{subject.actuators[actuator]} {listed(kinds, 'or')}"
            failing.append(([body], [(0.0, said)]))
    return condition_scene(model, time_s, qpos, [plot], nominal=nominal, failing=failing)
