"""Columns of another controller, beside those of Table I."""

from functools import partial
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from experiments.rig.hexapod.metrics import each_angle
from experiments.rig.run import Run
from experiments.study.palette import BLACK, VERMILION
from experiments.study.plotting import PAGE_IN, new_figure
from experiments.study.quantity import columns_of
from experiments.study.results import Check, Picture
from experiments.study.tables import Column, Table
from experiments.table1.quantities import CLOSURE, DETECTOR, RMS
from experiments.table1.runs import Table1

_CONDITIONS = {
    "W_a": "no failure",
    "W_d": "strut 1 locked, known",
    "W_a_uncorrected": "strut 1 locked, not known",
}


def _motion(motion: str) -> Column:
    label = "peak " + ", ".join(motion.rsplit("_", 1))
    return Column(label, lambda column: column["secondary_peak"][motion], ".3f")


MOTION_ROWS = (
    *map(_motion, ("t_x_um", "t_y_um", "t_z_um", "gamma_urad")),
    *columns_of([CLOSURE]),
)
"""What is printed of the secondary motion, whoever the controller is."""

_ERROR_ROWS = (
    *columns_of(each_angle(RMS, DETECTOR)),
    Column("input, %", lambda column: max(column["strut_input_rms_percent"]), ".3f"),
)


def is_ours(column: dict[str, Any]) -> bool:
    """Whether this project's controller made the column."""
    return "controller" not in column


def controller_check(column: dict[str, Any]) -> Check:
    """Check that the controller of a column did not fail."""
    said = column["failure"] or "none"
    what = f"number of failures of the controller ({said})"
    return Check(what, column["name"], float(column["failure"] is not None), 0.5)


def controller_tables(summary: dict[str, Any]) -> list[Table]:
    """Each of its columns on the right of ours; none without another controller."""
    by_name = {column["name"]: column for column in summary["columns"]}
    theirs = [column for column in summary["columns"] if not is_ours(column)]
    if not theirs:
        return []
    columns = [each for one in theirs for each in (by_name[one["compared_with"]], one)]
    name = theirs[0]["controller"]
    headings = [_heading(column) for column in columns]
    return [
        Table(
            f"Controller {name} beside the prioritized mapping: RMS of desired minus true angle",
            ("", *headings),
            [(row.heading, *map(row.cell, columns)) for row in (*_ERROR_ROWS, *MOTION_ROWS)],
            "Pairs of columns have the same failures and the same noise. Strut 1 is locked in W_d "
            "and uncorr.; the controllers are told so in W_d only. detector: desired minus "
            "measured angle. input: largest RMS of a strut. peak: of the secondary motion. "
            "closure: largest residual of the loop closures.",
        )
    ]


def _heading(column: dict[str, Any]) -> str:
    ours = column.get("compared_with", column["name"])
    return ("" if is_ours(column) else "other\n") + ours.replace("_uncorrected", "\nuncorr.")


def controller_notes(summary: dict[str, Any]) -> list[str]:
    """Its errors over this project's, and its failures."""
    by_name = {column["name"]: column for column in summary["columns"]}
    notes = []
    for column in summary["columns"]:
        if is_ours(column):
            continue
        ours = by_name[column["compared_with"]]
        alpha, beta = (column[k] / ours[k] for k in ("alpha_rms_urad", "beta_rms_urad"))
        notes.append(
            f"{column['name']}: RMS errors of alpha and beta {alpha:.3g} and {beta:.3g} times "
            f"those of {ours['name']}."
        )
        if column["failure"]:
            notes.append(f"{column['name']}: {column['failure']}; its last inputs were held.")
    return notes


def controller_said(summary: dict[str, Any], column: dict[str, Any], locked: str) -> list[str]:
    """Notes of a recording."""
    said = [
        f"Column {column['name']} of Table I: controller {column['controller']}, seed "
        f"{summary['seed']}, {summary['duration_s']:g} s; {locked}."
    ]
    return said + (
        [f"{column['failure']}; its last inputs were held."] if column["failure"] else []
    )


def controller_pictures(outcome: Table1) -> list[Picture]:
    """Both controllers, condition by condition; none without another one."""
    if not outcome.compared:
        return []
    picture = Picture(
        "controller",
        f"This project's controller and {outcome.controller}, under the same failures and noise.",
        "Pointing error over time above, largest strut input below, for no failure, strut 1 locked "
        "and known, strut 1 locked and not known; two lines in each panel.",
        partial(figure_controller, outcome),
    )
    return [picture]


def figure_controller(outcome: Table1) -> Figure:
    """Pointing error and largest strut input over time, both controllers."""
    figure = new_figure(PAGE_IN, 4.2)
    panels = figure.subplots(2, len(outcome.compared), sharex=True, sharey="row")
    label = str(outcome.controller).partition(":")[2]
    for (above, below), each in zip(panels.T, outcome.compared, strict=True):
        name = each.column.name
        for run, said, color in (
            (outcome.runs[name], "prioritized mapping", BLACK),
            (each.run, label, VERMILION),
        ):
            _plot(above, below, run, label=said, color=color, lw=0.7, alpha=0.8)
        above.set_title(_CONDITIONS[name])
        below.set_xlabel("time, s")
    panels[0, 0].set_ylabel("pointing error, µrad")
    panels[1, 0].set_ylabel("largest strut input, %")
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2)
    return figure


def _plot(above: Any, below: Any, run: Run, **style: Any) -> None:
    error_urad = 1e6 * np.linalg.norm(run.error, axis=1)
    above.plot(run.time_s, error_urad, **style)
    below.plot(run.time_s, np.abs(run.inputs).max(axis=1), **style)
