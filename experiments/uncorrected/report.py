"""Everything that `fjh uncorrected` leaves in its folder."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from experiments.hexapod import paper
from experiments.hexapod.provenance import recording_properties
from experiments.hexapod.recording.keep import keep_run
from experiments.hexapod.recording.notes import run_notes
from experiments.hexapod.recording.shown import Shown
from experiments.hexapod.simulation import Trajectory
from experiments.output.files import published, write_arrays, write_index
from experiments.output.findings import is_cut
from experiments.output.plotting import save_figure
from experiments.output.recording.file import About
from experiments.output.recording.marks import Mark
from experiments.uncorrected.demand_limit_figure import figure_demand_limit
from experiments.uncorrected.figure import figure_uncorrected
from experiments.uncorrected.limit_map import ANTI_WINDUP
from experiments.uncorrected.stability_map import ROLL_OFF_HZ
from experiments.uncorrected.study import Uncorrected
from sim import Array, load_model

_PAPER_URAD = paper.TABLE_I_URAD["W_a_uncorrected"], paper.TABLE_I_URAD["W_a"]
_LOCKED = Mark(0, 0.0, "strut 1 locked, not known to the mapping")


def write(folder: Path, study: Uncorrected, summary: dict[str, Any]) -> dict[str, Any]:
    """Write data, recordings and figure; all of them or none.

    Returns:
        The contents of `uncorrected.json`: the summary and the names of all files.

    Raises:
        OutputError: The disk or the folder refuses.
    """
    properties = recording_properties(summary)
    with published(folder, index="uncorrected.json") as staging:
        for candidate in summary["candidates"]:
            name = candidate["name"]
            run = study.runs[name]["W_a_uncorrected"]
            if not isinstance(run, Trajectory):
                continue
            if not candidate["recording"]:
                write_arrays(staging / candidate["data"], asdict(run))
                continue
            own = properties | {f"candidate_{k}": v for k, v in candidate["differs"].items()}
            notes = _notes(candidate, summary, run, own)
            about = About(f"uncorrected-{name}-seed{study.seed}", name, notes, own)
            keep_run(staging, name, about, load_model(), Shown(run, [_LOCKED]))
        write_arrays(staging / "map.npz", _map_arrays(study))
        write_arrays(staging / "limit_map.npz", _limit_arrays(study))
        save_figure(figure_uncorrected(study, summary), staging, "uncorrected")
        save_figure(figure_demand_limit(study, summary), staging, "demand_limit")
        return write_index(staging / "uncorrected.json", summary)


def _map_arrays(study: Uncorrected) -> dict[str, Array]:
    return {
        "damping_ratio": study.grid.damping_ratio,
        "alpha_crossover_hz": study.grid.alpha_crossover_hz,
        "roll_off_hz": np.array(ROLL_OFF_HZ),
        "rms_urad": 1e6 * study.map_rad,
        "largest_pole": study.map_poles,
    }


def _limit_arrays(study: Uncorrected) -> dict[str, Array]:
    grid = study.limit_grid
    return {
        "exponent": np.array(grid.exponent),
        "direction": np.array(grid.direction),
        "start_deg": np.array(grid.start_deg),
        "anti_windup": np.array(ANTI_WINDUP),
        "limit_over_radius": grid.limit_over_radius,
        "rms_urad": 1e6 * study.limit_rad,
    }


def _notes(
    candidate: dict[str, Any], summary: dict[str, Any], run: Trajectory, properties: dict[str, Any]
) -> str:
    """The run in words, shown beside its plots."""
    ratio = candidate["ratio"]
    said = [
        f"Strut 1 locked, W_a uncorrected: {candidate['what']}.",
        "",
        f"Seed {summary['seed']}, {summary['duration_s']:g} s, constant Jacobian.",
        *([f"RMS over W_a's: alpha {ratio[0]:.3f}, beta {ratio[1]:.3f}."] if ratio else []),
    ]
    beside = {}
    if not is_cut(summary):
        the_papers = ", ".join(f"{u / a:.2f}" for u, a in zip(*_PAPER_URAD, strict=True))
        said.append(f"The paper's: {the_papers}.")
        beside["paper"] = paper.TABLE_I_URAD["W_a_uncorrected"]
    said.append("")
    title = candidate["name"].replace("_", " ")
    return run_notes(title, said, run, beside, properties)
