"""The failures that `fjh track` is asked for, refused before anything is imported or compiled."""

import re
from collections.abc import Sequence
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple, get_args

from experiments.rig.choices import Failing
from experiments.rig.options import check_positive
from experiments.rig.spelling import actuators, check_robot
from experiments.study.spelling import hint
from experiments.study.study import WrongInput

_KINDS = get_args(Failing)
_FAILURE = re.compile(rf"(?P<name>.+):(?P<kind>{'|'.join(_KINDS)})@(?P<time>\d*\.?\d+)")


class Announced(NamedTuple):
    """One of them: the name of an actuator, or of what it drives; what happens, and when."""

    actuator: str
    kind: Failing
    time_s: float


def check(*, model: Path | None, fail: Sequence[str], duration: float, **others: Any) -> None:
    """Refuse names that the robot's file does not have, and numbers that cannot be.

    Raises:
        WrongInput: There is one.
    """
    check_positive("duration", duration)
    check_robot(model=model, **others)
    names = actuators(model)
    known = [*chain(*names)]
    for each in announced(fail, duration):
        if names and each.actuator not in known:
            said = f'the robot has no actuator or joint "{each.actuator}"'
            raise WrongInput(f"--fail {each.actuator}: {said}{hint(each.actuator, known)}")


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
        if not float(match["time"]) < duration_s:
            raise WrongInput(f"--fail {text}: the run ends at {duration_s:g} s")
        found.append(Announced(match["name"], match["kind"], float(match["time"])))  # type: ignore[arg-type]
    return found
