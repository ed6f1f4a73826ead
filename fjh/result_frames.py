"""Data frames of the results of studies in folders."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from fjh.recording.properties import properties_of
from fjh.study.errors import WrongInput
from fjh.study.untrusted_files import read_json


@dataclass(frozen=True)
class Results:
    """Data frames of the results of studies; their first columns are `study` and `folder`.

    Attributes:
        runs: A row for each run, from the study's dataset or its first table; for folders without
            JSON, a row for each recording with its properties.
        checks: A row for each check: what, where, value, limit, passed.
        files: A row for each file of a result: file, kind (its suffix).
    """

    runs: pd.DataFrame
    checks: pd.DataFrame
    files: pd.DataFrame


def results(*places: Path | str) -> Results:
    """Read the results in some folders and their subfolders, except hidden ones, as data frames.

    Raises:
        WrongInput: The folders have no results, or a file cannot be read.
    """
    studies = [
        frames
        for place in map(Path, places)
        for folder in (place, *sorted(place.rglob("*/")))
        if not any(part.startswith(".") for part in folder.relative_to(place).parts)
        for frames in _of_folder(folder)
    ]
    if not studies:
        folders = ", ".join(map(str, places)) or "an empty list of folders"
        raise WrongInput(f"no results of a study are in {folders}")
    return Results(*(pd.concat(parts, ignore_index=True) for parts in zip(*studies, strict=True)))


def _of_folder(folder: Path) -> Iterator[tuple[pd.DataFrame, ...]]:
    """Yield runs, checks and files of each study with results in a folder itself."""
    contents = [read_json(file) for file in sorted(folder.glob("*.json"))]
    studies = [one for one in contents if isinstance(one, dict) and "experiment" in one]
    if not studies and (recordings := sorted(folder.glob("*.rrd"))):
        runs = [{"recording": file.stem} | properties_of(file) for file in recordings]
        yield _frames(folder, "", runs, [], [file.name for file in recordings])
    for study in studies:
        lists = study.get("checks", []), study.get("files", [])
        yield _frames(folder, study["experiment"], runs_of(folder, study), *lists)


def _frames(
    folder: Path, name: str, runs: Any, checks: list[Any], files: list[str]
) -> tuple[pd.DataFrame, ...]:
    kinds = [{"file": file, "kind": Path(file).suffix} for file in files]
    frames = [pd.DataFrame(rows) for rows in (runs, checks, kinds)]
    # Integers remain integers next to missing values of other studies.
    frames = [one.astype(dict.fromkeys(one.select_dtypes("integer"), "Int64")) for one in frames]
    for k, frame in enumerate(frames):
        study = frame.get("study", name)  # a recording states its study
        frames[k] = frame.drop(columns=["study", "folder"], errors="ignore")
        frames[k].insert(0, "folder", str(folder))
        frames[k].insert(0, "study", study)
    return tuple(frames)


def runs_of(folder: Path, content: Mapping[str, Any]) -> pd.DataFrame:
    """Return the runs of a study from the contents of its JSON file and the dataset named there."""
    if dataset := content.get("dataset"):
        file = folder / Path(dataset).name
        try:
            return pd.read_parquet(file)
        except (OSError, ValueError) as error:
            raise WrongInput(f"{file} cannot be read: {' '.join(str(error).split())}") from None
    others = {"checks", *content.get("settings", ())}
    tables = [key for key, value in content.items() if is_table(value) and key not in others]
    if "settings" in content and tables:
        return pd.json_normalize(content[tables[0]])
    return pd.json_normalize([{k: v for k, v in content.items() if not isinstance(v, dict | list)}])


def is_table(value: Any) -> bool:
    """Return whether an entry of a study's JSON is a list of rows."""
    return isinstance(value, list) and bool(value) and all(isinstance(row, dict) for row in value)
