"""What a supervisor believes, does not understand, and does, in one sentence at each tick."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ftc.fdi.isolation.causes import Cause
    from ftc.supervisor import SupervisorState


def status(state: "SupervisorState", names: Sequence[str] | None = None) -> str:
    """One sentence; actuators are called by these names, or by their numbers."""
    watch, parts = state.watch, [_believed(state, names)]
    if watch.diagnosis is not None and watch.diagnosis.fault.is_sound:
        parts.append(f"{_name(watch.diagnosis.fault.actuator, names)} seems to work again")
    if watch.relearns > 0:
        parts.append("what no failure explains is learned as part of the machine")
    elif watch.evidence is not None and watch.diagnosis is None:
        parts.append("an alarm is looked into")
    elif watch.causes and not state.standing:
        why = explanation(watch.causes[-1], names)
        parts.append(f"the last alarm is explained by {why}, which is no failure")
    if state.task_lost:
        parts.append(
            "the major task is lost, and the controller goes on with what it still reaches"
        )
    elif state.refused is not None and not _is_known(state, state.refused.fault.actuator):
        parts.append("the controller goes on as it was, which is expected to cost less")
    elif state.standing:
        parts.append("the other actuators do the task")
    said = "; ".join(parts)
    if names is not None and state.standing:
        return f"{said}."  # a name stays as it is
    return f"{said[0].upper()}{said[1:]}."


def _is_known(state: "SupervisorState", actuator: int) -> bool:
    """Whether the controller in use already does without an actuator, or with a part of it."""
    goal = state.current.mapping.goal
    return actuator in {*goal.locked_at, *goal.free, *goal.spring_lost, *goal.effectiveness}


def _believed(state: "SupervisorState", names: Sequence[str] | None) -> str:
    believed = []
    for each in state.standing:
        name = _name(each.fault.actuator, names)
        doubt = "" if each.confirmed else ", not yet confirmed"
        believed.append(f"{name} is {' or '.join(each.kinds)}{doubt}")
    return ", ".join(believed) or "all actuators are believed sound"


def explanation(cause: "Cause | None", names: Sequence[str] | None = None) -> str:
    """What an alarm is explained by that is no failure."""
    if cause is None:
        return "something slow"
    if cause.kind == "offset":
        return f"an offset of {_name(cause.actuator, names)}"
    whole = {"supply": "what all commands do", "scale": "the sensors' scale"}
    return f"a change of {whole[cause.kind]}"


def _name(actuator: int, names: Sequence[str] | None) -> str:
    return f"actuator {actuator}" if names is None else names[actuator]
