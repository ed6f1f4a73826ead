"""A survey as numbers, checks, tables and files."""

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from experiments.rig.examined import LEAST_LEFT
from experiments.study.provenance import versions
from experiments.study.quantity import columns_of, entry_of
from experiments.study.results import Check, Results
from experiments.study.tables import Column, Table, tabulate
from experiments.survey.assumptions import assumptions
from experiments.survey.cost import cost_of
from experiments.survey.figure import pictures
from experiments.survey.isolation import (
    isolation_entry,
    isolation_sentences,
    isolation_tables,
)
from experiments.survey.page import write_page
from experiments.survey.quantities import Condition, quantities
from experiments.survey.recording import write_losses
from experiments.survey.sentences import headline, sentences, why
from experiments.survey.survey import Limited, Subject, Survey
from sim import Array

_ACCURATE = 1e-6
"""Relative difference between numbers of many conditions at once and of one alone."""


def results(survey: Survey) -> Results:
    """Everything that `fjh survey` publishes."""
    summary = summarize(survey)
    found = Results(
        summary,
        tables=tables(survey, summary),
        notes=summary["sentences"],
        checks=checks(summary),
        pictures=pictures(survey),
        arrays={"survey.npz": arrays(survey)},
    )
    # The page last: it shows the figures, and names the recording.
    return replace(found, records=[partial(write_losses, survey), partial(write_page, found)])


def summarize(survey: Survey) -> dict[str, Any]:
    """All numbers of the survey, ready for JSON; None where there is no finite number."""
    subject, cost = survey.subject, cost_of(survey)
    of_condition = quantities(subject)
    isolation, assumed = isolation_entry(subject, survey.isolation), assumptions(survey)
    rows = range(len(survey.start.codes))
    costliest = None
    if cost is not None:
        costliest = {
            "actuator": subject.actuators[cost.actuator],
            "equal": [subject.actuators[k] for k in cost.equal if k != cost.actuator],
            "left_locked": float(cost.left[cost.actuator, 0]),
            "left_free": float(cost.left[cost.actuator, 1]),
            "why": why(survey, cost),
        }
    return {
        "experiment": "survey",
        "command": survey.command,
        "seed": survey.seed,
        "versions": versions(),
        "model_sha256" if subject.robot else "matrix_sha256": subject.sha256,
        "title": subject.title,
        "actuators": list(subject.actuators),
        "rows": list(subject.rows),
        "major": list(subject.major),
        "limits": limits_entry(subject),
        "least_left_of_survived": LEAST_LEFT,
        "conditions": [entry_of(of_condition, Condition(survey, row)) for row in rows],
        "counts": [vars(count) for count in survey.counts],
        "instead_of_start": subject.instead,
        "postures": _postures(survey),
        "costliest": costliest,
        "isolation": isolation,
        "left_out": list(survey.left_out),
        "one_by_one": {
            "verdicts_that_differ": survey.recheck.verdicts,
            "relative_difference_of_what_is_left": survey.recheck.off,
            "difference_from_the_mean_square_theorem": survey.recheck.theorem,
        },
        "null_means": _NULL,
        "headline": headline(survey),
        "sentences": [*sentences(survey, cost, isolation_sentences(isolation)), *assumed],
        "assumptions": assumed,
    }


_NULL = (
    "null: infinite, as the force that a locked structure bears or a gain of a lost task; or not "
    "computed or not defined, see left_out and docs/survey.md"
)


def limits_entry(subject: Subject) -> dict[str, Any]:
    """Limits that numbers hold within; infinite ones are None."""

    def entry(limited: Limited) -> dict[str, Any]:
        lower, upper = (
            [float(each) if np.isfinite(each) else None for each in side] for side in limited.values
        )
        said = {"source": limited.source, "assumed": limited.assumed}
        return {"lower": lower, "upper": upper} | said

    if subject.torques is None:
        hold = None if subject.hold is None else subject.hold.tolist()
        return {"inputs": entry(subject.rates), "hold": hold}
    return {"rates": entry(subject.rates), "torques": entry(subject.torques)}


def _postures(survey: Survey) -> dict[str, int] | None:
    workspace = survey.workspace
    if workspace is None:
        return None
    return {
        "drawn": workspace.tried,
        "unusable": workspace.unusable,
        "examined": len(workspace.qpos),
        "possible_without_failures": int(workspace.survived[:, :1].sum()),
    }


def arrays(survey: Survey) -> dict[str, Array]:
    """Every condition of the start, and of the postures, a row of `codes` each."""
    start, workspace = survey.start, survey.workspace
    found = {
        "codes": start.codes,
        "survived": start.survived,
        "gains": start.left.gains,
        "relative_manipulability": start.relative_manipulability,
        "best_possible": start.best_possible,
        "worst_speed": start.left.worst_speed,
        "worst_force": start.left.worst_force,
    }
    if survey.subject.robot is not None:
        found["qpos_at_start"] = survey.subject.robot.scene.own_start.qpos
    if workspace is not None:
        found |= {
            "qpos": workspace.qpos,
            "survived_at_postures": workspace.survived,
            "worst_speed_at_postures": workspace.speed,
            "relative_manipulability_at_postures": workspace.relative,
            "largest_gain_at_postures": workspace.largest_gain,
        }
    return {name: values for name, values in found.items() if values is not None}


def checks(summary: dict[str, Any]) -> list[Check]:
    """Verdicts and numbers of single conditions by the other way; the mean-square theorem."""
    where, limits = summary["title"], {"verdicts_that_differ": 0.5}
    return [
        Check(key.replace("_", " "), where, value, limits.get(key, _ACCURATE))
        for key, value in summary["one_by_one"].items()
        if value is not None
    ]


def tables(survey: Survey, summary: dict[str, Any]) -> list[Table]:
    """The single failures, and how many of more are survived."""
    few = [each for each in summary["conditions"] if len(each["locked"] + each["free"]) < 2]
    columns = [
        column
        for column in columns_of(quantities(survey.subject))
        if any(each[column.key] is not None for each in few)  # type: ignore[index]
    ]
    found = [tabulate(f"{survey.subject.title}: single failures", columns, few, _LEGEND)]
    if survey.counts:
        counted = (
            Column("failures", "failures"),
            Column("conditions", "conditions", ","),
            Column("survived", "survived", ","),
        )
        title = "Conditions at the start by their number of failures"
        found.append(tabulate(title, counted, summary["counts"]))
    return [*found, *isolation_tables(summary["isolation"])]


_LEGEND = (
    "left: in the worst direction within the limits, of that without failures. relative manip.: "
    "sqrt(det J_m J_m^T) over that without failures; best possible: what no robot with as many "
    "actuators exceeds for every set of as many locked ones. largest gain: norm of the actuators' "
    "motion per unit of the major task; error gain: major error per norm of the actuators' errors. "
    "postures: part of the workspace at which the task is kept."
)
