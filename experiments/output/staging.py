"""Folders for unfinished files; the next run removes those whose process has died."""

import fcntl
import os
import re
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

PREFIX = ".fjh-"
_STAGING = re.compile(rf"{re.escape(PREFIX)}\w{{8}}")  # as tempfile completes the prefix


@contextmanager
def staging_folder(folder: Path) -> Iterator[Path]:
    """A new folder below `folder`, removed on leaving; those of dead processes are removed before.

    Its process keeps it locked (`flock`). The system releases the lock when the process ends,
    however it ends, so a staging folder that can be locked has no owner any more.

    Raises:
        OSError: The disk or the folder refuses.
    """
    _remove_abandoned(folder)
    while True:
        with (
            tempfile.TemporaryDirectory(dir=folder, prefix=PREFIX) as name,
            _locked(Path(name), wait=True),
        ):
            # Before it was locked, another process may have taken it for abandoned.
            if Path(name).is_dir():
                yield Path(name)
                return


def _remove_abandoned(folder: Path) -> None:
    for place in [each for each in folder.iterdir() if _STAGING.fullmatch(each.name)]:
        with _locked(place, wait=False) as ours, suppress(OSError):
            if ours:
                shutil.rmtree(place)


@contextmanager
def _locked(folder: Path, *, wait: bool) -> Iterator[bool]:
    """Whether it is locked for this process: not if it is another's, gone, or cannot be locked.

    Where the file system has no locks, nothing is ever taken for abandoned.
    """
    with ExitStack() as stack:
        try:
            handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
            stack.callback(os.close, handle)
            fcntl.flock(handle, fcntl.LOCK_EX if wait else fcntl.LOCK_EX | fcntl.LOCK_NB)
            locked = True
        except OSError:
            locked = False
        yield locked
