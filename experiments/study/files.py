"""Results on disk: a set of files appears whole or not at all."""

import fcntl
import json
import os
import re
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments.study.interrupts import uninterrupted

if TYPE_CHECKING:  # the help text does not wait for NumPy's import
    from numpy.typing import NDArray

PREFIX = ".fjh-"
_STAGING = re.compile(rf"{re.escape(PREFIX)}\w{{8}}")  # as tempfile completes the prefix


class OutputError(Exception):
    """The output folder cannot be used; the message says why."""


def usable_folder(path: Path, option: str = "--out") -> Path:
    """The folder itself, if it exists or can be made; to be called before any work is done.

    Raises:
        OutputError: It is a file, lies below one, is not writable, or is no path at all.
    """
    here = path.absolute()
    nearest = next(place for place in (here, *here.parents) if os.path.lexists(place))
    if not nearest.is_dir():
        raise OutputError(f"{option} {path} cannot be a folder: {nearest} is not one")
    if not os.access(nearest, os.W_OK):
        raise OutputError(f"{option} {path} cannot be written: no permission in {nearest}")
    try:
        here.lstat()
    except FileNotFoundError:
        pass  # it will be made
    except OSError as error:
        raise OutputError(f"{option} {path} cannot be made: {error.strerror}") from None
    return path


def usable_file(path: Path, suffix: str, option: str = "--out") -> Path:
    """The folder of a file of this ending, if it can be written there.

    Raises:
        OutputError: It has another ending, or its folder cannot be used.
    """
    if path.suffix != suffix:
        raise OutputError(f"{option} {path} must end in {suffix}")
    return usable_folder(path.parent, option)


@contextmanager
def made(folder: Path) -> Iterator[None]:
    """Make the folder and those above it; on leaving, those of them that are empty are removed."""
    missing = [place for place in (folder, *folder.parents) if not place.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        yield
    finally:
        for place in missing:
            with suppress(OSError):  # it is not empty
                place.rmdir()


@contextmanager
def published(folder: Path, index: str) -> Iterator[Path]:
    """A temporary folder to write into; at the end of the block its files move to `folder`.

    After an error they are deleted. The folder is made if need be; files of the same names are
    replaced, and files that the former index lists as `files` and the new set has not are removed.
    No other file is touched. The index, which names the others, is removed first and moved last:
    where it is, all files that it lists are.

    Raises:
        OutputError: The disk or the folder refuses; what was there before is still whole.
    """
    try:
        with made(folder), staging_folder(folder) as staging:
            yield staging
            with uninterrupted():  # all of them, or none
                _move_all(staging, folder, index)
    except OSError as error:
        reason = error.strerror or str(error)
        raise OutputError(f"{folder} could not be written: {reason}") from None


def write_json(path: Path, content: dict[str, Any]) -> None:
    """Write JSON; NaN is refused, since JSON has none."""
    path.write_text(json_text(content), encoding="utf-8")


def json_text(content: dict[str, Any]) -> str:
    """Content as indented JSON; `ValueError` for NaN and infinity, which JSON does not have."""
    return json.dumps(content, indent=2, allow_nan=False) + "\n"


def write_index(path: Path, summary: dict[str, Any]) -> dict[str, Any]:
    """What is written as the last file of a set: the summary, and as `files` the names of all."""
    files = sorted({path.name, *(file.name for file in path.parent.iterdir())})
    content = summary | {"files": files}
    write_json(path, content)
    return content


def write_arrays(path: Path, arrays: "Mapping[str, NDArray[Any]]") -> None:
    """Write an `.npz`, readable without pickle."""
    import numpy as np  # late, as above

    np.savez(path, allow_pickle=False, **dict(arrays))


def _move_all(staging: Path, folder: Path, index: str) -> None:
    names = sorted((file.name for file in staging.iterdir()), key=lambda name: name == index)
    for name in names:
        if (folder / name).is_dir():
            raise OutputError(f"{folder / name} is a folder where a file is to be written")
    outdated = _listed(folder / index) - set(names)
    (folder / index).unlink(missing_ok=True)
    for name in outdated:
        (folder / name).unlink(missing_ok=True)
    for name in names:
        (staging / name).replace(folder / name)


def _listed(index: Path) -> set[str]:
    """Files beside an index that it lists; none if it is missing or of another program."""
    try:
        names = json.loads(index.read_bytes())["files"]
        plain = {name for name in names if Path(name).name == name}
        return {name for name in plain if (index.parent / name).is_file()}
    except (OSError, ValueError, LookupError, TypeError):
        return set()


@contextmanager
def staging_folder(folder: Path) -> Iterator[Path]:
    """A new folder below `folder`, removed on leaving; those of dead processes are removed before.

    Its process keeps it locked (`flock`). The system releases the lock when the process ends,
    however it ends, so a staging folder that can be locked has no owner any more.
    """
    _remove_abandoned(folder)
    while True:
        with ExitStack() as held:
            with uninterrupted():  # until it is known, and will be removed
                name = held.enter_context(tempfile.TemporaryDirectory(dir=folder, prefix=PREFIX))
            held.enter_context(_locked(Path(name), wait=True))
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
