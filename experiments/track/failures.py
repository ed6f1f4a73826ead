"""What happens in a tracked run, by number, and when its controller learnt of failures."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from experiments.rig.events import Event
from experiments.rig.events.hooks import events_of
from experiments.rig.rig import Rig
from experiments.rig.run import Run, diagnosed_since
from experiments.study.study import WrongInput
from experiments.track.announced import Announced
from sim import Failure


class Happening(NamedTuple):
    """What happens in a run.

    Attributes:
        asked: Failures that were asked for as such.
        events: What else, in the order of time, actuators by number.
        failures: All in the order of time, those that belong to events included.
    """

    asked: tuple[Failure, ...]
    events: tuple[Event, ...]
    failures: tuple[Failure, ...]


def numbered(
    rig: Rig, failures: Sequence[Announced], events: Sequence[Event], shorter: float, seed: int
) -> Happening:
    """Of actuators by number; each actuator fails once.

    Raises:
        WrongInput: One fails twice, or cannot have an event.
    """
    asked = [
        Failure(rig.number(each.actuator), each.kind, shorter * each.time_s) for each in failures
    ]
    others = [
        replace(
            each,
            time_s=shorter * each.time_s,
            actuator=None if each.actuator is None else rig.number(each.actuator),
        )
        for each in sorted(events, key=lambda one: one.time_s)
    ]
    _, caused = events_of(rig, others, seed=seed)
    every = sorted((*asked, *caused), key=lambda one: one.time_s)
    if len({failure.actuator for failure in every}) < len(every):
        raise WrongInput(f"--fail{' and --event' * bool(events)} must name each actuator once")
    return Happening(tuple(asked), tuple(others), tuple(every))


def modelled(failures: Sequence[Failure], events: Sequence[Event]) -> Sequence[Failure]:
    """The failures of a linear model of the run, which holds until the first event.

    What is compared ends with the first thing that happens: there a failure is put that changes
    nothing.
    """
    if not events:
        return failures
    first_s = min(each.time_s for each in (*failures, *events))
    return [Failure(0, "weak", first_s, effectiveness=1.0)]


def learnt_s(rig: Rig, run: Run, failures: Sequence[Failure]) -> list[float | None]:
    """When the controller first named each failed actuator; None is never."""
    return [
        next((each.time_s for each in diagnosed_since(rig, run, one)), None) for one in failures
    ]


def uncompared(
    rig: Rig, run: Run, failures: Sequence[Failure], events: Sequence[Event] = ()
) -> str | None:
    """Why no linear model with these failures is held to what the controller did; None: one is."""
    if events:
        return f"it does not have {', '.join(dict.fromkeys(each.name for each in events))}"
    if run.task_lost:
        return "the controller gave the task up"
    if run.lost is not None:
        return "the task is lost"
    for each in failures:
        if each.kind == "locked" and each.number in rig.soft_locks:
            return f"the lock of {rig.actuators[each.number]} gives way"
    named = {each for failure in failures for each in diagnosed_since(rig, run, failure)}
    for each in run.diagnoses:
        if each not in named or each.withdrawn_s is not None:
            return f"{each.actuator} was named {each.kind} and had not failed, or was cleared again"
    for failure in failures:
        for last in diagnosed_since(rig, run, failure)[-1:]:
            if last.kind != failure.kind:
                return f"{last.actuator} was taken for {last.kind}"
    return None
