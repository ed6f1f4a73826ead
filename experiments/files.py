"""Results on disk: a file is there whole or not at all."""

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from sim import Array


class OutputError(Exception):
    """The output folder cannot be used; the message says why."""


def usable_folder(path: Path) -> Path:
    """The folder itself, if it is one or can be made; checked before any work is done.

    Raises:
        OutputError: It is a file, lies below one, or is not writable.
    """
    nearest = next(place for place in (path, *path.absolute().parents) if place.exists())
    if not nearest.is_dir():
        raise OutputError(f"--out {path} cannot be a folder: {nearest} is a file")
    if not os.access(nearest, os.W_OK):
        raise OutputError(f"--out {path} cannot be written: no permission in {nearest}")
    return path


def write_whole(path: Path, write: Callable[[Path], Any]) -> None:
    """Let `write` make a temporary neighbour, then put it in place in one step."""
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.stem}.partial{path.suffix}")
    try:
        write(partial)
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Write a text file whole."""
    write_whole(path, lambda partial: partial.write_text(text, encoding="utf-8"))


def write_json(path: Path, content: dict[str, Any]) -> None:
    """Write JSON whole; NaN is refused, since JSON has none."""
    write_text(path, json.dumps(content, indent=2, allow_nan=False) + "\n")


def write_arrays(path: Path, arrays: dict[str, Array]) -> None:
    """Write an `.npz` whole."""
    write_whole(path, lambda partial: np.savez(partial, allow_pickle=False, **arrays))
