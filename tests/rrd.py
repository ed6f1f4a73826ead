"""Read recordings independently of the code that wrote them."""

from pathlib import Path
from typing import Any

import numpy as np
from rerun.chunk import RrdReader


def rows(path: Path, entity: str, component: str) -> tuple[np.ndarray, list[Any]]:
    """Return times [ns] and values of a component of an entity, ordered by time."""
    stream = RrdReader(path).stream()
    chunks = stream.filter(content=entity, components=component, is_static=False).to_chunks()
    batches = [chunk.to_record_batch() for chunk in chunks]
    times = np.concatenate([b.column("sim_time").cast("int64").to_numpy() for b in batches])
    values = [value for batch in batches for value in batch.column(component).to_pylist()]
    order = np.argsort(times, kind="stable")
    return times[order], [values[k] for k in order]


def scalars(path: Path, entity: str) -> tuple[np.ndarray, np.ndarray]:
    """Return times [ns] and values (T, k) of an entity's lines."""
    times, values = rows(path, entity, "Scalars:scalars")
    return times, np.array(values)


def static(path: Path, entity: str, component: str) -> list[Any]:
    """Return a component without time."""
    stream = RrdReader(path).stream()
    chunks = stream.filter(content=entity, components=component, is_static=True).to_chunks()
    return chunks[0].to_record_batch().column(component).to_pylist()[0]


def notes(path: Path) -> str:
    """Return the text of the recording's notes."""
    return static(path, "/notes", "TextDocument:text")[0]


def entities(path: Path) -> set[str]:
    """Return the paths of all entities with data."""
    return set(RrdReader(path).store().schema().entity_paths(include_properties=False))
