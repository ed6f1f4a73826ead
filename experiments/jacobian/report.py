"""Everything that `fjh jacobian` leaves in its folder."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

from experiments.hexapod.provenance import plant_constants
from experiments.hexapod.recording.keep import keep_run
from experiments.hexapod.recording.notes import run_notes
from experiments.hexapod.recording.shown import Shown
from experiments.hexapod.scaling import grown_bench, grown_machine
from experiments.hexapod.testbed import Bench
from experiments.jacobian.figures import figure_loop, figure_variation
from experiments.jacobian.loop import VARIANTS, Case, Outcome
from experiments.output.files import published, write_index
from experiments.output.plotting import save_figure
from experiments.output.provenance import version_properties
from experiments.output.recording.file import About
from experiments.output.recording.marks import Mark
from sim import hexapod, load_model


def write(folder: Path, summary: dict[str, Any], outcomes: dict[Case, Outcome]) -> dict[str, Any]:
    """Write data, recordings and figures; all of them or none.

    Returns:
        The contents of `jacobian.json`: the summary and the names of all files.

    Raises:
        OutputError: The disk or the folder refuses.
    """
    with published(folder, index="jacobian.json") as staging:
        save_figure(figure_variation(hexapod(load_model()), summary), staging, "jacobian")
        if outcomes:
            save_figure(figure_loop(summary["loop"]), staging, "jacobian_loop")
        for case, outcome in outcomes.items():
            if case.is_recorded:
                _write_run(staging, case, outcome, summary)
        return write_index(staging / "jacobian.json", summary)


def _write_run(staging: Path, case: Case, outcome: Outcome, summary: dict[str, Any]) -> None:
    machine = grown_machine(load_model(), case.growth)
    around = asdict(grown_bench(Bench(), case.growth))
    plain = {"seed": case.seed, "model_sha256": summary["model_sha256"], "variant": case.variant}
    growth = {"stroke_factor": case.growth.stroke, "spiral_factor": case.growth.spiral}
    properties = plain | growth | version_properties(summary) | around | plant_constants(machine)
    notes = _notes(case, outcome, properties)
    about = About(f"jacobian-{case.name}", case.name, notes, properties)
    shown = Shown(outcome.trajectory, [Mark(0, 0.0, "strut 1 locked, known to the mapping")])
    keep_run(staging, case.name, about, machine, shown)


def _notes(case: Case, outcome: Outcome, properties: dict[str, Any]) -> str:
    """The run in words, shown beside its plots."""
    jacobian, form = VARIANTS[case.variant]
    duration_s = len(outcome.trajectory.time_s) * Bench().control_period_s
    said = [
        f"{case.column}, strut 1 locked; stroke x{case.growth.stroke:g}, spiral "
        f"x{case.growth.spiral:g}; seed {case.seed}, {duration_s:g} s.",
        "",
        f"{jacobian.capitalize()} Jacobian, {form} displacements.",
        "",
        f"Off the optimum of the secondary goal by {outcome.extra_percent:.2f} %.",
        "",
        f"e visited: {outcome.e_visited['frobenius']:.1e} (Frobenius), "
        f"{outcome.e_visited['two']:.1e} (2-norm).",
        "",
    ]
    return run_notes(case.name, said, outcome.trajectory, {}, properties)
