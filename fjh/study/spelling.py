"""Wrong names, refused with the nearest ones."""

from collections.abc import Iterable
from difflib import get_close_matches
from pathlib import Path

from fjh.study.errors import WrongInput

_LISTED = 12
LARGEST_FILE = 1_000_000_000
"""Bytes of a file that is read: a sweep's endless design would fill the memory."""


def nearest(name: str, known: Iterable[str], *, listed: bool = False) -> str:
    """The nearest known names as a question, to end a sentence.

    Where none is near it is empty; or a list of those that there are, if they shall be listed.
    """
    names = list(dict.fromkeys(each for each in known if each))
    if near := get_close_matches(name, names, 3):
        quoted = " or ".join(f'"{each}"' for each in near)
        return f"; did you mean {quoted}?"
    more = "" if len(names) <= _LISTED else f" and {len(names) - _LISTED} more"
    return f"; it has {', '.join(names[:_LISTED]) or 'none'}{more}" if listed else ""


def check_file(path: Path) -> Path:
    """The path, if a file is there to be read; its neighbours of similar names are shown.

    Raises:
        WrongInput: There is none, or another thing, or it is too large.
    """
    shown = f"{str(path)!r:.200}"
    try:
        if path.is_file() and path.stat().st_size > LARGEST_FILE:
            raise WrongInput(f"{shown} has more than {LARGEST_FILE / 1e9:g} GB")
        if path.is_file():
            return path
        if path.exists():
            raise WrongInput(f"{shown} is no file but a folder, a pipe or a device")
        if path.is_symlink():
            raise WrongInput(f"{shown} is a symbolic link that leads to no file")
        others = (each for each in path.parent.iterdir() if each != path and each.is_file())
        beside = [str(each) for each in others if each.suffix == path.suffix]
    except (OSError, ValueError):  # there is no such folder; or it is no path at all
        beside = []
    raise WrongInput(f"there is no file {shown}{nearest(str(path), beside)}")


def short(value: object) -> str:
    """A value that came, on one line of 80 characters at most, for the message that refuses it.

    As `argument_checks.shown` does, without numpy, which a help text does not wait for.
    """
    return " ".join(repr(value).split())[:80]
