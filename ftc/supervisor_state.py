"""State of a supervisor, and one sentence of what it believes, does not understand, and does."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from argument_checks import Array
from ftc.controller import PrioritizedController
from ftc.fdi.bank import Cause
from ftc.fdi.diagnosis import Diagnosis
from ftc.fdi.monitor import Monitor, MonitorState
from ftc.fdi.observer import LEARNING_S
from ftc.oracle import NestedState
from ftc.sensors import Sensors


@dataclass(frozen=True)
class SupervisorState(NestedState):
    """State of the supervisor.

    Attributes:
        current: The controller in use; `controller` is its state.
        watch: State of the monitor.
        monitor: That monitor.
        sensors: What they read so far, and whether it was usable.
        confirmed: The confirmed diagnoses.
        diagnoses: All that were made, revised and withdrawn ones included, in order.
        task_lost: Whether the actuators that are left by confirmed diagnoses cannot do the major
            task; the controller then goes on as it was, with what it still reaches.
        withdrawn: Diagnoses that were taken back, and when.
        acted: Diagnoses from which the controller in use changed.
        references: Of the major task of late, one for each sample of the diagnosis, newest first.
        feedforward: Demands beside the compensators, likewise; empty: none were given.
        refused: The last diagnosis that was not acted on: doing nothing was expected to cost less.
    """

    current: PrioritizedController[Any]
    watch: MonitorState
    monitor: Monitor
    sensors: Sensors
    confirmed: tuple[Diagnosis, ...] = ()
    diagnoses: tuple[Diagnosis, ...] = ()
    task_lost: bool = False
    withdrawn: tuple[tuple[Diagnosis, int], ...] = ()
    acted: tuple[Diagnosis, ...] = ()
    references: tuple[Array, ...] = ()
    feedforward: tuple[Array, ...] = ()
    refused: Diagnosis | None = None

    @property
    def status(self) -> str:
        """What is believed, not understood and done, in one sentence.

        Actuators are called by the names that the monitor's model has, or by their numbers.
        """
        watch, names = self.watch, self.monitor.nominal.names
        parts = [", ".join(map(self._named, self.standing)) or "all actuators are believed sound"]
        if watch.diagnosis is not None and watch.diagnosis.fault.is_sound:
            parts.append(f"{_name(watch.diagnosis.fault.actuator, names)} seems to work again")
        if watch.relearns > 0:
            parts.append("what no failure explains is learned as part of the machine")
        elif watch.evidence is not None and watch.diagnosis is None:
            parts.append("an alarm is looked into")
        elif watch.causes and not self.standing:
            why = explanation(watch.causes[-1], names)
            parts.append(f"the last alarm is explained by {why}, which is no failure")
        known = self.current.mapping.goal.failed
        if self.task_lost:
            parts.append(
                "the major task is lost, and the controller goes on with what it still reaches"
            )
        elif self.refused is not None and self.refused.fault.actuator not in known:
            parts.append("the controller goes on as it was, which is expected to cost less")
        elif self.standing:
            parts.append("the other actuators do the task")
        said = "; ".join(parts)
        if names is None or not self.standing:  # a name stays as it is
            said = said[0].upper() + said[1:]
        return f"{said}."

    def _named(self, found: Diagnosis) -> str:
        name = _name(found.fault.actuator, self.monitor.nominal.names)
        doubt = "" if found.confirmed else ", not yet confirmed"
        return f"{name} is {' or '.join(found.kinds)}{doubt}"

    def __repr__(self) -> str:
        """One line, for interactive use."""
        return f"<SupervisorState after {self.ticks} ticks. {self.status}>"

    @property
    def is_learning(self) -> bool:
        """Whether what the sensors read is still taken for the machine without a failure."""
        learned_s = self.watch.observer.spectrum.samples * self.monitor.observer.period_s
        return learned_s <= LEARNING_S

    @property
    def standing(self) -> list[Diagnosis]:
        """The last diagnosis confirmed of each actuator, and the one being confirmed.

        Without those that work again, once that is confirmed: one that comes and goes stays out.
        """
        latest, found = self.confirmed, self.watch.diagnosis
        if found is not None and found.is_acted_on:
            latest = (*latest, found)
        last = {each.fault.actuator: each for each in latest}
        return [each for each in last.values() if not each.fault.is_sound]


def explanation(cause: Cause | None, names: Sequence[str] | None = None) -> str:
    """What an alarm is explained by that is no failure."""
    if cause is None:
        return "something slow"
    if cause.kind == "offset":
        return f"an offset of {_name(cause.actuator, names)}"
    whole = {"supply": "what all commands do", "scale": "the sensors' scale"}
    return f"a change of {whole[cause.kind]}"


def _name(actuator: int, names: Sequence[str] | None) -> str:
    return f"actuator {actuator}" if names is None else names[actuator]
