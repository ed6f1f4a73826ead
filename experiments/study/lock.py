"""A folder for one process at a time; the system takes the lock back however the process ends."""

import fcntl
import os
import platform
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TextIO

from experiments.study.files import OutputError, made
from experiments.study.study import WrongInput

LOCK = "_lock"
"""A name that readers of Parquet datasets pass over."""


@contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """The folder, made if need be, belongs to this process; if it is left empty, it is gone again.

    Raises:
        WrongInput: It belongs to another process, or to another call of this one.
        OutputError: The disk or the folder refuses.
    """
    path = folder / LOCK
    with ExitStack() as held:
        try:
            held.enter_context(made(folder))
            file = held.enter_context(_locked(path))
            file.truncate(0)
            file.write(f"process {os.getpid()} on {platform.node()}\n")
            file.flush()
        except OSError as error:
            raise OutputError(f"{folder} could not be locked: {error.strerror or error}") from None
        held.callback(_take_away, path, file)
        yield


def _locked(path: Path) -> TextIO:
    while True:
        path.parent.mkdir(parents=True, exist_ok=True)
        file = path.open("a+", encoding="utf-8", errors="replace")
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            with file:
                file.seek(0)
                owner = " ".join(file.read().split()) or "another process"
            raise WrongInput(f"{path.parent} is in use by {owner}: wait for its end") from None
        except OSError:
            file.close()
            raise
        if _is_at(path, file):
            return file
        file.close()  # its owner has just taken it away


def _take_away(path: Path, file: TextIO) -> None:
    if _is_at(path, file):
        path.unlink()


def _is_at(path: Path, file: TextIO) -> bool:
    """Whether the open file is still the one of this path."""
    try:
        return os.path.samestat(path.stat(), os.fstat(file.fileno()))
    except FileNotFoundError:
        return False
