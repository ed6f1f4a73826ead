"""The directions that single failures cost, as motions of the robot: one recording, a cell each.

What the sound robot can do there and the failed one cannot; or, where a free actuator lets the
robot move with every other one held, that motion.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np

from experiments.recording.file import RecordingInfo
from experiments.recording.layout import write_scenes
from experiments.recording.machine import Failing
from experiments.recording.scene import Scene, condition_scene
from experiments.recording.signals import Plot
from experiments.rig.bodies import body_name
from experiments.rig.conditions import KINDS, listed
from experiments.rig.examined import directions_in_words
from experiments.rig.robot import Robot
from experiments.study.tables import literal
from experiments.survey.quantities import common
from experiments.survey.sentences import headline
from experiments.survey.survey import Survey
from prioritized import Kinematics
from sim import Array
from sim.mjcf.transmission import drives

MOST = 6
"""Cells that a screen has room for, one recording."""
_SIZE = 1e-3
"""Largest joint velocity times time, [rad] or [m]: loops stay closed to first order."""
_PERIOD_S, _RATE_HZ = 2.0, 25
_PART = 0.05
"""Smallest part of a direction that counts for its unit."""
_SAME = 0.02
"""Difference of unit vectors that a reader takes for one direction: springs give way a little."""


@dataclass(frozen=True, eq=False)
class Loss:
    """A direction of the task, and the failures that cost it or let the robot drift along it.

    Attributes:
        direction: Of the task rows, a unit vector (m,).
        velocities: Along it, of all joints, then of drives that are no joints: of the sound robot,
            or of the one that drifts, (N,).
        drifts: Whether it is a self-motion.
        rows: Of the conditions.
    """

    direction: Array
    velocities: Array
    drifts: bool
    rows: tuple[int, ...]


def losses(survey: Survey) -> list[Loss]:
    """Each direction once, with all single failures that cost it, in the order of these."""
    if survey.subject.robot is None or not survey.start.survived[0]:
        return []
    found: list[Loss] = []
    for row in survey.start.singles.T.ravel().tolist():
        for loss in _of_condition(survey, row):
            same = [k for k, other in enumerate(found) if _are_same(loss, other)]
            if same:
                known = found[same[0]]
                found[same[0]] = replace(known, rows=(*known.rows, row))
            else:
                found.append(loss)
    return found


def _are_same(one: Loss, other: Loss) -> bool:
    return one.drifts == other.drifts and (
        min(np.abs(one.direction + sign * other.direction).max() for sign in (-1, 1)) < _SAME
    )


def _of_condition(survey: Survey, row: int) -> list[Loss]:
    """Lost major directions, lost secondary ones if the major task is kept, and self-motions."""
    subject, codes = survey.subject, survey.start.codes[row]
    major, secondary = list(subject.major), list(subject.secondary)
    sound = subject.system.kinematics()
    failures = {word: np.flatnonzero(codes == kind) for kind, word in KINDS.items()}
    failed = subject.system.with_failures(**failures).kinematics()
    bases = failed.manipulability(major).bases
    mapping = sound.velocity_mapping(major, secondary_weight=np.ones(len(secondary)))
    found = []
    for rows, lost in (
        (major, bases["unmanipulable"]),
        (secondary, survey.start.lost(row) if survey.start.survived[row] else np.zeros((0, 0))),
    ):
        for part in lost.T:
            direction = np.zeros(len(subject.rows))
            direction[rows] = part
            rates = mapping(direction[major], secondary_velocity=direction[secondary])
            found.append(Loss(direction, sound.velocities(rates), False, (row,)))
    drifting = (self_motion(failed, subject.system.J_T, each) for each in bases["unstable"].T)
    pairs = zip(bases["unstable"].T, drifting, strict=True)
    return found + [Loss(each, velocities, True, (row,)) for each, velocities in pairs]


def self_motion(kin: Kinematics, J_T: Array, direction: Array) -> Array:
    """Velocities (N,) with every actuator at rest that move the task in a direction (m,)."""
    velocities, free = np.zeros(J_T.shape[1]), kin.passive_self_motion
    along = np.linalg.lstsq(J_T[:, kin.passive] @ free, direction, rcond=None)[0]
    velocities[kin.passive] = free @ along
    return velocities


def write_losses(survey: Survey, folder: Path) -> None:
    """Write `survey.rrd`, and `survey_2.rrd` and so on where a screen is too small for all.

    Nothing is written where nothing is lost.
    """
    found, robot, subject = losses(survey), survey.subject.robot, survey.subject
    if robot is None:
        return
    results = {"study": "survey", "robot": subject.title, "verdict": headline(survey)}
    properties = {"model_sha256": subject.sha256, "command": survey.command}
    for part, begin in enumerate(range(0, len(found), MOST), start=1):
        shown = found[begin : begin + MOST]
        scenes = {title(survey, loss): _scene(survey, robot, loss) for loss in shown}
        notes = [
            f"# {literal(subject.title)}",
            "",
            "Motions that single failures cost, and self-motions:",
        ]
        notes += ["", *(f"- {literal(title(survey, loss, most=99))}" for loss in shown), ""]
        notes += [f"{len(shown)} of {len(found)} directions. Made by `{survey.command}`."]
        number = "" if part == 1 else f"_{part}"
        identity, name = f"survey-{subject.title}{number}", f"Survey of {subject.title}{number}"
        about = RecordingInfo(identity, name, "\n".join(notes), properties, results)
        write_scenes(folder / f"survey{number}.rrd", about, scenes, pages=False)


def title(survey: Survey, loss: Loss, most: int = 3) -> str:
    """The failures, of many the first, and the direction."""
    subject, codes = survey.subject, survey.start.codes[list(loss.rows)]
    parts = []
    for kind, word in KINDS.items():
        if names := [subject.actuators[k] for k in np.nonzero(codes == kind)[1]]:
            parts.append(f"{listed(names, 'or', most)} {word}")
    what = directions_in_words(loss.direction[:, None], subject.rows)
    return f"{', or '.join(parts)}: {what} {'drifts' if loss.drifts else 'is lost'}"


def _scene(survey: Survey, robot: Robot, loss: Loss) -> Scene:
    """A slow oscillation of all joints about the start."""
    model, nominal = robot.scene.own, np.array(robot.scene.own_start.qpos)
    joints = loss.velocities[: model.nv]  # behind them: of drives that are no joints
    # It ends at its largest: the viewer opens there.
    time_s = np.arange(round(1.25 * _PERIOD_S * _RATE_HZ) + 1) / _RATE_HZ
    wave = _SIZE / np.abs(joints).max() * np.sin(2 * np.pi * time_s / _PERIOD_S)
    qpos = np.tile(nominal, (len(time_s), 1))
    for each, size in zip(qpos, wave, strict=True):
        mujoco.mj_integratePos(model, each, joints, size)
    still = np.zeros_like(wave)
    values = 1e6 * np.column_stack([still, wave] if loss.drifts else [wave, still])
    subject = survey.subject
    along = np.flatnonzero(np.abs(loss.direction) > _PART)
    unit = common(tuple(subject.row_units[k] for k in along))
    names = ("without failures", "after the failure")
    unit = "1e-6 rad, m" if unit == "mixed" else f"u{unit}"
    plot = Plot("along", f"along the direction [{unit}]", names, time_s, values)
    failing = _failing(survey, robot, loss)
    return condition_scene(model, time_s, qpos, [plot], nominal=nominal, failing=failing)


def _failing(survey: Survey, robot: Robot, loss: Loss) -> list[Failing]:
    """Bodies that failed actuators move, and how these fail."""
    model, found, driven = robot.scene.own, [], drives(robot.scene.own)
    codes, names = survey.start.codes[list(loss.rows)], survey.subject.actuators
    for actuator in np.flatnonzero(codes.any(axis=0)).tolist():
        if (joint := driven[actuator].joint) is not None:
            kinds = [word for kind, word in KINDS.items() if (codes[:, actuator] == kind).any()]
            body = body_name(model, int(model.jnt_bodyid[joint]))
            found.append(([body], [(0.0, f"{names[actuator]} {listed(kinds, 'or')}")]))
    return found
