"""Study `survey`: capability of a robot or a matrix after failures; docs/survey.md."""

import shlex
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

from fjh.rig import options as rig_options
from fjh.rig.condition_analysis import LEAST_LEFT
from fjh.study.errors import WrongInput
from fjh.study.input_checks import check_file
from fjh.study.option import OnProgress, Option, command_arguments, seed_of
from fjh.study.provenance import versions
from fjh.study.result import Picture, Result
from fjh.survey import page
from fjh.survey.conditions import actuator_frame, checks, condition_frame, survey_system
from fjh.survey.isolation import isolation_of
from fjh.survey.recording import write_losses
from fjh.survey.system import AnalyzedSystem, matrix_system, robot_system

_QUICK = 8  # largest number of postures of a quick run


def survey(
    *,
    model: rig_options.Model = None,
    seed: Annotated[int, seed_of("the postures")] = 0,
    quick: Annotated[bool, Option(help="Sample at most 8 postures.")] = False,
    site: rig_options.Site = "payload",
    axes: rig_options.Axes = None,
    major: Annotated[str | None, rig_options.MAJOR] = None,
    keyframe: rig_options.Keyframe = None,
    pinned: rig_options.Pinned = None,
    matrix: Annotated[
        Path | None,
        Option(metavar="FILE", help="Text file of an effectiveness matrix, effects per input."),
    ] = None,
    lower: Annotated[
        str | None,
        Option(
            metavar="L",
            help="Lower limit of each input, or rate of a robot's actuators: a number, or a file "
            "with one for each.  [default: -1; of velocity actuators their range]",
        ),
    ] = None,
    upper: Annotated[
        str | None, Option(metavar="U", help="Upper limit, in the same form.  [default: 1]")
    ] = None,
    hold: Annotated[
        str | None,
        Option(
            metavar="W,...",
            help="Effects of a matrix's inputs at rest, such as a weight: one number for each "
            "major row.",
        ),
    ] = None,
    postures: Annotated[
        int,
        Option(
            metavar="N",
            help="Postures sampled by a Sobol sequence over the joint ranges; 0: the start alone.",
            bounds=(0, 4096),
        ),
    ] = 32,
    sensors: Annotated[
        rig_options.Switch,
        Option(
            help="Compute which failures a robot's sensors can isolate: 1 s for the hexapod, 10 s "
            "for 12 actuators, not available for more."
        ),
    ] = "on",
    servo: Annotated[
        float | None,
        Option(
            metavar="HZ",
            help="Natural frequency of the position servos that --sensors assumes instead of "
            "other actuators.",
        ),
    ] = None,
    on_progress: OnProgress,
) -> Result:
    """Report what a robot, or an effectiveness matrix, can still do after each failure.

    The robot is an MJCF file; without one it is the hexapod. A matrix is a text file of numbers
    whose columns are actuators and whose rows are effects, as of rotors or thrusters; rows and
    columns may have names. Each failure of one or two actuators, locked or free, is analyzed (with
    more than 99 actuators of one; with up to nine all combinations are counted): whether the major
    task survives, the remaining speed or effect, force and precision in the worst direction, and
    the lost secondary motion; for a robot also over its workspace. A failure is survived if at
    least 1 % of the speed and force, or of the effect, without failures is left. Takes 3 s for a
    matrix, 5 to 20 s for a robot; longer steps show their progress.

    Writes survey.json, the report on one page as survey.html, the tables as survey.md, and every
    condition at every posture as survey.parquet; a figure, if the task is possible without
    failures; and for a robot survey.rrd, survey_2.rrd and so on: its motion in each direction that
    a single failure removes.

    Example: fjh survey --matrix rotors.csv --lower 0 --upper 6 --hold 15,0,0,0 --out rotors
    """
    command = shlex.join(["fjh", "survey", *command_arguments(survey, {**locals()})])
    robot = {"site": site, "axes": axes, "keyframe": keyframe, "pinned": pinned, "servo": servo}
    system = _system_of_options(model, matrix, lower, upper, major, hold, robot)
    count = min(postures, _QUICK) if quick else postures
    analysis = survey_system(system, count, seed, on_progress)
    system, start, rows = analysis.system, analysis.start, analysis.rows
    isolation, isolation_settings = isolation_of(system, sensors, servo)
    tables = {
        "conditions": condition_frame(analysis),
        "counts": analysis.counts,
        "actuators": actuator_frame(analysis),
        "postures": analysis.postures,
        "isolation": isolation,
    }
    settings = {
        "seed": seed,
        "versions": versions(),
        "matrix_sha256" if system.robot is None else "model_sha256": system.sha256,
        "command": command,
        "title": system.title,
        "rows": system.rows,
        "major": system.major,
        "hold": system.hold,
        "limits_source": next(iter(system.sources.values())),
        "force_limits_source": system.sources.get("forces"),
        "least_left_of_survived": LEAST_LEFT,
        "instead_of_start": system.instead,
        "postures_drawn": 0 if system.robot is None else count,
        "postures_examined": len(analysis.postures),
        "postures_possible": rows.posture[rows.possible].nunique() - int(start.survived[0]),
        "left_out": list(analysis.omissions()),
        **isolation_settings,
    }
    headline = page.headline(system, start)
    sentences = [headline, *page.notes(system, start, tables["actuators"], settings)]
    picture = Picture("survey", page.CAPTION, page.ALT, partial(page.figure_survey, system, start))
    result = Result(
        settings=settings,
        tables=tables,
        checks=checks(system, start),
        views=page.table_views(system, tables),
        notes=sentences,
        overall={"sentences": sentences},
        pictures=[picture] if start.survived[0] else [],  # else there is nothing to compare with
        rows=rows,
    )
    lost = partial(write_losses, system, start, command, headline)
    # The page is last: it includes the figure and lists the recordings.
    return replace(result, records=[lost, partial(page.write_page, result)])


def _system_of_options(
    model: Path | None,
    matrix: Path | None,
    lower: str | None,
    upper: str | None,
    major: str | None,
    hold: str | None,
    robot: dict[str, Any],
) -> AnalyzedSystem:
    """Load the robot or the matrix; raise `WrongInput` for options that do not apply."""
    if matrix is None:
        if hold is not None:
            raise WrongInput("--hold applies to a matrix: give one with --matrix")
        defaults: dict[str, Any] = {"axes": "base"} if model is None else {}
        options = robot | {"major": major, "servo": None}  # a servo is for the sensors alone
        given = defaults | {name: value for name, value in options.items() if value is not None}
        parsed = rig_options.RobotOptions(**given)
        return robot_system(model and check_file(model), parsed, lower, upper)
    if model is not None:
        raise WrongInput(f"give either a MODEL.xml or --matrix, got {model} and --matrix {matrix}")
    for name, value in robot.items():
        if value not in (getattr(rig_options.DEFAULT_OPTIONS, name), None):
            raise WrongInput(f"--{name} applies to a robot, not to --matrix")
    return matrix_system(check_file(matrix), lower, upper, major, hold)
