"""The survey of a robot or a matrix: conditions at the start and over the workspace, as frames."""

import shlex
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pandas as pd

from argument_checks.ties import exceeds
from fjh.rig.conditions import FREE, LOCKED, SOUND, failed, few_failures, in_words
from fjh.rig.examined import LEAST_LEFT, Examined, directions_in_words, examine
from fjh.rig.options import (
    DEFAULT_OPTIONS,
    MAJOR,
    Axes,
    Keyframe,
    Model,
    Pinned,
    Site,
    Switch,
)
from fjh.study.errors import WrongInput
from fjh.study.option import OnProgress, Option, seed_of, words_of
from fjh.study.provenance import versions
from fjh.study.result import Check, Picture, Result, check
from fjh.study.spelling import check_file
from fjh.survey import page
from fjh.survey.isolation import isolation_of
from fjh.survey.recording import write_losses
from fjh.survey.subject import Subject, common, matrix_subject, robot_options, robot_subject
from fjh.survey.workspace import Extent, Workspace, at_best_posture, extent_of, workspace_of
from ftc.tracking import is_possible
from sim import Array

_QUICK = 8  # postures at most
_RECHECKED = 24  # conditions that are examined alone as well: a fraction of a second
_ALIKE = 0.02  # part by which equal losses may differ: no drawn postures are quite symmetric


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

    Writes survey.json, the report on one page as survey.html, the tables as survey.md and all
    conditions as survey.npz; a figure, if the task is possible without failures; and of a robot
    survey.rrd, survey_2.rrd and so on: its motion in each direction that a single failure costs.

    Example: fjh survey --matrix rotors.csv --lower 0 --upper 6 --hold 15,0,0,0 --out rotors
    """
    command = shlex.join(["fjh", "survey", *words_of(survey, {**locals()})])
    robot: dict[str, Any] = {"site": site, "axes": axes, "keyframe": keyframe, "pinned": pinned}
    _refuse_mixed(model, matrix, hold, servo=servo, **robot)
    if matrix is not None:
        subject = matrix_subject(check_file(matrix), lower, upper, major, hold)
    else:
        subject = robot_subject(
            model and check_file(model), robot_options(model, major=major, **robot), lower, upper
        )
    found = surveyed(subject, min(postures, _QUICK) if quick else postures, seed, on_progress)
    subject, start, workspace = found.subject, found.start, found.workspace
    isolation, told_apart = isolation_of(subject, model, sensors, servo)
    tables = tables_of(found) | {"isolation": isolation}
    settings = {
        "seed": seed,
        "versions": versions(),
        "matrix_sha256" if subject.robot is None else "model_sha256": subject.sha256,
        "command": command,
        "title": subject.title,
        "rows": subject.rows,
        "major": subject.major,
        "hold": subject.hold,
        "limits_source": subject.rates.source,
        "force_limits_source": subject.torques and subject.torques.source,
        "least_left_of_survived": LEAST_LEFT,
        "instead_of_start": subject.instead,
        "postures_drawn": workspace.tried if workspace else 0,
        "postures_examined": len(workspace.qpos) if workspace else 0,
        "postures_possible": int(workspace.survived[:, 0].sum()) if workspace else 0,
        "left_out": found.left_out,
        **told_apart,
    }
    verdict = page.headline(subject, start)
    sentences = [verdict, *page.notes(subject, start, tables["actuators"], settings)]
    picture = Picture("survey", page.CAPTION, page.ALT, partial(page.figure_survey, subject, start))
    result = Result(
        settings=settings,
        tables=tables,
        checks=checks(tables["conditions"], tables["one_by_one"]),
        shown=page.shown(subject.title, tables),
        notes=sentences,
        found={"sentences": sentences},
        pictures=[picture] if start.survived[0] else [],  # else there is nothing to compare with
        arrays={"survey.npz": arrays(found)},
    )
    lost = partial(write_losses, subject, start, command, verdict)
    # The page last: it shows the figure, and names the recordings.
    return replace(result, records=[lost, partial(page.write_page, result)])


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
        if value not in (getattr(DEFAULT_OPTIONS, name), None):
            raise WrongInput(f"--{name} is for a robot: a matrix has none")


@dataclass(frozen=True, eq=False)
class Survey:
    """What was examined."""

    subject: Subject  # at the start, or at the posture that stands for it
    start: Examined  # all conditions with few failures there, first the sound one
    counts: pd.DataFrame  # how many conditions survive, a row for each number of failures
    workspace: Workspace | None  # other postures; None of a matrix, and where there are none
    left_out: tuple[str, ...]  # what was not examined, a sentence each


def surveyed(subject: Subject, postures: int, seed: int, on_progress: OnProgress) -> Survey:
    """Examine a subject at its start, and a robot at so many postures that are drawn."""
    extent, workspace = extent_of(subject), None
    missing = tuple(extent.left_out(subject))
    start = _at_start(subject, extent, extent.listed, on_progress)
    if subject.robot is not None and postures > 0:
        workspace = workspace_of(subject, subject.robot, extent, postures, seed, on_progress)
        if workspace is None:
            missing += ("No other posture was examined: none can be drawn and closed in range.",)
        elif not start.survived[0] and workspace.survived[:, 0].any():
            subject = at_best_posture(subject, subject.robot, workspace, start.reason(0))
            start = _at_start(subject, extent, extent.listed, on_progress)
    every = start
    if extent.counted > extent.listed:
        every = _at_start(subject, extent, extent.counted, on_progress)
    survived = pd.Series(every.survived).groupby(every.failures)
    counts = survived.agg(conditions="size", survived="sum").rename_axis("failures").reset_index()
    return Survey(subject, start, counts, workspace, missing)


def _at_start(subject: Subject, extent: Extent, failures: int, on_progress: OnProgress) -> Examined:
    """All conditions with at most so many failures, with all that is computed."""
    codes = few_failures(len(subject.actuators), failures)
    return examine(
        subject.system,
        subject.major,
        codes,
        rates=subject.limits_about_rest(codes) if extent.speed else None,
        torques=subject.torques.values if subject.torques and extent.force else None,
        are_joints=subject.robot is not None,
        on_progress=on_progress,
    )


# Tables.


def tables_of(found: Survey) -> dict[str, pd.DataFrame]:
    """All but what sensors tell apart; NaN where a number is infinite or there is none."""
    frames = {
        "conditions": condition_frame(found),
        "counts": found.counts,
        "actuators": actuator_frame(found),
        "one_by_one": one_by_one(found.subject, found.start),
    }
    return {name: frame.replace([np.inf, -np.inf], np.nan) for name, frame in frames.items()}


def condition_frame(found: Survey) -> pd.DataFrame:
    """A row for each failure condition at the start; columns have the units of the subject."""
    subject, start, workspace = found.subject, found.start, found.workspace
    names, secondary = subject.actuators, [subject.rows[row] for row in subject.secondary]
    major = common(tuple(subject.row_units[row] for row in subject.major))
    units = common(subject.units)
    speed, force = _COLUMNS[major]
    gain = _ratio("largest_gain", units, major)
    lost = [start.lost(row) for row in range(len(start.codes))]
    columns: dict[str, Any] = {
        "failed": [in_words(code, names) for code in start.codes],
        "failures": start.failures,
        "locked": [failed(code, names, LOCKED) for code in start.codes],
        "free": [failed(code, names, FREE) for code in start.codes],
        "survived": start.survived,
        "major_task": [start.verdict(row) for row in range(len(start.codes))],
        speed: start.left.worst_speed,
        f"{subject.measure}_left": start.speed_left,
    }
    if subject.torques is not None:
        columns |= {force: start.left.worst_force, "force_left": start.force_left}
    columns |= {
        "relative_manipulability": start.relative_manipulability,
        "best_possible": start.best_possible,
        gain: start.largest_gain,
        _ratio("error_gain", major, units): start.error_gain,
        "lost_secondary": [
            directions_in_words(each, secondary) if secondary and survived else None
            for each, survived in zip(lost, start.survived, strict=True)
        ],
        "lost_secondary_directions": [each.T.tolist() for each in lost],
        "rank_gap": start.left.gap,
    }
    frame = pd.DataFrame(columns)
    if subject.robot is None:
        return frame
    every = survived_everywhere(found)
    able = every[every[:, 0]]
    frame["share_of_postures"] = pd.DataFrame(able).mean() if len(every) > 1 else np.nan
    for name, of, extreme in (
        (speed, "speed", "least"),
        ("relative_manipulability", "relative", "least"),
        (gain, "largest_gain", "greatest"),
    ):
        values = None if workspace is None else getattr(workspace, of)
        each = pd.DataFrame(values).replace(np.inf, np.nan)
        frame[f"{name}_median_over_postures"] = each.median()
        worst = each.min() if extreme == "least" else each.max()
        frame[f"{name}_{extreme}_over_postures"] = worst
    return frame


_COLUMNS = {
    "rad": ("worst_speed_rad_per_s", "worst_torque_nm"),
    "m": ("worst_speed_m_per_s", "worst_force_n"),
    "mixed": ("worst_speed_rad_and_m_per_s", "worst_force_n_and_nm"),
    "1": ("worst_effect", ""),
}
"""Of the worst speed and force, by the unit of the major task."""


def _ratio(name: str, over: str, under: str) -> str:
    """Column of a gain, with its unit where it has one."""
    if over == under:
        return name
    words = [each.replace("mixed", "rad_and_m") for each in (over, under)]
    return f"{name}_{words[0]}_per_{words[1]}"


def survived_everywhere(found: Survey) -> Array:
    """Whether conditions survive at the start, unless a posture stands for it, and at all others.

    Shape (1 + P, C'), of the conditions that are examined everywhere.
    """
    if found.workspace is None:
        return found.start.survived[None]
    elsewhere = found.workspace.survived
    own = [] if found.subject.instead else [found.start.survived[: elsewhere.shape[1]]]
    return np.vstack([*own, elsewhere])


def actuator_frame(found: Survey) -> pd.DataFrame:
    """A row for each actuator: its limits, and what its failures leave.

    `left_locked`, `left_free`: of the speed, or effect, of the sound robot in the worst direction,
    in the mean over start and workspace. `doubles_survived`: part of the double failures with it
    that are survived at the start. `costs_most`: it leaves least in the mean of locked and free,
    then has the fewest doubles, as have all others that are marked.
    """
    subject, start, workspace = found.subject, found.start, found.workspace
    frame = pd.DataFrame({"actuator": subject.actuators, "unit": subject.units})
    frame["lower"], frame["upper"] = subject.rates.values
    if subject.torques is not None:
        frame["lower_force"], frame["upper_force"] = subject.torques.values
    kept = _kept(start)[None]
    if workspace is not None:
        there = _kept(workspace)
        kept = np.vstack([kept[:, : there.shape[1]], there])
    left = pd.DataFrame(kept[np.isfinite(kept[:, 0])]).mean().to_numpy()[start.singles]
    frame["left_locked"], frame["left_free"] = left.T
    pairs = start.failures == 2
    has = start.codes[pairs] != SOUND
    doubles = pd.Series((has & start.survived[pairs, None]).sum(axis=0)) / has.sum(axis=0)
    frame["doubles_survived"] = doubles
    loss, doubles = 1.0 - left.mean(axis=1), doubles.fillna(1.0).to_numpy()
    near = ~exceeds(loss.max(), loss, _ALIKE) & np.isfinite(loss)
    fewest = np.where(near, doubles, np.inf).min()
    frame["costs_most"] = near & ~exceeds(doubles, fewest, _ALIKE)
    return frame


def _kept(at: Examined | Workspace) -> Array:
    """Speed left, zero where the task is lost; NaN where the sound robot does not do it."""
    return np.where(at.survived | np.isnan(at.speed_left), at.speed_left, 0.0)


def one_by_one(subject: Subject, start: Examined) -> pd.DataFrame:
    """Some conditions classified each alone, and how far off the speeds of all at once are."""
    codes, rows = start.codes, []
    lower, upper = (np.broadcast_to(side, codes.shape) for side in subject.limits_about_rest(codes))
    for row in range(0, len(codes), max(1, len(codes) // _RECHECKED)):
        locked, free = np.flatnonzero(codes[row] == LOCKED), np.flatnonzero(codes[row] == FREE)
        if not start.are_joints:
            locked, free = np.flatnonzero(codes[row]), free[:0]
        kin = subject.system.with_failures(locked.tolist(), free.tolist()).kinematics()
        entry = {
            "failed": in_words(codes[row], subject.actuators),
            "possible": start.left.possible[row],
            "possible_alone": is_possible(kin.manipulability(subject.major)),
        }
        if (speeds := start.left.worst_speed) is not None:
            alone = kin.attainable(subject.major, (lower[row], upper[row])).radius
            off = alone != speeds[row] and abs(alone - speeds[row]) / max(alone, speeds[row])
            entry["relative_difference"] = float(off)
        rows.append(entry)
    return pd.DataFrame(rows)


def checks(conditions: pd.DataFrame, one_by_one: pd.DataFrame) -> list[Check]:
    """Verdicts and numbers of single conditions by the other way; the mean-square theorem.

    Ukidve, McInroy and Jafari's theorem is on all single locks; where loops constrain the
    actuators, it does not hold.
    """
    differ = (one_by_one.possible != one_by_one.possible_alone).sum()
    found = check("verdicts that differ", differ, 0.5, "one by one")
    if "relative_difference" in one_by_one:
        off = one_by_one.relative_difference.fillna(np.inf).max()
        found += check("relative difference of what is left", off, 1e-6, "one by one")
    locks = conditions[(conditions.failures == 1) & (conditions.locked.str.len() == 1)]
    best, relative = locks.best_possible, locks.relative_manipulability
    if best.notna().all() and relative.notna().all():
        off = abs((relative**2).mean() - best.iloc[0] ** 2)
        found += check("difference from the mean square theorem", off, 1e-6, "single locks")
    return found


def arrays(found: Survey) -> dict[str, Array]:
    """Every condition of the start, and of the postures, a row of `codes` each."""
    start, workspace, robot = found.start, found.workspace, found.subject.robot
    every = {
        "codes": start.codes,
        "survived": start.survived,
        "gains": start.left.gains,
        "relative_manipulability": start.relative_manipulability,
        "best_possible": start.best_possible,
        "worst_speed": start.left.worst_speed,
        "worst_force": start.left.worst_force,
        "qpos_at_start": robot and robot.scene.own_start.qpos,
    }
    if workspace is not None:
        every |= {
            "qpos": workspace.qpos,
            "survived_at_postures": workspace.survived,
            "worst_speed_at_postures": workspace.speed,
            "relative_manipulability_at_postures": workspace.relative,
            "largest_gain_at_postures": workspace.largest_gain,
        }
    return {name: values for name, values in every.items() if values is not None}
