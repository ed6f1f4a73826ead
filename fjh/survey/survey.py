"""The survey of a robot or a matrix: conditions at the start and over the workspace, as frames."""

import shlex
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

from fjh.rig.condition_analysis import LEAST_LEFT
from fjh.rig.options import (
    DEFAULT_OPTIONS,
    MAJOR,
    Axes,
    Keyframe,
    Model,
    Pinned,
    RobotOptions,
    Site,
    Switch,
)
from fjh.study.errors import WrongInput
from fjh.study.option import OnProgress, Option, seed_of, words_of
from fjh.study.provenance import versions
from fjh.study.result import Picture, Result
from fjh.study.spelling import check_file
from fjh.survey import page
from fjh.survey.conditions import actuator_frame, checks, condition_frame, surveyed
from fjh.survey.isolation import isolation_of
from fjh.survey.recording import write_losses
from fjh.survey.subject import Subject, matrix_subject, robot_subject

_QUICK = 8  # postures at most


def survey(
    *,
    model: Model = None,
    seed: Annotated[int, seed_of("the postures")] = 0,
    quick: Annotated[bool, Option(help="At most 8 postures.")] = False,
    site: Site = "payload",
    axes: Axes = None,
    major: Annotated[str | None, MAJOR] = None,
    keyframe: Keyframe = None,
    pinned: Pinned = None,
    matrix: Annotated[
        Path | None, Option(metavar="FILE", help="Effects per input, instead of a robot.")
    ] = None,
    lower: Annotated[
        str | None,
        Option(
            metavar="L",
            help="Lower limit of each input, or rate of a robot's actuators: a number, or a file "
            "of them.  [default: -1; of velocity actuators their range]",
        ),
    ] = None,
    upper: Annotated[
        str | None, Option(metavar="U", help="Upper limit likewise.  [default: 1]")
    ] = None,
    hold: Annotated[
        str | None,
        Option(
            metavar="W,...",
            help="What the inputs of a matrix exert at rest, such as a weight: one number a major "
            "row.",
        ),
    ] = None,
    postures: Annotated[
        int,
        Option(
            metavar="N",
            help="Of the workspace, by a Sobol sequence over the joint ranges; 0: the start alone.",
            bounds=(0, 4096),
        ),
    ] = 32,
    sensors: Annotated[
        Switch,
        Option(
            help="Whether to say which failures a robot's sensors tell apart: 1 s for the hexapod, "
            "10 s for 12 actuators, not for more."
        ),
    ] = "on",
    servo: Annotated[
        float | None,
        Option(
            metavar="HZ",
            help="For the sensors: natural frequency of the position servos that other actuators "
            "get.",
        ),
    ] = None,
    on_progress: OnProgress,
) -> Result:
    """Say what a robot, or an effectiveness matrix, can still do after each failure.

    The robot is an MJCF file; without one it is the hexapod. A matrix is a text file of numbers
    whose columns are actuators and whose rows are effects, as of rotors or thrusters; rows and
    columns may have names. Each failure of one or two actuators (of one with more than 99; of up to
    nine all combinations are counted), locked or free: whether the major task survives, what speed
    or effect, force and precision is left in the worst direction, and which secondary motion goes;
    for a robot also over its workspace. A failure is survived if at least 1 % of the speed and
    force, or of the effect, without failures is left. Takes 3 s for a matrix, 5 to 20 s for a
    robot; what takes longer says so.

    Writes survey.json, the report on one page as survey.html, the tables as survey.md, and every
    condition at every posture as survey.parquet; a figure, if the task is possible without
    failures; and of a robot survey.rrd, survey_2.rrd and so on: its motion in each direction that a
    single failure costs.

    Example: fjh survey --matrix rotors.csv --lower 0 --upper 6 --hold 15,0,0,0 --out rotors
    """
    command = shlex.join(["fjh", "survey", *words_of(survey, {**locals()})])
    robot = {"site": site, "axes": axes, "keyframe": keyframe, "pinned": pinned, "servo": servo}
    subject = _subject(model, matrix, lower, upper, major, hold, robot)
    drawn = min(postures, _QUICK) if quick else postures
    found = surveyed(subject, drawn, seed, on_progress)
    subject, start, possible = found.subject, found.start, found.rows.posture[found.rows.possible]
    isolation, told_apart = isolation_of(subject, sensors, servo)
    tables = {
        "conditions": condition_frame(found),
        "counts": found.counts,
        "actuators": actuator_frame(found),
        "postures": found.postures,
        "isolation": isolation,
    }
    settings = {
        "seed": seed,
        "versions": versions(),
        "matrix_sha256" if subject.robot is None else "model_sha256": subject.sha256,
        "command": command,
        "title": subject.title,
        "rows": subject.rows,
        "major": subject.major,
        "hold": subject.hold,
        "limits_source": next(iter(subject.sources.values())),
        "force_limits_source": subject.sources.get("forces"),
        "least_left_of_survived": LEAST_LEFT,
        "instead_of_start": subject.instead,
        "postures_drawn": 0 if subject.robot is None else drawn,
        "postures_examined": len(found.postures),
        "postures_possible": possible.nunique() - int(start.survived[0]),
        "left_out": list(found.left_out()),
        **told_apart,
    }
    verdict = page.headline(subject, start)
    sentences = [verdict, *page.notes(subject, start, tables["actuators"], settings)]
    picture = Picture("survey", page.CAPTION, page.ALT, partial(page.figure_survey, subject, start))
    result = Result(
        settings=settings,
        tables=tables,
        checks=checks(subject, start),
        shown=page.shown(subject, tables),
        notes=sentences,
        found={"sentences": sentences},
        pictures=[picture] if start.survived[0] else [],  # else there is nothing to compare with
        rows=found.rows,
    )
    lost = partial(write_losses, subject, start, command, verdict)
    # The page last: it shows the figure, and names the recordings.
    return replace(result, records=[lost, partial(page.write_page, result)])


def _subject(
    model: Path | None,
    matrix: Path | None,
    lower: str | None,
    upper: str | None,
    major: str | None,
    hold: str | None,
    robot: dict[str, Any],
) -> Subject:
    """A robot or a matrix; options of the one are refused for the other."""
    if matrix is None:
        if hold is not None:
            raise WrongInput("--hold is for a matrix: give one with --matrix")
        usual: dict[str, Any] = {"axes": "base"} if model is None else {}
        own = robot | {"major": major, "servo": None}  # a servo is for the sensors alone
        given = usual | {name: value for name, value in own.items() if value is not None}
        return robot_subject(model and check_file(model), RobotOptions(**given), lower, upper)
    if model is not None:
        raise WrongInput(f"{model} and --matrix {matrix}: one of them is surveyed at a time")
    for name, value in robot.items():
        if value not in (getattr(DEFAULT_OPTIONS, name), None):
            raise WrongInput(f"--{name} is for a robot: a matrix has none")
    return matrix_subject(check_file(matrix), lower, upper, major, hold)
