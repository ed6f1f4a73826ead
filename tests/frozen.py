"""Search for writable arrays in frozen records."""

import dataclasses
import inspect
from collections.abc import Iterator, Mapping
from functools import cached_property
from types import ModuleType
from typing import Any

import numpy as np


def writable(package: ModuleType, path: str, value: Any) -> Iterator[str]:
    """Yield paths of writable arrays in the fields and cached properties of public records."""
    of: list[tuple[str, Any]] = []
    if isinstance(value, np.ndarray):
        if value.flags.writeable and value.size:
            yield path
    elif isinstance(value, tuple | list) and not hasattr(value, "_fields"):
        of = [(f"{path}[{k}]", each) for k, each in enumerate(value)]
    elif isinstance(value, Mapping):
        of = [(f"{path}[{key!r}]", each) for key, each in value.items()]
    elif type(value) in vars(package).values() and dataclasses.is_dataclass(value):
        of = [(f"{path}.{name}", getattr(value, name)) for name in _public(value)]
    for name, each in of:
        yield from writable(package, name, each)


def _public(record: Any) -> list[str]:
    """Return the names of the public fields and cached properties."""
    fields = [field.name for field in dataclasses.fields(record)]
    cached = [
        name
        for name, _ in inspect.getmembers_static(
            type(record), lambda each: isinstance(each, cached_property)
        )
    ]
    return [name for name in dict.fromkeys((*fields, *cached)) if name[0] != "_"]
