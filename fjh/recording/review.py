"""Runs side by side in one recording: finding them, checking them, and the notes on them."""

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
from fjh.study.foreign import read_json

_ROUNDING = 1e-9  # relative: sums may be taken in another order elsewhere


def write_review(file: Path, places: Sequence[Path], model: Path | None) -> None:
    """Write the recording of the runs in some places, drawn with their machine files, or this."""
    runs = find_runs(places, model)
    scenes = scenes_of({name: one.view for name, one in runs.items()})
    write_scenes(file, about_runs(runs), scenes)


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
        runs, folder = dict[Path, RecordedRun](), place if place.is_dir() else place.parent
        stated = {file.name: read_json(file) for file in sorted(folder.glob("*.json"))}
        words = json.dumps(stated)
        for file in sorted(place.glob("*.npz"), key=lambda file: words.find(json.dumps(file.stem))):
            with suppress(NoRunError):
                runs[file] = read_run(file, model)
        if folder != place:
            runs[place] = read_run(place, model)
        if not runs:
            raise WrongInput(f"{place} holds no run as `fjh table1` and `fjh track` write them")
        for file, run in runs.items():
            if file.resolve() in found:
                raise WrongInput(f"{file} is named twice")
            check_stated(file.name, run.view, stated)
            found[file.resolve()] = run
    return dict(zip(names_of(list(found)), found.values(), strict=True))


def names_of(files: Sequence[Path]) -> list[str]:
    """Of each its file's name, or its folder's, or as much of its path as makes them different."""
    ways = (
        [file.stem for file in files],
        [file.parent.name for file in files],
        [f"{file.parent.name}/{file.stem}" for file in files],
    )
    different = (names for names in ways if len(set(names)) == len(names))
    return next(different, [str(file.with_suffix("")) for file in files])


def check_stated(data: str, run: RunView, stated: Mapping[str, Any]) -> None:
    """Raise `WrongInput` where the JSON contents beside a data file contradict the run in it."""
    own = run.arrays
    computed = {"closure_residual_max_m": float(own["closure_residual_m"].max())}
    read = np.sqrt(((own["desired"] - own["measured"]) ** 2).mean(axis=0))
    for kind, errors in (("rms", run.rms()), ("measured_rms", read)):
        for row, unit, rms in zip(run.rows, run.stated.row_units, errors, strict=True):
            computed[f"{row}_{kind}_u{unit}"] = 1e6 * float(rms)
    for file, content in stated.items():
        for entry in (each for each in _entries(content) if each.get("data") == data):
            for name in computed.keys() & entry.keys():
                said, limit = entry[name], _ROUNDING * abs(computed[name])
                if not (isinstance(said, int | float) and abs(said - computed[name]) <= limit):
                    raise WrongInput(
                        f"{file} says {name} = {said!s:.20} of {data}, "
                        f"whose data give {computed[name]:.10g}"
                    )


def _entries(content: Any) -> Iterator[dict[str, Any]]:
    """Every object in it, at any depth."""
    if isinstance(content, dict):
        yield content
    if isinstance(content, dict | list):
        for part in content.values() if isinstance(content, dict) else content:
            yield from _entries(part)


def about_runs(runs: Mapping[str, RecordedRun]) -> RecordingInfo:
    """Notes with the runs' errors, and the properties that all share."""
    first, *others = (one.parameters for one in runs.values())
    common = dict(item for item in first.items() if all(item in other.items() for other in others))
    views = {name: one.view for name, one in runs.items()}
    lines = [f"| {name} | {v.stated.robot} | {v.rms_text()} |" for name, v in views.items()]
    notes = ["# Side by side", "", "| run | robot | RMS error |", "| --- | --- | --- |", *lines, ""]
    notes += ["What all runs have in common:", "", *constants(common)]
    robots = "; ".join(dict.fromkeys(view.stated.robot for view in views.values()))
    results = {"study": "review", "robot": robots, "verdict": f"{len(runs)} runs side by side."}
    return RecordingInfo("review", "review", "\n".join(notes), common, results)
