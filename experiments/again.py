"""Repetition of a single run of a dataset."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from experiments.studies import study
from fjh.result_frames import runs_of
from fjh.rig.run import Run
from fjh.study.errors import WrongInput
from fjh.study.untrusted_files import read_json


def repeat_run(folder: Path | str, case: int) -> tuple[Run, pd.DataFrame]:
    """Simulate a run of a dataset again, and compare it with its stored row.

    Args:
        folder: Folder with the results of `fjh paper recover`, `fjh paper sweep` or
            `fjh paper atlas`.
        case: Number of the run, in the column `case`.

    Returns:
        The run, and a data frame with one row per measured quantity, whose columns are the
        `stored` value, the value `flown` now, and whether both are the `same` to 1e-9. Other
        versions of this project or its packages may cause differences.

    Raises:
        WrongInput: The folder has no such dataset or run, or the run cannot be repeated.
    """
    contents = [read_json(file) for file in sorted(Path(folder).glob("*.json"))]
    summary = next((one for one in contents if isinstance(one, dict) and "dataset" in one), None)
    rows = pd.DataFrame() if summary is None else runs_of(Path(folder), summary)
    stored = rows[rows.case == case] if len(rows) else rows
    if summary is None or stored.empty:
        raise WrongInput(f"{folder} has no dataset with case {case}")
    name = str(summary["experiment"])
    repeatable_runs = getattr(sys.modules[study(name).__module__], "repeatable_runs", None)
    if repeatable_runs is None:
        raise WrongInput(f"runs of study {name} cannot be repeated, only of recover, sweep, atlas")
    runs, repeat = repeatable_runs(summary)
    parameters, row = runs[case], stored.iloc[0]
    if changed := [k for k, v in parameters.parameters().items() if not _is_same(row.get(k), v)]:
        raise WrongInput(
            f"case {case} cannot be repeated: this version of fjh samples another {changed[0]}"
        )
    columns, run = repeat(parameters)
    comparison = pd.DataFrame({"stored": row, "flown": pd.Series(columns)}).loc[[*columns]]
    pairs = zip(comparison.stored, comparison.flown, strict=True)
    return run, comparison.assign(same=[_is_same(a, b) for a, b in pairs])


def _is_same(a: Any, b: Any) -> bool:
    if isinstance(a, float | int) and isinstance(b, float | int):
        return bool(np.isclose(a, b, rtol=1e-9, atol=0.0, equal_nan=True))
    if isinstance(a, np.ndarray | list | tuple) or isinstance(b, np.ndarray | list | tuple):
        return np.array_equal(a, b)
    return bool(a == b) or (pd.isna(a) and pd.isna(b))
