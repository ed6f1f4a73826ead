"""The failures of a tracked run by number, and when its controller learnt of them."""

from collections.abc import Sequence

from experiments.rig.rig import Rig
from experiments.rig.run import Run, named_since
from experiments.study.study import WrongInput
from experiments.track.announced import Announced
from sim import Failure


def numbered(rig: Rig, failures: Sequence[Announced], shorter: float) -> tuple[Failure, ...]:
    """Of actuators by number, in the order of time; each actuator fails once.

    Raises:
        WrongInput: One fails twice.
    """
    found = [
        Failure(rig.number(each.actuator), each.kind, shorter * each.time_s) for each in failures
    ]
    if len({failure.actuator for failure in found}) < len(found):
        raise WrongInput("--fail must name each actuator once")
    return tuple(sorted(found, key=lambda one: one.time_s))


def learnt_s(rig: Rig, run: Run, failures: Sequence[Failure]) -> list[float | None]:
    """When the controller first named each failed actuator; None is never."""
    return [next((each.time_s for each in named_since(rig, run, one)), None) for one in failures]


def uncompared(rig: Rig, run: Run, failures: Sequence[Failure]) -> str | None:
    """Why no linear model with these failures is held to what the controller did; None: one is."""
    if run.task_lost:
        return "the controller gave the task up"
    named = {each for failure in failures for each in named_since(rig, run, failure)}
    for each in run.diagnoses:
        if each not in named or each.withdrawn_s is not None:
            return f"{each.actuator} was named {each.kind} and had not failed, or was cleared again"
    for failure in failures:
        for last in named_since(rig, run, failure)[-1:]:
            if last.kind != failure.kind:
                return f"{last.actuator} was taken for {last.kind}"
    return None
