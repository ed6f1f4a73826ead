"""Results of studies in folders, as data frames."""

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
    """What studies left in folders; `study` and `folder` are the first columns of each frame.

    Attributes:
        runs: A row for each run, as the study's dataset or its first table has it; of folders
            without JSON, a row for each recording with its properties.
        checks: A row for each check: what, where, value, limit, passed.
        files: A row for each file: file, kind (its suffix).
    """

    runs: pd.DataFrame
    checks: pd.DataFrame
    files: pd.DataFrame


def results(*places: Path | str) -> Results:
    """Read the results in some folders and in all folders below them but hidden ones.

    Raises:
        WrongInput: There are none, or a file of them cannot be read.
    """
    found = [
        frames
        for place in map(Path, places)
        for folder in (place, *sorted(place.rglob("*/")))
        if not any(part.startswith(".") for part in folder.relative_to(place).parts)
        for frames in _of_folder(folder)
    ]
    if not found:
        raise WrongInput(f"no results of a study are in {', '.join(map(str, places)) or 'nothing'}")
    return Results(*(pd.concat(each, ignore_index=True) for each in zip(*found, strict=True)))


def _of_folder(folder: Path) -> Iterator[tuple[pd.DataFrame, ...]]:
    """Runs, checks and files of each study with results in a folder itself."""
    contents = [read_json(file) for file in sorted(folder.glob("*.json"))]
    studies = [each for each in contents if isinstance(each, dict) and "experiment" in each]
    if not studies and (recordings := sorted(folder.glob("*.rrd"))):
        runs = [{"recording": file.stem} | properties_of(file) for file in recordings]
        yield _named(folder, "", runs, [], [file.name for file in recordings])
    for each in studies:
        name = each["experiment"]
        yield _named(
            folder, name, runs_of(folder, each), each.get("checks", []), each.get("files", [])
        )


def _named(
    folder: Path, name: str, runs: Any, checks: list[Any], files: list[str]
) -> tuple[pd.DataFrame, ...]:
    kinds = [{"file": file, "kind": Path(file).suffix} for file in files]
    frames = [pd.DataFrame(each) for each in (runs, checks, kinds)]
    # Numbers of other studies may be missing beside them, and whole numbers stay whole.
    frames = [each.astype(dict.fromkeys(each.select_dtypes("integer"), "Int64")) for each in frames]
    for k, frame in enumerate(frames):
        own = frame.get("study", name)  # a recording says itself which study it is of
        frames[k] = frame.drop(columns=["study", "folder"], errors="ignore")
        frames[k].insert(0, "folder", str(folder))
        frames[k].insert(0, "study", own)
    return tuple(frames)


def runs_of(folder: Path, content: Mapping[str, Any]) -> pd.DataFrame:
    """The runs of a study from the contents of its JSON file, and the dataset that this names."""
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
    """Whether an entry of a study's JSON holds rows."""
    return isinstance(value, list) and bool(value) and all(isinstance(each, dict) for each in value)
