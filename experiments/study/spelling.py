"""Wrong names, refused with the nearest ones before anything is imported or compiled."""

from collections.abc import Iterable
from difflib import get_close_matches
from pathlib import Path

from experiments.study.study import WrongInput

_SHOWN = 12


def hint(name: str, known: Iterable[str]) -> str:
    """The nearest known names as a question; without a near one the first of them all."""
    names = list(dict.fromkeys(each for each in known if each))
    if near := get_close_matches(name, names, 3):
        quoted = [f'"{each}"' for each in near]
        return f"did you mean {' or '.join(quoted)}?"
    more = "" if len(names) <= _SHOWN else f" and {len(names) - _SHOWN} more"
    return f"there is {', '.join(names[:_SHOWN])}{more}" if names else "there is none"


def check_file(path: Path) -> None:
    """Refuse what is no file; its neighbours of similar names are shown.

    Raises:
        WrongInput: It is none.
    """
    try:
        if path.is_file():
            return
        beside = [each.name for each in path.parent.iterdir() if each.suffix == path.suffix]
    except (OSError, ValueError):  # there is no such folder; or it is no path at all
        beside = []
    shown = (
        str(path) if len(str(path)) < 200 else f"{str(path)[:200]}... ({len(str(path))} characters)"
    )
    near = f"; {hint(path.name, beside)}" if get_close_matches(path.name, beside, 1) else ""
    raise WrongInput(f"there is no file {shown!r}{near}")
