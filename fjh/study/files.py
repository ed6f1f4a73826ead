"""Writing of result files: a set of files is published completely or not at all."""

import json
import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from filelock import FileLock, Timeout

from fjh.study.errors import OutputError, WrongInput
from fjh.study.interrupts import uninterrupted

if TYPE_CHECKING:  # the help text must not depend on the slow import of NumPy
    from numpy.typing import NDArray

LOCK, STAGING = ".fjh.lock", ".fjh-staging-"

UNFINISHED = "unfinished.jsonl"
"""Name of the file with the rows of finished runs, until all runs are finished and published."""


def usable_folder(path: Path, option: str = "--out") -> Path:
    """Return the path of a folder that exists or can be made; call this before any work.

    Raises:
        OutputError: The path is a file, lies below one, is not writable, or is invalid.
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
        pass  # it can be made
    except OSError as error:
        raise OutputError(f"{option} {path} cannot be made: {error.strerror}") from None
    return path


def usable_file(path: Path, suffix: str, option: str = "--out") -> Path:
    """Return the folder of a file, after checks of its suffix and of the folder.

    Raises:
        OutputError: The file has another suffix, or its folder cannot be used.
    """
    if path.suffix != suffix:
        raise OutputError(f"{option} {path} must end in {suffix}")
    return usable_folder(path.parent, option)


@contextmanager
def created_folder(folder: Path) -> Iterator[None]:
    """Make a folder and its parents; at the end of the block remove new ones that are empty."""
    missing = [place for place in (folder, *folder.parents) if not place.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        yield
    finally:
        for place in missing:
            with suppress(OSError):  # it is not empty
                place.rmdir()


@contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """Lock a folder against other studies until the end of the block or of the process.

    Raises:
        WrongInput: Another study uses the folder.
        OutputError: The folder cannot be written.
    """
    with ExitStack() as at_exit:
        try:
            at_exit.enter_context(created_folder(folder))
            at_exit.enter_context(FileLock(folder / LOCK, timeout=0))
        except Timeout:
            raise WrongInput(f"{folder} is in use by another study: wait for its end") from None
        except OSError as error:
            reason = error.strerror or str(error)
            raise OutputError(f"{folder} could not be written: {reason}") from None
        at_exit.callback((folder / LOCK).unlink, missing_ok=True)
        for remnant in folder.glob(f"{STAGING}*"):  # of a study that was killed
            shutil.rmtree(remnant, ignore_errors=True)
        yield


@contextmanager
def published(folder: Path, index: str) -> Iterator[Path]:
    """Provide a temporary folder; at the end of the block move its files to `folder`.

    After an error the new files are deleted. The folder is made if necessary; files of the same
    names are replaced, and files that the former index lists as `files` but that are not among the
    new ones are removed. No other file is changed. The index is removed first and moved last: if it
    is present, all files that it lists are present.

    Raises:
        OutputError: The folder cannot be written; its former contents are still complete.
    """
    try:
        with (
            created_folder(folder),
            tempfile.TemporaryDirectory(dir=folder, prefix=STAGING) as staging,
        ):
            yield Path(staging)
            with uninterrupted():  # an interruption must not split the set
                _move_all(Path(staging), folder, index)
    except OSError as error:
        reason = error.strerror or str(error)
        raise OutputError(f"{folder} could not be written: {reason}") from None


def write_json(path: Path, content: dict[str, Any]) -> None:
    """Write JSON; raise `ValueError` for NaN and infinity."""
    path.write_text(json_text(content), encoding="utf-8")


def json_text(content: dict[str, Any]) -> str:
    """Return content as indented JSON; raise `ValueError` for NaN and infinity."""
    return json.dumps(content, indent=2, allow_nan=False) + "\n"


def write_index(path: Path, summary: dict[str, Any]) -> dict[str, Any]:
    """Write the index of a set of files, the summary with all names as `files`; return it."""
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
    """Return the file names that an index lists; none if it is missing or invalid."""
    try:
        names = json.loads(index.read_bytes())["files"]
        plain = {name for name in names if Path(name).name == name}
        return {name for name in plain if (index.parent / name).is_file()}
    except (OSError, ValueError, LookupError, TypeError):
        return set()
