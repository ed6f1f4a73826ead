"""Runs side by side in one recording: finding them, checking them, and the notes on them."""

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from experiments.recording.file import RecordingInfo
from experiments.recording.layout import write_scenes
from experiments.recording.properties import constants
from experiments.recording.read import NoRunError, RecordedRun, read_run
from experiments.recording.scene import scenes_of
from experiments.recording.view import RunView
from experiments.rig.hexapod import paper
from experiments.rig.hexapod.testbed import TestbedConfig
from experiments.rig.units import said
from experiments.study.foreign import read_json
from experiments.study.study import WrongInput

_ROUNDING = 1e-9
"""Relative: sums may be taken in another order elsewhere."""
_OF_ONE_ROBOT = ("track", "record", "live")
"""Of one robot each: a run is called by its model, not by its file."""


def write_review(file: Path, places: Sequence[Path], model: Path | None) -> None:
    """Write the recording of the runs in some places, drawn with their machine files, or this."""
    kept = find_runs(places, model)
    scenes = scenes_of({name: one.view for name, one in kept.items()})
    write_scenes(file, about_runs(kept), scenes)


def find_runs(places: Sequence[Path], model: Path | None = None) -> dict[str, RecordedRun]:
    """Runs by name: single ones, and those in folders, in the order in which its JSON names them.

    Other files of a folder are ignored. What JSON beside a run states must agree with its data.

    Raises:
        WrongInput: There is no run in one of the places, one is named twice, is not whole, is of
            another machine than the file `model`, or is not what the JSON beside it states; or the
            file of its machine is not found.
    """
    found: dict[Path, RecordedRun] = {}
    for place in places:
        stated = read_summaries(place if place.is_dir() else place.parent)
        runs = _runs_in(place, stated, model) if place.is_dir() else {place: read_run(place, model)}
        if not runs:
            raise WrongInput(f"{place} holds no run as `fjh table1` and `fjh track` write them")
        for file, run in runs.items():
            if file.resolve() in found:
                raise WrongInput(f"{file} is named twice")
            check_stated(file.name, run.view, stated)
            found[file.resolve()] = run
    return dict(zip(_names(found), found.values(), strict=True))


def _names(found: Mapping[Path, RecordedRun]) -> list[str]:
    """Short and different: a robot's name, or that of the file; with more where two agree."""
    ways = []
    for file, run in found.items():
        each = [file.stem, f"{file.parent.name}/{file.stem}", str(file.with_suffix(""))]
        if run.study in _OF_ONE_ROBOT:
            robot = run.view.stated.robot
            each = [robot, *(f"{robot}, {way}" for way in each)]
        ways.append([*each, each[-1]])
    names = [each[0] for each in ways]
    for k in (1, 2, 3):
        names = [
            way[k] if names.count(name) > 1 else name for name, way in zip(names, ways, strict=True)
        ]
    return names


def _runs_in(folder: Path, stated: dict[str, Any], model: Path | None) -> dict[Path, RecordedRun]:
    words, found = json.dumps(stated), {}
    for file in sorted(folder.glob("*.npz"), key=lambda file: words.find(json.dumps(file.stem))):
        with suppress(NoRunError):
            found[file] = read_run(file, model)
    return found


def read_summaries(folder: Path) -> dict[str, Any]:
    """Contents of the JSON files of a folder, by their names; `WrongInput` if one is unreadable."""
    return {file.name: read_json(file) for file in sorted(folder.glob("*.json"))}


def check_stated(data: str, run: RunView, stated: dict[str, Any]) -> None:
    """Raise `WrongInput` where the JSON contents beside a data file contradict the run in it."""
    own, units = run.arrays, run.stated.row_units
    computed = {"closure_residual_max_m": float(own["closure_residual_m"].max())}
    read = np.sqrt(((own["desired"] - own["measured"]) ** 2).mean(axis=0))
    for kind, errors in (("rms", run.rms()), ("measured_rms", read)):
        for row, unit, rms in zip(run.rows, units, errors, strict=True):
            computed[f"{row}_{kind}_u{unit}"] = 1e6 * float(rms)
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
    first, *others = (one.parameters for one in runs.values())
    common = dict(item for item in first.items() if all(item in other.items() for other in others))
    heads = ["run", "RMS error", "paper", "largest input", "diagnosed", "largest gap"]
    table = [heads, ["---"] * len(heads), *(_row(name, run) for name, run in runs.items())]
    drawn = (
        "The plane beside each run has its error, desired minus true. What has failed is magenta; "
        "struts are blue for negative and red for positive input."
    )
    shared = ["What all runs have in common:", "", *constants(common)]
    lines = [f"| {' | '.join(cells)} |" for cells in table]
    notes = ["# Side by side", "", *lines, "", drawn, "", *shared]
    robots = "; ".join(dict.fromkeys(one.view.stated.robot for one in runs.values()))
    results = {"study": "review", "robot": robots, "verdict": f"{len(runs)} runs side by side."}
    return RecordingInfo("review", "review", "\n".join(notes), common, results)


def _row(name: str, one: RecordedRun) -> list[str]:
    run = one.view
    its, gap_m = run.stated, run.arrays["closure_residual_m"]
    # The paper's numbers are of the whole spiral.
    is_whole = len(run.time_s) == len(TestbedConfig().time_s(TestbedConfig().duration_s))
    is_the_papers = one.study == "table1" and is_whole
    paper_rms = paper.TABLE_I_URAD.get(name) if is_the_papers else None
    largest = dict[str, float]()
    for unit, peak in zip(its.input_units, np.abs(run.arrays["inputs"]).max(axis=0), strict=True):
        largest[unit] = max(largest.get(unit, 0.0), float(peak))
    diagnosed = [
        f"{each.actuator} {found.kind}: {said(found.time_s - each.time_s, 's')}"
        for each in run.failures
        if (found := run.diagnosis_of(each)) is not None
    ]
    return [
        name,
        _said(run, 1e6 * run.rms()) if one.study == "table1" else run.rms_text(),
        _said(run, paper_rms) if paper_rms else "",
        ", ".join(said(peak, unit) for unit, peak in largest.items()),
        ", ".join(diagnosed) or ("not diagnosed" if run.failures else ""),
        f"{1e9 * gap_m.max():.2f} nm" if gap_m.any() else "",
    ]


def _said(run: RunView, values: Any) -> str:
    """Numbers of each major row with its name, in millionths of its unit."""
    named = zip(run.rows, values, run.stated.row_units, strict=True)
    return ", ".join(f"{row} {value:.4f} u{unit}" for row, value, unit in named)
