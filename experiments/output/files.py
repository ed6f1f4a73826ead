"""Results on disk: a set of files appears whole or not at all."""

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments.output.staging import staging_folder

if TYPE_CHECKING:  # the help text need not wait for MuJoCo's import
    from sim import Array


class OutputError(Exception):
    """The output folder cannot be used; the message says why."""


def usable_folder(path: Path, option: str = "--out") -> Path:
    """The folder itself, if it is one or can be made; checked before any work is done.

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
        OutputError: It has another ending, or its folder cannot be used; the message names the
            option that asked for it.
    """
    if path.suffix != suffix:
        raise OutputError(f"{option} {path} must end in {suffix}")
    return usable_folder(path.parent, option)


@contextmanager
def made(folder: Path) -> Iterator[None]:
    """The folder is there, made with those above it; on leaving, those made in vain are gone.

    Raises:
        OSError: It cannot be made.
    """
    missing = [place for place in (folder, *folder.parents) if not place.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        yield
    finally:
        for place in missing:
            with suppress(OSError):  # something came
                place.rmdir()


@contextmanager
def published(folder: Path, index: str) -> Iterator[Path]:
    """A temporary folder to write into; on leaving it without an error its files move to `folder`.

    Args:
        folder: Made if need be; files of the same names are replaced, and files that the former
            index lists as `files` and the new set has not are removed. No other file is touched.
        index: The file that names the others. It leaves first and arrives last, so that whoever
            finds it finds what it speaks of.

    Raises:
        OutputError: The disk or the folder refuses; what was there before is still whole.
    """
    try:
        with made(folder), staging_folder(folder) as staging:
            yield staging
            _move_all(staging, folder, index)
    except OSError as error:
        reason = error.strerror or str(error)
        raise OutputError(f"{folder} could not be written: {reason}") from None


def write_json(path: Path, content: dict[str, Any]) -> None:
    """Write JSON; NaN is refused, since JSON has none."""
    path.write_text(json_text(content), encoding="utf-8")


def json_text(content: dict[str, Any]) -> str:
    """Content as JSON for people to read, too.

    Raises:
        ValueError: A number is NaN or infinite, which JSON has not.
    """
    return json.dumps(content, indent=2, allow_nan=False) + "\n"


def write_index(path: Path, summary: dict[str, Any]) -> dict[str, Any]:
    """Write the last file of a set: the summary, and as `files` the names of all files beside it.

    Returns:
        What was written.
    """
    files = sorted({path.name, *(file.name for file in path.parent.iterdir())})
    content = summary | {"files": files}
    write_json(path, content)
    return content


def write_arrays(path: Path, arrays: dict[str, "Array"]) -> None:
    """Write an `.npz`, readable without pickle."""
    import numpy as np  # late, as above

    np.savez(path, allow_pickle=False, **arrays)


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
    """Files beside an index that it lists; none if it is missing or nothing that we wrote."""
    try:
        names = json.loads(index.read_bytes())["files"]
        return {name for name in names if (index.parent / name).is_file() and _is_plain(name)}
    except (OSError, ValueError, LookupError, TypeError):
        return set()


def _is_plain(name: str) -> bool:
    return Path(name).name == name
