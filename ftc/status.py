"""What a supervisor believes, does not understand, and does, in one sentence at each tick."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ftc.supervisor import SupervisorState


def status(state: "SupervisorState", names: Sequence[str] | None = None) -> str:
    """One sentence; actuators are called by these names, or by their numbers."""
    watch, parts = state.watch, [_believed(state, names)]
    if watch.relearns > 0:
        parts.append("what no failure explains is learned as part of the machine")
    elif watch.evidence is not None and watch.diagnosis is None:
        parts.append("an alarm is looked into")
    if state.task_lost:
        parts.append(
            "the major task is lost, and the controller goes on with what it still reaches"
        )
    elif state.refused is not None:
        parts.append("the controller goes on as it was, which is expected to cost less")
    elif state.standing:
        parts.append("the other actuators do the task")
    said = "; ".join(parts)
    return f"{said[0].upper()}{said[1:]}."


def _believed(state: "SupervisorState", names: Sequence[str] | None) -> str:
    believed = []
    for each in state.standing:
        number = each.fault.actuator
        name = f"actuator {number}" if names is None else names[number]
        doubt = "" if each.confirmed else ", not yet confirmed"
        believed.append(f"{name} is {' or '.join(each.kinds)}{doubt}")
    return ", ".join(believed) or "all actuators are believed sound"
