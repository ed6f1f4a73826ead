"""Runs side by side in one recording: finding them, checking them, and the notes on them."""

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from experiments.recording.file import RecordingInfo
from experiments.recording.keep import NoRunError, RecordedRun, read_run
from experiments.recording.screens import write_side_by_side
from experiments.recording.shown import constants
from experiments.rig.hexapod import paper
from experiments.rig.hexapod.metrics import closure_residual_max_m, pointing_rms_urad, rms
from experiments.rig.hexapod.simulation import Trajectory
from experiments.rig.hexapod.testbed import TestbedConfig
from experiments.study.foreign import read_json
from experiments.study.study import WrongInput
from sim import hexapod, load_model, model_sha256

_ROUNDING = 1e-9
"""Relative: sums may be taken in another order elsewhere."""


def write_review(file: Path, places: Sequence[Path], model: Path | None) -> None:
    """Write the recording of the runs in some places, drawn as the hexapod of this MJCF."""
    machine = load_model(model)
    hexapod(machine)  # raises for any other
    kept = find_runs(places, model_sha256(model))
    shown = {name: one.shown for name, one in kept.items()}
    write_side_by_side(file, about_runs(kept), machine, shown)


def find_runs(places: Sequence[Path], model_sha256: str) -> dict[str, RecordedRun]:
    """Runs by name: single ones, and those in folders, in the order in which its JSON names them.

    Other files of a folder are ignored. What JSON beside a run states must agree with its data, and
    its machine with the one to be drawn.

    Raises:
        WrongInput: There is no run of the hexapod in one of the places, one is named twice, is
            not whole, is of another machine, or is not what the JSON beside it states.
    """
    found: dict[Path, RecordedRun] = {}
    for place in places:
        stated = read_summaries(place if place.is_dir() else place.parent)
        runs = _runs_in(place, stated) if place.is_dir() else {place: read_run(place)}
        if not runs:
            raise WrongInput(f"{place} holds no run of the hexapod as `fjh table1` writes them")
        for file, run in runs.items():
            if file.resolve() in found:
                raise WrongInput(f"{file} is named twice")
            if run.properties.get("model_sha256", model_sha256) != model_sha256:
                raise WrongInput(f"{file} is a run of another machine; --model FILE draws that")
            check_stated(file.name, run.shown.run, stated)
            found[file.resolve()] = run
    stems = [file.stem for file in found]
    return {
        file.stem if stems.count(file.stem) == 1 else f"{file.parent.name}/{file.stem}": run
        for file, run in found.items()
    }


def _runs_in(folder: Path, stated: dict[str, Any]) -> dict[Path, RecordedRun]:
    words, found = json.dumps(stated), {}
    for file in sorted(folder.glob("*.npz"), key=lambda file: words.find(json.dumps(file.stem))):
        with suppress(NoRunError):
            found[file] = read_run(file)
    return found


def read_summaries(folder: Path) -> dict[str, Any]:
    """Contents of the JSON files of a folder, by their names; `WrongInput` if one is unreadable."""
    return {file.name: read_json(file) for file in sorted(folder.glob("*.json"))}


def check_stated(data: str, run: Trajectory, stated: dict[str, Any]) -> None:
    """Raise `WrongInput` where the JSON contents beside a data file contradict the run in it."""
    computed = {"closure_residual_max_m": closure_residual_max_m(run)}
    measured_urad = 1e6 * rms(run.desired_rad - run.measured_rad)
    for kind, urad in (("rms", pointing_rms_urad(run)), ("measured_rms", measured_urad)):
        computed |= {f"alpha_{kind}_urad": float(urad[0]), f"beta_{kind}_urad": float(urad[1])}
    for file, content in stated.items():
        for entry in (each for each in _entries(content) if each.get("data") == data):
            for name in computed.keys() & entry.keys():
                if not _agree(entry[name], computed[name]):
                    raise WrongInput(
                        f"{file} says {name} = {entry[name]!s:.20} of {data}, "
                        f"whose data give {computed[name]:.10g}"
                    )


def _agree(stated: Any, computed: float) -> bool:
    return isinstance(stated, int | float) and abs(stated - computed) <= _ROUNDING * abs(computed)


def _entries(content: Any) -> Iterator[dict[str, Any]]:
    """Every object in it, at any depth."""
    if isinstance(content, dict):
        yield content
    if isinstance(content, dict | list):
        for part in content.values() if isinstance(content, dict) else content:
            yield from _entries(part)


def about_runs(runs: Mapping[str, RecordedRun]) -> RecordingInfo:
    """Notes with a table of the runs' numbers, the paper's beside; properties that all share."""
    first, *others = (one.properties for one in runs.values())
    common = dict(item for item in first.items() if all(item in other.items() for other in others))
    table = [
        "| run | alpha, urad RMS | beta | paper, alpha | beta | largest strut input, % "
        "| largest t_x, um | t_y | t_z | gamma, urad | closure, nm |",
        "| --- |" + " --- |" * 10,
        *(_row(name, run) for name, run in runs.items()),
    ]
    colors = (
        "The plane beside each run has the error of beta, desired minus true, over that of alpha. "
        "Struts are blue for negative and red for positive input; a failed one wears a yellow "
        "collar."
    )
    shared = ["What all runs have in common:", "", *constants(common)]
    notes = ["# Side by side", "", *table, "", colors, "", *shared]
    return RecordingInfo("review", "review", "\n".join(notes), common)


def _row(name: str, one: RecordedRun) -> str:
    run = one.shown.run
    alpha, beta = pointing_rms_urad(run)
    # The paper's numbers are of the whole spiral.
    is_whole = len(run.time_s) == len(TestbedConfig().time_s(TestbedConfig().duration_s))
    is_the_papers = one.experiment == "table1" and is_whole
    paper_rms = paper.TABLE_I_URAD.get(name) if is_the_papers else None
    gamma, *translation = 1e6 * np.abs(run.secondary).max(axis=0)
    cells = [
        *(name, f"{alpha:.4f}", f"{beta:.4f}"),
        *([f"{value:.4f}" for value in paper_rms] if paper_rms else ["", ""]),
        f"{np.abs(run.strut_input_percent).max():.2f}",
        *(f"{value:.3f}" for value in (*translation, gamma)),
        f"{1e9 * closure_residual_max_m(run):.2f}",
    ]
    return "| " + " | ".join(cells) + " |"
