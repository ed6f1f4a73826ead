"""Data and recording of one column of Table I."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from experiments.recording.record import About, write_run
from experiments.rig.hexapod.columns import hexapod_arrays
from experiments.rig.hexapod.metrics import is_cut, recording_properties
from experiments.rig.hexapod.rig import hexapod_rig
from experiments.rig.hexapod.testbed import Testbed
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
    locks = [f"strut {k + 1} locked, {known}" for k in column["locked"]]
    locked = ", ".join(locks) or "no failure"
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
    compared = {
        source: [column[f"{key}_{angle}_rms_urad"] for angle in ("alpha", "beta")]
        for source, key in sources.items()
    }
    predicted = None
    if "linear model" in compared:
        predicted = [1e-6 * urad for urad in compared["linear model"]]
    about = About(
        study="table1",
        identity="-".join([*words, f"seed{outcome.seed}"]),
        title=name,
        said=said,
        parameters=properties,
        compared=compared,
        predicted=(predicted, predicted),
        checks=checks,
    )
    testbed = Testbed(load_model(outcome.machine_file), outcome.configuration.bench, outcome.loops)
    write_run(
        folder / f"{name}.rrd",
        hexapod_rig(testbed),
        run,
        about,
        arrays=hexapod_arrays(run),
        known=known,
        machine_file=outcome.machine_file,
    )
