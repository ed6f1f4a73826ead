"""Recordings of the directions that single failures remove, each as a motion of the robot.

A scene shows a motion that the healthy robot can make and the failed one cannot, or the self-motion
of a robot with a free actuator while all other actuators are at rest.
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
from fjh.survey.system import AnalyzedSystem, common
from prioritized import Kinematics
from sim import Array
from sim.mjcf import drives

MOST = 6  # largest number of cells of one recording, for the size of a screen
_SIZE = 1e-3  # largest joint displacement, [rad] or [m]: loops stay closed to first order
_PERIOD_S, _RATE_HZ = 2.0, 25
_PART = 0.05  # smaller components of a direction do not determine its unit
_SAME = 0.02
"""Largest difference of unit vectors that count as one direction; compliance causes small ones."""


@dataclass(frozen=True, eq=False)
class Loss:
    """Direction of the task, with the failures that remove it or let the robot drift along it."""

    direction: Array  # unit vector of the task rows (m,)
    velocities: Array  # velocities along it (N,): all joints, then drives that are no joints
    drifts: bool  # whether it is a self-motion of the failed robot
    rows: list[int]  # numbers of the conditions

    def is_along(self, other: "Loss") -> bool:
        """Return whether two losses have the same direction, to `_SAME`, and the same kind."""
        difference = (np.abs(self.direction - s * other.direction).max() for s in (-1, 1))
        return self.drifts == other.drifts and min(difference) < _SAME


def losses(system: AnalyzedSystem, start: ConditionAnalysis) -> list[Loss]:
    """Return each lost direction once, with all single failures that remove it."""
    distinct = list[Loss]()
    if system.robot is None or not start.survived[0]:
        return distinct
    for row in start.singles.T.ravel().tolist():
        for loss in _condition_losses(system, start, row):
            same = next((former for former in distinct if former.is_along(loss)), None)
            if same is None:
                distinct.append(loss)
            else:
                same.rows.append(row)
    return distinct


def _condition_losses(system: AnalyzedSystem, start: ConditionAnalysis, row: int) -> list[Loss]:
    """Return lost major directions and self-motions; if the task survives, lost secondary ones."""
    major, secondary = list(system.major), list(system.secondary)
    failures = {word: np.flatnonzero(start.codes[row] == kind) for kind, word in KINDS.items()}
    healthy = system.constrained_system.kinematics()
    failed = system.constrained_system.with_failures(**failures).kinematics()
    bases = failed.manipulability(major).bases
    mapping = healthy.velocity_mapping(major, secondary_weight=np.ones(len(secondary)))
    lost = [(major, part) for part in bases["unmanipulable"].T]
    if start.survived[row]:
        lost += [(secondary, part) for part in start.lost(row).T]
    removed = []
    for rows, part in lost:
        direction = np.zeros(len(system.rows))
        direction[rows] = part
        rates = mapping(direction[major], secondary_velocity=direction[secondary])
        removed.append(Loss(direction, healthy.velocities(rates), False, [row]))
    return removed + [
        Loss(direction, self_motion(failed, system.constrained_system.J_T, direction), True, [row])
        for direction in bases["unstable"].T
    ]


def self_motion(kin: Kinematics, J_T: Array, direction: Array) -> Array:
    """Return velocities (N,) that move the task in a direction (m,) while all actuators rest."""
    velocities, free = np.zeros(J_T.shape[1]), kin.passive_self_motion
    along = np.linalg.lstsq(J_T[:, kin.passive] @ free, direction, rcond=None)[0]
    velocities[kin.passive] = free @ along
    return velocities


def write_losses(
    system: AnalyzedSystem, start: ConditionAnalysis, command: str, headline: str, folder: Path
) -> None:
    """Write the lost directions to `survey.rrd`, `survey_2.rrd` and so on, up to `MOST` in each.

    No file is written if no direction is lost.
    """
    lost = losses(system, start)
    results = {"study": "survey", "robot": system.title, "verdict": headline}
    properties = {"model_sha256": system.sha256, "command": command}
    for first in range(0, len(lost), MOST):
        part, number = lost[first : first + MOST], f"_{first // MOST + 1}" * (first > 0)
        titles = [title(system, start, loss, most=99) for loss in part]
        notes = "\n- ".join([f"# {literal(system.title)}\n", *map(literal, titles)])
        notes += f"\n\n{len(part)} of {len(lost)} directions. Made by `{command}`."
        identity, name = f"survey-{system.title}{number}", f"Survey of {system.title}{number}"
        about = RecordingInfo(identity, name, notes, properties, results)
        scenes = {title(system, start, loss): _scene(system, start, loss) for loss in part}
        write_scenes(folder / f"survey{number}.rrd", about, scenes, pages=False)


def title(system: AnalyzedSystem, start: ConditionAnalysis, loss: Loss, most: int = 3) -> str:
    """Return the title of a loss: its direction, and up to `most` of its failures."""
    failures = [condition_text(start.codes[row], system.actuators) for row in loss.rows]
    direction = directions_text(loss.direction[:, None], system.rows)
    return f"{listed(failures, 'or', most)}: {direction} {'drifts' if loss.drifts else 'is lost'}"


def _scene(system: AnalyzedSystem, start: ConditionAnalysis, loss: Loss) -> Scene:
    """Return a scene in which the joints move slowly along a loss, with failures marked."""
    assert system.robot is not None  # a matrix has no losses
    model, nominal = system.robot.scene.task_model, np.array(system.robot.scene.task_start.qpos)
    joints = loss.velocities[: model.nv]  # the rest are drives that are no joints
    # The motion ends at its maximum: the viewer opens there.
    time_s = np.arange(round(1.25 * _PERIOD_S * _RATE_HZ) + 1) / _RATE_HZ
    wave = _SIZE / np.abs(joints).max() * np.sin(2 * np.pi * time_s / _PERIOD_S)
    qpos = np.tile(nominal, (len(time_s), 1))
    for pose, size in zip(qpos, wave, strict=True):
        mujoco.mj_integratePos(model, pose, joints, size)
    values = 1e6 * np.outer(wave, [not loss.drifts, loss.drifts])
    along = np.flatnonzero(np.abs(loss.direction) > _PART)
    unit = common(tuple(f"u{system.row_units[k]}" for k in along)).replace("mixed", "1e-6 rad, m")
    names = ("without failures", "after the failure")
    plot = Plot("along", f"along the direction [{unit}]", names, time_s, values)
    failing, codes = [], start.codes[loss.rows]
    for drive, name, states in zip(drives(model), system.actuators, codes.T, strict=True):
        if states.any() and drive.joint is not None:
            kinds = [word for kind, word in KINDS.items() if kind in states]
            body = body_name(model, int(model.jnt_bodyid[drive.joint]))
            failing.append(([body], [(0.0, f"{name} {listed(kinds, 'or')}")]))
    return condition_scene(model, time_s, qpos, [plot], nominal=nominal, failing=failing)
