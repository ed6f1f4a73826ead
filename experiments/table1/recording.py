"""Data and recording of one column of Table I."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from experiments.recording.keep import record_run
from experiments.recording.marks import Mark
from experiments.rig.hexapod.metrics import is_cut, recording_properties
from experiments.study.results import Check
from experiments.table1.comparison import controller_said
from experiments.table1.runs import Table1
from sim import load_model

_CHOICES = ("locked", "free", "joint_weight", "secondary_weight_t_x_t_y_t_z_gamma")


def loop_sentences(summary: dict[str, Any]) -> list[str]:
    """Margins of both loops."""
    return [f"Loop {name}: {loop['sentence']}." for name, loop in summary["loops"].items()]


def record_column(
    outcome: Table1,
    summary: dict[str, Any],
    checks: Sequence[Check],
    column: dict[str, Any],
    folder: Path,
) -> None:
    """Write the data and the recording of one column."""
    name, chosen = column["name"], summary["configuration"]
    ours = column.get("compared_with", name)
    known = "uncorrected" if "uncorrected" in ours else "corrected"
    marks = [
        Mark(k, 0.0, f"strut {k + 1} locked, {known}", kind="locked") for k in column["locked"]
    ]
    locked = ", ".join(mark.failure for mark in marks) or "no failure"
    joints, secondary = column["joint_weight"], column["secondary_weight_t_x_t_y_t_z_gamma"]
    minimized = f"secondary motion, weights on t_x, t_y, t_z, gamma {secondary}"
    if joints:
        minimized = f"strut displacements, weights {joints}"
    sources = {"linear model": "predicted"}
    if not is_cut(summary):  # the paper's numbers are of the whole spiral
        sources["paper"] = "paper"
    # The viewer lays out all recordings of one identity alike.
    words = ["table1", *([] if chosen == "calibrated" else [chosen]), name]
    said = [
        f"Column {name} of Table I: seed {summary['seed']}, {summary['duration_s']:g} s, "
        f"{summary['jacobian']} Jacobian; {locked}. Minimized: {minimized}.",
        "",
        *loop_sentences(summary),
    ]
    properties = recording_properties(summary) | {
        key: column[key] for key in _CHOICES if column[key]
    }
    run = outcome.runs.get(name)
    if run is None:
        said, sources = controller_said(summary, column, locked), {}
        properties |= {"controller": column["controller"]}
        (run,) = (each.run for each in outcome.compared if each.name == name)
    record_run(
        folder,
        name,
        "-".join([*words, f"seed{outcome.seed}"]),
        load_model(outcome.machine_file),
        run,
        marks,
        said=said,
        beside={
            source: (column[f"{key}_alpha_rms_urad"], column[f"{key}_beta_rms_urad"])
            for source, key in sources.items()
        },
        properties=properties,
        predicted_rad=_predicted_rad(column) if sources else None,
        checks=checks,
    )


def _predicted_rad(column: dict[str, Any]) -> list[float]:
    return [1e-6 * column[f"predicted_{angle}_rms_urad"] for angle in ("alpha", "beta")]
