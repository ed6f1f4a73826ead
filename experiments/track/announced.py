"""What `fjh track` is asked to let happen, refused before anything is imported or compiled."""

import re
from collections.abc import Sequence
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple, get_args

from experiments.rig.bounds import check_number
from experiments.rig.choices import Failing
from experiments.rig.events import Event
from experiments.rig.spelling import actuators, check_robot
from experiments.study.spelling import hint
from experiments.study.study import WrongInput

_KINDS = get_args(Failing)
_FAILURE = re.compile(rf"(?P<name>.+):(?P<kind>{'|'.join(_KINDS)})@(?P<time>\d*\.?\d+)")
_EVENT = re.compile(r"(?P<name>[^:@]+)(:(?P<actuator>.+))?@(?P<time>\d*\.?\d+)")


class Announced(NamedTuple):
    """One of them: the name of an actuator, or of what it drives; what happens, and when."""

    actuator: str
    kind: Failing
    time_s: float


def check(
    *,
    model: Path | None,
    fail: Sequence[str],
    event: Sequence[str],
    duration: float,
    turn: float,
    **others: Any,
) -> None:
    """Refuse names that the robot's file does not have, and numbers that cannot be.

    Raises:
        WrongInput: There is one.
    """
    check_number("duration", duration)
    check_number("turn", turn)
    check_robot(model=model, **others)
    names = actuators(model)
    known = [*chain(*names)]
    asked = [("fail", each.actuator) for each in announced(fail, duration)]
    for each in happening(event, duration):
        if isinstance(each.actuator, str):
            asked.append(("event", each.actuator))
    for option, name in asked:
        if names and name not in known:
            said = f'the robot has no actuator or joint "{name}"'
            raise WrongInput(f"--{option} {name}: {said}{hint(name, known)}")


def announced(asked: Sequence[str], duration_s: float) -> list[Announced]:
    """Failures as NAME:KIND@S.

    Raises:
        WrongInput: No such kind, or a time after the end.
    """
    found = []
    for text in asked:
        match = _FAILURE.fullmatch(text)
        if match is None:
            raise WrongInput(
                f"--fail must be NAME:KIND@SECONDS with KIND of {', '.join(_KINDS)}, got {text}"
            )
        time_s = _within(match["time"], duration_s, f"--fail {text}")
        found.append(Announced(match["name"], match["kind"], time_s))  # type: ignore[arg-type]
    return found


def happening(asked: Sequence[str], duration_s: float) -> list[Event]:
    """Events as NAME@S or NAME:ACTUATOR@S.

    Raises:
        WrongInput: No such event, an actuator too few or too many, or a time after the end.
    """
    found = []
    for text in asked:
        match = _EVENT.fullmatch(text)
        if match is None:
            raise WrongInput(f"--event must be NAME@SECONDS or NAME:ACTUATOR@SECONDS, got {text}")
        time_s = _within(match["time"], duration_s, f"--event {text}")
        try:
            found.append(Event(match["name"], time_s, match["actuator"]))
        except ValueError as error:
            raise WrongInput(f"--event {text}: {error}") from None
    return found


def _within(text: str, duration_s: float, option: str) -> float:
    time_s = float(text)
    if not time_s < duration_s:
        raise WrongInput(f"{option}: the run ends at {duration_s:g} s")
    return time_s
