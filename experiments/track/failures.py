"""The failures that `fjh track` is asked for, and when its controller learnt of them."""

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import get_args

from experiments.rig.hexapod.rig import NAMES
from experiments.rig.rig import Rig
from experiments.rig.run import Named, Run
from experiments.study.study import WrongInput
from sim import Failure, FailureKind
from sim.mjcf.drive import number_of, stated_names

_FAILURE = re.compile(
    rf"(?P<name>.+):(?P<kind>{'|'.join(get_args(FailureKind))})@(?P<time>\d*\.?\d+)"
)


def announced(model: Path | None, asked: Sequence[str], duration_s: float) -> list[Failure]:
    """Failures as NAME:KIND@S, refused by the names in the file before anything is compiled.

    Raises:
        WrongInput: No such name or kind, or a time after the end.
    """
    names = NAMES if model is None else stated_names(model)
    found = []
    for text in asked:
        match = _FAILURE.fullmatch(text)
        if match is None:
            kinds = ", ".join(get_args(FailureKind))
            raise WrongInput(f"--fail must be NAME:KIND@SECONDS with KIND of {kinds}, got {text}")
        if not float(match["time"]) < duration_s:
            raise WrongInput(f"--fail {text}: the run ends at {duration_s:g} s")
        try:
            if names:
                number_of(match["name"], names)
        except ValueError as error:
            raise WrongInput(f"--fail {match['name']}: {error}") from None
        found.append(Failure(match["name"], match["kind"], float(match["time"])))  # type: ignore[arg-type]
    return found


def numbered(rig: Rig, failures: Sequence[Failure], shorter: float) -> tuple[Failure, ...]:
    """Of actuators by number, in the order of time; each actuator fails once.

    Raises:
        WrongInput: One fails twice.
    """
    found = [
        replace(each, actuator=rig.number(each.actuator), time_s=shorter * each.time_s)
        for each in failures
    ]
    if len({failure.actuator for failure in found}) < len(found):
        raise WrongInput("--fail must name each actuator once")
    return tuple(sorted(found, key=lambda one: one.time_s))


def learnt_s(rig: Rig, run: Run, failures: Sequence[Failure]) -> list[float | None]:
    """When the controller first named each failed actuator; None is never."""
    return [next((each.time_s for each in _of(rig, run, one)), None) for one in failures]


def uncompared(rig: Rig, run: Run, failures: Sequence[Failure]) -> str | None:
    """Why no linear model with these failures is held to what the controller did; None: one is."""
    if run.task_lost:
        return "the controller gave the task up"
    named = {each for failure in failures for each in _of(rig, run, failure)}
    for each in run.diagnoses:
        if each not in named or each.withdrawn_s is not None:
            return f"{each.actuator} was named {each.kind} and had not failed, or was cleared again"
    for failure in failures:
        for last in _of(rig, run, failure)[-1:]:
            if last.kind != failure.kind:
                return f"{last.actuator} was taken for {last.kind}"
    return None


def _of(rig: Rig, run: Run, failure: Failure) -> list[Named]:
    """What was named of an actuator since its failure."""
    name = rig.actuators[failure.number]
    since = failure.time_s - 1e-9
    return [each for each in run.diagnoses if each.actuator == name and each.time_s >= since]
