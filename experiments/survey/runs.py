"""The survey of a robot or a matrix: at the start, and over the workspace."""

import shlex
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import Any

from experiments.rig.conditions import Codes, counted, few_failures
from experiments.rig.examined import Examined, examine
from experiments.rig.options import MAJOR, OF_ROBOT, RobotOptions, Switch
from experiments.study.interrupts import notice
from experiments.study.study import OnProgress, WrongInput
from experiments.survey import STUDY
from experiments.survey.alike import Columns, alike_columns
from experiments.survey.extent import Extent, extent_of
from experiments.survey.hold import limits_about_rest
from experiments.survey.matrix import matrix_subject
from experiments.survey.recheck import recheck
from experiments.survey.robot import robot_subject
from experiments.survey.sensors import MOST_ACTUATORS, Sensors, sensors_of
from experiments.survey.survey import Count, Subject, Survey
from experiments.survey.workspace import at_best_posture, workspace_of
from sim import HEXAPOD_MJCF

_QUICK = 8
"""Postures at most."""
_LONG_S = 3.0
"""What takes longer is said before."""
_NO_OTHER = (
    "No other posture than the start was examined: no joint can be varied, or the loops could not "
    "be closed within the joint ranges."
)


def run_survey(
    *,
    seed: int,
    quick: bool,
    on_progress: OnProgress,
    model: Path | None,
    matrix: Path | None,
    lower: str | None,
    upper: str | None,
    hold: str | None,
    postures: int,
    sensors: Switch,
    servo: float | None,
    **robot: Any,
) -> Survey:
    """Examine a robot, or a matrix; `robot` is of :class:`RobotOptions`, without those left None.

    Raises:
        WrongInput: Something that the file does not have.
        sim.ModelError: The file, or what it says.
    """
    _refuse_mixed(model, matrix, hold, servo=servo, **robot)
    given = {"lower": lower, "upper": upper, "hold": hold, "postures": postures} | robot
    given |= {"sensors": sensors, "servo": servo}
    command = STUDY.words(seed=seed, quick=quick, model=model, matrix=matrix, **given)
    if matrix is not None:
        subject = matrix_subject(matrix, lower, upper, robot["major"], hold)
    else:
        subject = robot_subject(model, robot_options(model, **robot), lower, upper)
    extent = extent_of(subject)
    codes = few_failures(len(subject.actuators), extent.listed)
    start = examine_at_start(subject, extent, codes, on_progress)
    workspace, left_out = None, extent.left_out
    count = min(postures, _QUICK) if quick else postures
    if subject.robot is not None and count > 0:
        workspace = workspace_of(subject, subject.robot, extent, count, seed, on_progress)
        left_out += () if workspace else (_NO_OTHER,)
        if workspace and not start.survived[0] and workspace.survived[:, 0].any():
            subject = at_best_posture(subject, subject.robot, workspace, start.reason(0))
            start = examine_at_start(subject, extent, codes, on_progress)
    counts, checked = tuple(_counts(subject, extent, on_progress)), recheck(subject, start)
    said, isolation = shlex.join(command), _isolation(model, subject, sensors, servo)
    return Survey(said, seed, subject, start, counts, workspace, checked, isolation, left_out)


def _refuse_mixed(
    model: Path | None, matrix: Path | None, hold: str | None, **options: Any
) -> None:
    """Refuse a robot and a matrix at once, and options of the one for the other."""
    if matrix is None:
        if hold is not None:
            raise WrongInput("--hold is for a matrix: give one with --matrix")
        return
    if model is not None:
        raise WrongInput(f"{model} and --matrix {matrix}: one of them is surveyed at a time")
    for name, value in options.items():
        if name != "major" and value not in (OF_ROBOT[name].default, None):
            raise WrongInput(f"{OF_ROBOT[name].flag} is for a robot: a matrix has none")


def _isolation(
    model: Path | None, subject: Subject, sensors: Switch, servo: float | None
) -> Sensors | Columns | str:
    """Of a robot by its sensors, of a matrix by its columns."""
    robot = subject.robot
    if robot is None:
        return alike_columns(subject.system.J_T, subject.system.rank_tolerance)
    if sensors == "off":
        return "it was not asked for"
    if (count := len(subject.actuators)) > MOST_ACTUATORS:
        return f"it takes minutes for more than {MOST_ACTUATORS} actuators; there are {count}"
    at = None if subject.instead is None else robot.scene.start.qpos
    # The loops are of position servos; all else takes the file as it is.
    return sensors_of(model or HEXAPOD_MJCF, replace(robot.options, servo=servo), at)


def robot_options(model: Path | None, *, major: str | None, **given: Any) -> RobotOptions:
    """Options of a robot, defaults for None; of the hexapod its own axes.

    Raises:
        WrongInput: The major rows are none.
    """
    usual: dict[str, Any] = {"axes": "base"} if model is None else {}
    if major is not None:
        usual["major"] = MAJOR.checked(major, MAJOR.flag)
    return RobotOptions(
        **usual | {name: value for name, value in given.items() if value is not None}
    )


def examine_at_start(
    subject: Subject, extent: Extent, codes: Codes, on_progress: OnProgress
) -> Examined:
    """These conditions with all that is computed; how long it takes is said where that is long."""
    torques = subject.torques.values if subject.torques is not None and extent.force else None
    return examine(
        subject.system,
        subject.major,
        codes,
        rates=limits_about_rest(subject, codes) if extent.speed else None,
        torques=torques,
        are_joints=subject.robot is not None,
        on_progress=_announced(on_progress, subject),
    )


def _announced(on_progress: OnProgress, subject: Subject) -> OnProgress:
    """The same, and after the first part a sentence if the others take long."""
    begun, said = perf_counter(), False

    def update(done: int, total: int) -> None:
        nonlocal said
        left_s = (perf_counter() - begun) / done * (total - done)
        if not said and left_s > _LONG_S:
            actuators = counted(len(subject.actuators), "actuator")
            notice(f"{total:,} different conditions of {actuators} take about {left_s:.2g} s more")
        said = True
        on_progress(done, total)

    return update


def _counts(subject: Subject, extent: Extent, on_progress: OnProgress) -> Iterator[Count]:
    """How many conditions survive, by their number of failures."""
    if extent.counted <= extent.listed:
        return
    codes = few_failures(len(subject.actuators), extent.counted)
    found = examine_at_start(subject, extent, codes, on_progress)
    for failures in range(extent.counted + 1):
        of = found.failures == failures
        yield Count(failures, int(of.sum()), int(found.survived[of].sum()))
