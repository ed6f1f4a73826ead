"""Unusable files for the tests of all readers.

Each entry writes a file to a path, where a valid file may exist.
"""

import io
import os
import pickle
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.lib.format import write_array_header_1_0 as write_header

from fjh.study.input_checks import LARGEST_FILE

Spoil = Callable[[Path], object]
EXECUTED = "executed"
"""Folder that appears in the working folder if the content of a file was executed."""


class Evil:
    """Object that creates a folder when it is unpickled."""

    def __reduce__(self):
        return os.mkdir, (EXECUTED,)


def file_of(content: bytes) -> Spoil:
    return lambda path: path.write_bytes(content)


def _huge(path: Path) -> None:
    path.touch()
    os.truncate(path, LARGEST_FILE + 1)


NO_FILES: dict[str, Spoil] = {
    "missing": lambda path: None,
    "pipe": os.mkfifo,
    "folder": Path.mkdir,
    "symbolic loop": lambda path: path.symlink_to(path),
    "endless": lambda path: path.symlink_to("/dev/zero"),
    "huge": _huge,
}
"""Paths that must not be read or waited for."""

CONTENTS: dict[str, Spoil] = {
    "empty": file_of(b""),
    "text": file_of(b"neither data nor MJCF"),
    "not UTF-8": file_of(b"\x80\xff\xfe\n"),
    "zeros": file_of(b"\0" * 300 + b"\n"),
    "pickled": file_of(pickle.dumps(Evil())),
}


def without_its_last(count: int) -> Spoil:
    return lambda path: os.truncate(path, max(0, path.stat().st_size - count))


CUT_OFF: dict[str, Spoil] = {
    f"without its last {count} bytes": without_its_last(count) for count in (1, 30, 1000)
}


def _flipped(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0xFF
    path.write_bytes(bytes(content))


def saved(array: object) -> bytes:
    """Return an array as NumPy writes it; objects are pickled."""
    file = io.BytesIO()
    np.save(file, np.asarray(array), allow_pickle=True)
    return file.getvalue()


def _declared(*shape: int) -> bytes:
    """Return the header of an array without its data."""
    file = io.BytesIO()
    write_header(file, {"shape": shape, "fortran_order": False, "descr": "<f8"})
    return file.getvalue()


def write_npz(**entries: bytes) -> Spoil:
    """Return a function that writes an `.npz` of some entries."""

    def make(path: Path) -> None:
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
            for name, content in entries.items():
                file.writestr(f"{name}.npy", content)

    return make


def _bomb(path: Path) -> None:
    """Write an archive that declares more unpacked data than may be read."""
    write_npz(time_s=_declared(LARGEST_FILE // 8) + bytes(1000))(path)
    content = path.read_bytes()  # readers trust its directory
    at = content.rindex(b"PK\x01\x02") + 24
    path.write_bytes(content[:at] + (LARGEST_FILE + 1).to_bytes(4, "little") + content[at + 4 :])


ARRAYS: dict[str, Spoil] = {
    "objects": write_npz(time_s=saved(np.array([Evil()], dtype=object))),
    "beyond memory": write_npz(time_s=_declared(10**13)),
    "cut off": write_npz(time_s=_declared(100)),
    "negative": write_npz(time_s=_declared(-1)),
    "no array": write_npz(time_s=b"hello"),
    "nothing of a run": write_npz(time_s=saved(np.zeros(3))),
    "one array": file_of(saved([1.0])),
    "bomb": _bomb,
    "a flipped byte": _flipped,
    **CUT_OFF,
}
"""Broken `.npz` files."""


def _path(time_s: np.ndarray, desired: np.ndarray) -> Spoil:
    return write_npz(time_s=saved(time_s), desired=saved(desired))


PATHS: dict[str, Spoil] = {
    "another number of rows": _path(np.arange(3.0), np.zeros((3, 3))),
    "descending times": _path(-np.arange(3.0), np.zeros((3, 2))),
    "complex numbers": _path(np.arange(3.0), np.full((3, 2), 1j)),
    "NaN inside": _path(np.arange(3.0), np.full((3, 2), np.nan)),
    "no ticks": _path(np.zeros(0), np.zeros((0, 2))),
}

JSON: dict[str, Spoil] = {
    "nested without end": file_of(b"[" * 200_000),
    "endless number": file_of(b'{"a":' + b"9" * 6000 + b"}"),
    "half": file_of(b'{"columns": '),
}

TABLES: dict[str, Spoil] = {
    "NaN": file_of(b"1,nan\n1,1\n"),
    "infinite": file_of(b"1,inf\n1,1\n"),
    "ragged": file_of(b"1,1\n1\n"),
    "text": file_of(b"a,b\nc,d\n"),
}
"""Broken CSV files."""

MODELS: dict[str, Spoil] = {
    "no machine": file_of(b"<mujoco/>"),
    "half": file_of(b"<mujoco><worldbody>"),
    "another format": file_of(b"<html></html>"),
    "NaN": file_of(b'<mujoco><worldbody><body><geom size="nan"/></body></worldbody></mujoco>'),
}
"""Broken MJCF files."""
