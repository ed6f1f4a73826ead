"""Review of runs side by side in one recording: search, checks, and notes."""

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from fjh.recording.file import RecordingInfo
from fjh.recording.layout import write_scenes
from fjh.recording.properties import constants
from fjh.recording.read import NoRunError, RecordedRun, read_run
from fjh.recording.scene import scenes_of
from fjh.recording.view import RunView
from fjh.study.errors import WrongInput
from fjh.study.untrusted_files import read_json

_ROUNDING = 1e-9  # relative difference: on other machines sums may have another order


def write_review(file: Path, places: Sequence[Path], model: Path | None) -> None:
    """Write one recording of the runs in files and folders, for the given machine file."""
    runs = find_runs(places, model)
    scenes = scenes_of({name: one.view for name, one in runs.items()})
    write_scenes(file, about_runs(runs), scenes)


def find_runs(places: Sequence[Path], model: Path | None = None) -> dict[str, RecordedRun]:
    """Return runs by name, from files and from folders (there in the order of the JSON files).

    Numbers in a folder's JSON files must agree with the data; other files are ignored.

    Raises:
        WrongInput: A place has no run; or a run is given twice, incomplete, of another machine than
            `model`, or contradicts the JSON in its folder; or its machine file is missing.
    """
    all_runs: dict[Path, RecordedRun] = {}
    for place in places:
        runs, folder = dict[Path, RecordedRun](), place if place.is_dir() else place.parent
        stated = {file.name: read_json(file) for file in sorted(folder.glob("*.json"))}
        text = json.dumps(stated)
        for file in sorted(place.glob("*.npz"), key=lambda file: text.find(json.dumps(file.stem))):
            with suppress(NoRunError):
                runs[file] = read_run(file, model)
        if folder != place:
            runs[place] = read_run(place, model)
        if not runs:
            raise WrongInput(f"{place} has no run of `fjh table1`, `fjh track` or `fjh.record`")
        for file, run in runs.items():
            if file.resolve() in all_runs:
                raise WrongInput(f"{file} is named twice")
            check_stated(file.name, run.view, stated)
            all_runs[file.resolve()] = run
    return dict(zip(names_of(list(all_runs)), all_runs.values(), strict=True))


def names_of(files: Sequence[Path]) -> list[str]:
    """Return distinct short names of files: their stem, their folder, both, or the whole path."""
    candidates = (
        [file.stem for file in files],
        [file.parent.name for file in files],
        [f"{file.parent.name}/{file.stem}" for file in files],
    )
    distinct = (names for names in candidates if len(set(names)) == len(names))
    return next(distinct, [str(file.with_suffix("")) for file in files])


def check_stated(data: str, run: RunView, stated: Mapping[str, Any]) -> None:
    """Raise `WrongInput` if the JSON of a folder contradicts the run in one of its data files."""
    arrays = run.arrays
    computed = {"closure_residual_max_m": float(arrays["closure_residual_m"].max())}
    read = np.sqrt(((arrays["desired"] - arrays["measured"]) ** 2).mean(axis=0))
    for kind, errors in (("rms", run.rms()), ("measured_rms", read)):
        for row, unit, rms in zip(run.rows, run.stated.row_units, errors, strict=True):
            computed[f"{row}_{kind}_u{unit}"] = 1e6 * float(rms)
    for file, content in stated.items():
        for entry in (entry for entry in _entries(content) if entry.get("data") == data):
            for name in computed.keys() & entry.keys():
                value, limit = entry[name], _ROUNDING * abs(computed[name])
                if not (isinstance(value, int | float) and abs(value - computed[name]) <= limit):
                    raise WrongInput(
                        f"{file} states {name} = {value!s:.20} of {data}, "
                        f"whose data give {computed[name]:.10g}"
                    )


def _entries(content: Any) -> Iterator[dict[str, Any]]:
    if isinstance(content, dict):
        yield content
    if isinstance(content, dict | list):
        for part in content.values() if isinstance(content, dict) else content:
            yield from _entries(part)


def about_runs(runs: Mapping[str, RecordedRun]) -> RecordingInfo:
    """Return notes with the runs' errors, and the properties that all have in common."""
    first, *others = (one.parameters for one in runs.values())
    common = dict(item for item in first.items() if all(item in other.items() for other in others))
    views = {name: one.view for name, one in runs.items()}
    lines = [f"| {name} | {v.stated.robot} | {v.rms_text()} |" for name, v in views.items()]
    notes = ["# Side by side", "", "| run | robot | RMS error |", "| --- | --- | --- |", *lines, ""]
    notes += ["What all runs have in common:", "", *constants(common)]
    robots = "; ".join(dict.fromkeys(view.stated.robot for view in views.values()))
    results = {"study": "review", "robot": robots, "verdict": f"{len(runs)} runs side by side."}
    return RecordingInfo("review", "review", "\n".join(notes), common, results)
