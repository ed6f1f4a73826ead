"""Access to the files of a study."""

import json
from functools import cached_property
from math import nan
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd


class Results:
    """Files of a study in a folder."""

    def __init__(self, folder: Path, name: str) -> None:
        self.folder, self.name = folder, name

    @cached_property
    def summary(self) -> dict[str, Any]:
        return json.loads((self.folder / f"{self.name}.json").read_text())

    @cached_property
    def rows(self) -> pd.DataFrame:
        return pd.read_parquet(self.folder / self.summary["dataset"])

    @cached_property
    def tables(self) -> dict[str, pd.DataFrame]:
        return {
            key: pd.DataFrame(entries).replace({None: nan})
            for key, entries in self.summary.items()
            if isinstance(entries, list) and entries and isinstance(entries[0], dict)
        }

    def arrays(self, file: str) -> dict[str, np.ndarray]:
        """Return the contents of a `.npz` file."""
        with np.load(self.folder / file) as data:
            return dict(data)
