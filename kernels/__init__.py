"""Compiled C kernels of the per-tick computations: :data:`lib` has the functions of kernels.h.

Arrays are passed by :func:`pointer`. The kernels check nothing: shapes and finiteness are checked
where user arguments enter.
"""

import os
import re
from pathlib import Path
from typing import Any

import _cffi_backend
import numpy as np
from cffi import FFI

from kernels.build import LIBRARY, digest

__all__ = ["Struct", "ffi", "lib", "pointer"]

ffi: Any = FFI()
_KINDS = {"f8": "double", "i8": "int64_t", "i4": "int32_t", "i1": "int8_t", "?": "bool"}
_TYPES = {np.dtype(kind): ffi.typeof(f"{name}[]") for kind, name in _KINDS.items()}
_from_buffer: Any = _cffi_backend.from_buffer  # FFI.from_buffer takes twice as long


def _load() -> Any:
    """Load the library that the installation built.

    Raises:
        ImportError: The library is missing, or was built from sources other than these.
    """
    path = Path(os.environ.get("FJH_KERNELS", LIBRARY))
    advice = "compile the kernels of fjh first: `make venv`, or `pip install --editable .`"
    if not path.exists():
        raise ImportError(f"{path} is missing: {advice}")
    # By a pattern: the wheel build would take the first part of the literal name for a module.
    (file,) = Path(__file__).parent.glob("k*.h")
    header = file.read_text(encoding="utf-8")
    ffi.cdef(re.sub(r"^#.*$", "", header, flags=re.MULTILINE))
    library: Any = ffi.dlopen(str(path))
    if ffi.string(library.kernels_digest()).decode() != digest():
        raise ImportError(f"{path} was built from other sources: {advice}")
    return library


lib = _load()


def pointer(array: np.ndarray[Any, Any]) -> Any:
    """Return a contiguous array as a C argument; the call raises if the element type is wrong."""
    return _from_buffer(_TYPES[array.dtype], array)


class Struct:
    """C struct of kernels.h together with the arrays it points to; a copy points to its own arrays.

    Fields are numbers, arrays, or other structs; a field that is None or absent is zero or NULL.
    """

    __slots__ = ("_fields", "_kind", "pointer")

    def __init__(self, kind: str, **fields: Any) -> None:
        self._kind, self._fields = kind, fields
        values = {name: _field(value) for name, value in fields.items() if value is not None}
        self.pointer = ffi.new(f"{kind} *", values)

    def __reduce__(self) -> tuple[Any, ...]:
        return _struct, (self._kind, self._fields)


def _field(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return pointer(value)
    return value.pointer if isinstance(value, Struct) else value


def _struct(kind: str, fields: dict[str, Any]) -> Struct:
    return Struct(kind, **fields)
