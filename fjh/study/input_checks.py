"""Checks of names and files from users, with suggestions of similar ones."""

from collections.abc import Iterable
from difflib import get_close_matches
from pathlib import Path

from fjh.study.errors import WrongInput

_LISTED = 12
LARGEST_FILE = 1_000_000_000
"""Largest size [bytes] of a file that is read, so that files cannot fill the memory."""


def nearest(name: str, known: Iterable[str], *, listed: bool = False) -> str:
    """Return the known names most similar to `name`, as text that ends an error message.

    If no name is similar, the text lists the known names if `listed`, and is empty otherwise.
    """
    names = list(dict.fromkeys(filter(None, known)))
    if near := get_close_matches(name, names, 3):
        quoted = " or ".join(f'"{match}"' for match in near)
        return f"; did you mean {quoted}?"
    more = "" if len(names) <= _LISTED else f" and {len(names) - _LISTED} more"
    return f"; it has {', '.join(names[:_LISTED]) or 'none'}{more}" if listed else ""


def check_file(path: Path) -> Path:
    """Check that a path is a readable file, and return it; errors suggest similar file names.

    Raises:
        WrongInput: There is no such file, the path is no regular file, or the file is too large.
    """
    quoted = f"{str(path)!r:.200}"
    try:
        if path.is_file() and path.stat().st_size > LARGEST_FILE:
            raise WrongInput(f"{quoted} has more than {LARGEST_FILE / 1e9:g} GB")
        if path.is_file():
            return path
        if path.exists():
            raise WrongInput(f"{quoted} is no file but a folder, a pipe or a device")
        if path.is_symlink():
            raise WrongInput(f"{quoted} is a symbolic link that leads to no file")
        others = (file for file in path.parent.iterdir() if file != path and file.is_file())
        neighbours = [str(file) for file in others if file.suffix == path.suffix]
    except (OSError, ValueError):  # there is no such folder, or the path is invalid
        neighbours = []
    raise WrongInput(f"there is no file {quoted}{nearest(str(path), neighbours)}")


def short(value: object) -> str:
    """Return a value as text of at most 80 characters on one line, for error messages.

    Same text as `argument_checks.short_repr`, without the slow import of NumPy.
    """
    return " ".join(repr(value).split())[:80]
