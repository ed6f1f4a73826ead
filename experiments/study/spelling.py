"""Wrong names, refused with the nearest ones before anything is imported or compiled."""

from collections.abc import Iterable
from difflib import get_close_matches
from pathlib import Path

from experiments.study.study import WrongInput

_SHOWN = 12
LARGEST_FILE = 1_000_000_000
"""Bytes of a file that is read: a sweep's endless design would fill the memory."""


def nearest(name: str, known: Iterable[str]) -> str:
    """The nearest known names as a question; empty where there is none near."""
    near = get_close_matches(name, dict.fromkeys(known), 3)
    quoted = " or ".join(f'"{each}"' for each in near)
    return f"; did you mean {quoted}?" if near else ""


def hint(name: str, known: Iterable[str]) -> str:
    """The same; without a near one those that there are."""
    names = list(dict.fromkeys(each for each in known if each))
    more = "" if len(names) <= _SHOWN else f" and {len(names) - _SHOWN} more"
    return nearest(name, names) or f"; it has {', '.join(names[:_SHOWN])}{more}"


def index_in(count: int, text: str) -> int | None:
    """The number below `count` that a text is, of however many digits; None where it is none."""
    return next((number for number in range(count) if str(number) == text), None)


def check_file(path: Path) -> None:
    """Refuse what is no file; its neighbours of similar names are shown.

    Raises:
        WrongInput: It is none.
    """
    shown = f"{str(path)!r:.200}"
    try:
        if path.is_file() and path.stat().st_size > LARGEST_FILE:
            raise WrongInput(f"{shown} has more than {LARGEST_FILE / 1e9:g} GB")
        if path.is_file():
            return
        if path.exists():
            raise WrongInput(f"{shown} is no file but a folder, a pipe or a device")
        others = (each for each in path.parent.iterdir() if each != path)
        beside = [str(each) for each in others if each.suffix == path.suffix]
    except (OSError, ValueError):  # there is no such folder; or it is no path at all
        beside = []
    raise WrongInput(f"there is no file {shown}{nearest(str(path), beside)}")
