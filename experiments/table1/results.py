"""Table I as numbers, checks, table and files."""

from dataclasses import asdict
from functools import partial
from typing import Any

import numpy as np

from experiments.rig.checks import closure_check
from experiments.rig.hexapod import paper
from experiments.rig.hexapod.columns import COLUMNS
from experiments.rig.hexapod.columns import Column as Experiment
from experiments.rig.hexapod.controller import ANGLES
from experiments.rig.hexapod.metrics import is_cut, loop_measures
from experiments.study.provenance import versions
from experiments.study.quantity import checks_of, columns_of, entry_of
from experiments.study.results import Check, Results
from experiments.study.tables import Column, Table
from experiments.table1.comparison import (
    MOTION_ROWS,
    controller_check,
    controller_notes,
    controller_pictures,
    controller_tables,
    is_ours,
)
from experiments.table1.quantities import (
    COLUMN,
    OTHER_CLOSURE,
    Measured,
    error_quantities,
)
from experiments.table1.recording import loop_sentences, record_column
from experiments.table1.robustness import robustness, robustness_checks
from experiments.table1.runs import Compared, Table1, other_jacobian
from sim import Array


def results(outcome: Table1) -> Results:
    """Everything that `fjh table1` publishes."""
    summary = summarize(outcome)
    return Results(
        summary,
        tables=(table(summary), *controller_tables(summary)),
        notes=notes(summary),
        checks=checks(summary),
        pictures=[*outcome.pictures, *controller_pictures(outcome)],
        records=[
            partial(record_column, outcome, summary, checks(summary), column)
            for column in summary["columns"]
        ],
    )


def summarize(outcome: Table1) -> dict[str, Any]:
    """All numbers of the table, ready for JSON; units are in the names."""
    bench = outcome.configuration.bench
    ticks = len(outcome.runs["W_a"].time_s)
    loops = zip(ANGLES, outcome.loops, strict=True)
    return {
        "experiment": "table1",
        "seed": outcome.seed,
        "versions": versions(),
        "model_sha256": outcome.model_sha256,
        "jacobian": outcome.jacobian,
        "duration_s": ticks * bench.control_period_s,
        "configuration": outcome.configuration.name,
        "fit": outcome.configuration.fit,
        "bench": asdict(bench) | outcome.plant_constants,
        "loops": {angle: loop_measures(loop) for angle, loop in loops},
        "jacobian_comparison": compare_jacobians(outcome),
        "mismatch": robustness(outcome.mismatched),
        "columns": [
            *(_column(outcome, experiment) for experiment in COLUMNS),
            *(_compared_column(outcome, each) for each in outcome.compared),
        ],
    }


def compare_jacobians(outcome: Table1) -> dict[str, Any]:
    """Changes of the RMS errors with the other Jacobian, and with another seed."""
    table = {name: 1e6 * run.rms() for name, run in outcome.runs.items()}
    differences = [1e6 * run.rms() - table[name] for name, run in outcome.other.items()]
    by_jacobian = float(np.abs(differences).max())
    by_seed = float(np.abs(1e6 * outcome.reseeded.rms() - table["W_a"]).max())
    other = other_jacobian(outcome.jacobian)
    return {
        "other": other,
        "largest_rms_difference_urad": by_jacobian,
        "next_seed_rms_difference_urad": by_seed,
        "next_seed_closure_residual_max_m": outcome.reseeded.closure_max_m,
        "sentence": (
            f"With the {other} Jacobian the RMS errors change by at most {by_jacobian:.1e} urad, "
            f"which is {'below' if by_jacobian < by_seed else 'above'} the noise: another seed "
            f"changes those of W_a by {by_seed:.1e} urad."
        ),
    }


def checks(summary: dict[str, Any]) -> list[Check]:
    """Checks: closure residuals, RMS errors against the linear model, with mismatch too."""
    reseeded = summary["jacobian_comparison"]["next_seed_closure_residual_max_m"]
    found = [closure_check("W_a, next seed", reseeded)]
    for column in summary["columns"]:
        found += checks_of(COLUMN, summary | column, column["name"])
        found += checks_of([OTHER_CLOSURE], column, f"{column['name']}, other Jacobian")
        if not is_ours(column):
            found.append(controller_check(column))
    return found + robustness_checks(summary)


def table(summary: dict[str, Any]) -> Table:
    """The paper's arrangement: one column for each experiment."""
    columns = [column for column in summary["columns"] if is_ours(column)]
    title = f"Table I, configuration {summary['configuration']}: RMS of desired minus true angle"
    if is_cut(summary):
        title += f", first {summary['duration_s']:g} s of the spiral only"
    headings = [column["name"].replace("_uncorrected", "\nuncorr.") for column in columns]
    errors = error_quantities(with_paper=not is_cut(summary))
    rows = (Column("origin", "origin"), *columns_of(errors), *MOTION_ROWS)
    return Table(
        title,
        ("", *headings),
        [(row.heading, *map(row.cell, columns)) for row in rows],
        "Strut 1 is locked in the last three columns. origin: constants of the testbed were fitted "
        "to the column (fitted); its errors equal those of W_a by construction, since J_m M = I "
        "(= W_a); nothing was fitted to it (predicted). detector: desired minus measured angle, as "
        "in the paper. mismatched: on a plant with wrong gains, springs, dampers and masses, "
        "a delay, drifts, hysteresis and a vibrating floor. predicted: by the linear model of the "
        "nominal plant on the same floor. peak: of the secondary motion. closure: largest residual "
        "of the loop closures.",
    )


def notes(summary: dict[str, Any]) -> list[str]:
    """What was fitted, the loops, and what the Jacobian changes."""
    ours = [column for column in summary["columns"] if is_ours(column)]
    fit = [] if is_cut(summary) else [summary["fit"], _distance_sentence(ours)]
    sentences = [*fit, *loop_sentences(summary), summary["jacobian_comparison"]["sentence"]]
    if summary["mismatch"] is not None:
        sentences.append(summary["mismatch"]["sentence"])
    return [*sentences, *controller_notes(summary)]


def _distance_sentence(columns: list[dict[str, Any]]) -> str:
    """Largest differences from the paper's table, of this table and of a constant."""

    def entries(key: str) -> Array:
        return np.array([[column[key.format(angle)] for angle in ANGLES] for column in columns])

    printed = entries("paper_{}_rms_urad")
    off = 100 * np.abs(entries("{}_measured_rms_urad") / printed - 1)
    constant = 100 * np.abs(printed[:-1].mean(axis=0) / printed[:-1] - 1)
    return (
        f"Detector errors differ from the paper's by at most {off[:-1].max():.1f} % in W_a to W_e, "
        f"where a constant at the paper's mean differs by at most {constant.max():.1f} %, and by "
        f"at most {off[-1].max():.1f} % in the last column."
    )


def _column(outcome: Table1, experiment: Experiment) -> dict[str, Any]:
    name = experiment.name
    measured = Measured(
        outcome.runs[name],
        paper.TABLE_I_URAD[name],
        outcome.predicted_rad[name],
        outcome.other[name],
        outcome.mismatched.get(name),
    )
    return _entry(name, experiment, outcome.configuration.origin(name), measured)


def _compared_column(outcome: Table1, compared: Compared) -> dict[str, Any]:
    """A column of another controller; what it estimates is not known."""
    entry = _entry(compared.name, compared.column, "other", Measured(compared.run))
    return entry | {
        "secondary_peak_estimated": None,
        "controller": outcome.controller,
        "compared_with": compared.column.name,
        "failure": compared.failure,
    }


def _entry(name: str, experiment: Experiment, origin: str, measured: Measured) -> dict[str, Any]:
    column = {
        "name": name,
        "locked": experiment.struts("locked"),
        "free": experiment.struts("free"),
        "joint_weight": experiment.goal.joint_weight,
        "secondary_weight_t_x_t_y_t_z_gamma": experiment.goal.secondary_weight,
        "origin": origin,
        "recording": f"{name}.rrd",
        "data": f"{name}.npz",
    }
    return column | entry_of((*COLUMN, OTHER_CLOSURE), measured)
