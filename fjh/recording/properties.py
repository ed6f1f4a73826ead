"""Properties of a recording and of its run, for whoever looks for one among many."""

import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rerun.chunk import RrdReader

from fjh.study.errors import WrongInput
from fjh.study.result import Check

GROUPS = ("run", "results")
"""Groups of properties: how the run was made, and what came out."""


def properties_of(path: Path) -> dict[str, Any]:
    """All properties of a recording by name, those of both groups; one value, or a list of several.

    Raises:
        WrongInput: It is no whole recording.
    """
    run, results = groups_of(path)
    return run | results


def groups_of(path: Path) -> list[dict[str, Any]]:
    """The properties of each of `GROUPS`; as of :func:`properties_of`."""
    try:
        with warnings.catch_warnings(action="error"):  # of a file that ends too early it only warns
            reader = RrdReader(path)
            places = [f"/__properties/{group}" for group in GROUPS]
            found = [reader.stream().filter(content=each).to_chunks() for each in places]
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
        for chunks in found
    ]


def constants(properties: Mapping[str, Any]) -> list[str]:
    """All parameters as a table in Markdown; units are in their names."""
    return ["| parameter | value |", "| --- | --- |"] + [
        f"| {name} | {value} |" for name, value in properties.items()
    ]


def checked(checks: Sequence[Check]) -> str:
    """The first check that failed, or "passed"."""
    return next((str(check) for check in checks if not check.passed), "passed")
