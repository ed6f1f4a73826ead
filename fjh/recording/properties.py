"""Properties of a recording and its run, by which recordings can be searched."""

import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rerun.chunk import RrdReader

from fjh.study.errors import WrongInput
from fjh.study.result import Check

GROUPS = ("run", "results")
"""Groups of properties: parameters of the run, and its results."""


def properties_of(path: Path) -> dict[str, Any]:
    """Return all properties of a recording by name; each is a value or a list of values.

    Raises:
        WrongInput: The file is no complete recording.
    """
    run, results = groups_of(path)
    return run | results


def groups_of(path: Path) -> list[dict[str, Any]]:
    """Return the properties of each of `GROUPS`, with values as in :func:`properties_of`."""
    try:
        with warnings.catch_warnings(action="error"):  # the reader only warns of a truncated file
            reader = RrdReader(path)
            entities = [f"/__properties/{group}" for group in GROUPS]
            groups = [reader.stream().filter(content=entity).to_chunks() for entity in entities]
    except Exception as error:  # the reader's own errors have no common class
        reason = " ".join(str(error).split())
        raise WrongInput(f"{path} is not a readable recording: {reason}") from None
    return [
        {
            name: cell[0][0] if len(cell[0]) == 1 else cell[0]
            for chunk in chunks
            for name, cell in chunk.to_record_batch().to_pydict().items()
            if not name.startswith("rerun.")
        }
        for chunks in groups
    ]


def constants(properties: Mapping[str, Any]) -> list[str]:
    """Return all parameters as a table in Markdown; units are in their names."""
    return ["| parameter | value |", "| --- | --- |"] + [
        f"| {name} | {value} |" for name, value in properties.items()
    ]


def checked(checks: Sequence[Check]) -> str:
    """Return the text of the first failed check, or "passed"."""
    return next((str(check) for check in checks if not check.passed), "passed")
