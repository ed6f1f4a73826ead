"""Everything that `fjh uncorrected` leaves in its folder."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from experiments.files import published, write_arrays, write_json
from experiments.provenance import recording_properties
from experiments.recording import write_recording
from experiments.run import Trajectory
from experiments.uncorrected.figure import figure_uncorrected
from experiments.uncorrected.stability_map import ROLL_OFF_HZ
from experiments.uncorrected.study import Uncorrected
from sim import Array

HEADINGS = ("", "ratios", "W_a", "W_d", "W_e")
"""Pairs of alpha, beta: both ratios, RMS of the other columns."""


def write(folder: Path, study: Uncorrected, summary: dict[str, Any]) -> None:
    """Write data, recordings and figure; all of them or none.

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
            write_arrays(staging / candidate["data"], asdict(run))
            if candidate["recording"]:
                write_recording(
                    staging / candidate["recording"],
                    f"uncorrected-{name}-seed{study.seed}",
                    name,
                    run,
                    _notes(candidate, summary),
                    properties | {f"candidate_{k}": v for k, v in candidate["differs"].items()},
                )
        write_arrays(staging / "map.npz", _map_arrays(study))
        figure_uncorrected(study, summary).savefig(staging / "uncorrected.png", dpi=130)
        write_json(staging / "uncorrected.json", summary)


def table_rows(summary: dict[str, Any]) -> list[tuple[str, ...]]:
    """Each candidate as (name, ratios, W_a, W_d, W_e)."""
    return [
        (
            candidate["name"].replace("_", " "),
            _pair(candidate["ratio"], ".2f"),
            *(
                _rms(column)
                for column in candidate["columns"]
                if column["name"] != "W_a_uncorrected"
            ),
        )
        for candidate in summary["candidates"]
    ]


def _rms(column: dict[str, Any]) -> str:
    """A star: by the linear model, not simulated."""
    if column["rms_urad"] is None:
        return "unstable"
    return _pair(column["rms_urad"], ".1f") + ("" if column["simulated_urad"] else " *")


def _pair(values: list[float] | None, digits: str) -> str:
    return "-" if values is None else ", ".join(format(value, digits) for value in values)


def _map_arrays(study: Uncorrected) -> dict[str, Array]:
    return {
        "damping_ratio": study.grid.damping_ratio,
        "alpha_crossover_hz": study.grid.alpha_crossover_hz,
        "roll_off_hz": np.array(ROLL_OFF_HZ),
        "rms_urad": 1e6 * study.map_rad,
        "largest_pole": study.map_poles,
    }


def _notes(candidate: dict[str, Any], summary: dict[str, Any]) -> str:
    """The run in words, shown beside its plots."""
    ratio = candidate["ratio"]
    return "\n".join(
        [
            f"# {candidate['name'].replace('_', ' ')}",
            "",
            f"Strut 1 locked, W_a uncorrected: {candidate['what']}.",
            "",
            f"Seed {summary['seed']}, {summary['duration_s']:g} s, constant Jacobian.",
            "",
            *([f"RMS over W_a's: alpha {ratio[0]:.3f}, beta {ratio[1]:.3f}."] if ratio else []),
            "",
            *(f"- {key}: {value:g}" for key, value in candidate["differs"].items()),
        ]
    )
