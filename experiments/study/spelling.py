"""Wrong names, refused with the nearest ones before anything is imported or compiled."""

from collections.abc import Iterable
from difflib import get_close_matches
from pathlib import Path

from experiments.study.study import WrongInput

_SHOWN = 12


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


def check_file(path: Path) -> None:
    """Refuse what is no file; its neighbours of similar names are shown.

    Raises:
        WrongInput: It is none.
    """
    try:
        if path.is_file():
            return
        beside = [str(each) for each in path.parent.iterdir() if each.suffix == path.suffix]
    except (OSError, ValueError):  # there is no such folder; or it is no path at all
        beside = []
    raise WrongInput(f"there is no file {str(path)!r}{nearest(str(path), beside)}")
