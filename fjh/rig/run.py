"""A run of a robot: what happened at every tick, and what its controller made of it."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from math import ceil
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from argument_checks.ties import greatest
from fjh.rig.events import Event
from ftc import Controller, LoopRun, Sensors, SupervisorState, explanation, run_loop
from ftc.fdi import LEARNING_S, FaultKind
from sim import Array, Bench, Failure, Pose
from sim.mjcf import Drive

if TYPE_CHECKING:
    from fjh.rig.rig import Rig


SOUND: Final = "sound"
"""What an actuator is, or is taken for, that works."""


@dataclass(frozen=True)
class Diagnosed:
    """An actuator that a controller took for failed.

    Attributes:
        actuator: Its name.
        kind: What it was taken for.
        time_s: When.
        withdrawn_s: When the controller took that back; None is never.
        acted_s: From when the commands follow from it; None is never.
    """

    actuator: str
    kind: FaultKind
    time_s: float
    withdrawn_s: float | None
    acted_s: float | None = None

    def __str__(self) -> str:
        later = self.acted_s is not None and self.acted_s > self.time_s
        acted = f", commands changed at {self.acted_s:.3f} s" if later else ""
        back = "" if self.withdrawn_s is None else f" and cleared at {self.withdrawn_s:.3f} s"
        return f"{self.actuator} was named {self.kind} at {self.time_s:.3f} s{acted}{back}"


@dataclass(frozen=True)
class Run:
    """A run: what happened at every control tick.

    Attributes:
        time_s: (N,).
        desired: (N, m1) major displacements, [rad] or [m].
        true: (N, m1).
        measured: (N, m1).
        pose: True pose of the task frame at N ticks, from the nominal one.
        estimated: Task coordinates that the controller takes the pose for, (N, 6); None where it
            estimates no pose of the task frame.
        inputs: (N, n) sent to the drives: displacements, or percent of the hexapod's inputs.
        displacement: (N, n) of the actuators.
        qpos: (N, nq) joint positions.
        closure_m: (N,) largest gap of a closed loop.
        saturated: (N, n) whether the actuators gave their largest force.
        failures: That happened, in the order of time, actuators by number.
        state: Of the controller after the last tick.
        diagnoses: That the controller made, in order.
        task_lost: Whether the controller believes that the major task cannot be done whole any
            more.
        undiagnosed: Why the controller diagnosed nothing; None where it did.
        lost: That the major task is lost, by what happened or as the controller believes, one
            sentence; None where it is not.
        status: What the controller made of the run, one sentence, after that one.
        events: What else happened and has a name, in the order of time.
    """

    time_s: Array
    desired: Array
    true: Array
    measured: Array
    pose: Pose
    estimated: Array | None
    inputs: Array
    displacement: Array
    qpos: Array
    closure_m: Array
    saturated: Array
    failures: tuple[Failure, ...]
    state: Any
    diagnoses: tuple[Diagnosed, ...]
    task_lost: bool
    undiagnosed: str | None
    status: str
    events: tuple[Event, ...] = ()
    lost: str | None = None

    def __repr__(self) -> str:
        """One line; the arrays are thousands."""
        return f"<Run of {len(self.time_s)} ticks to {self.time_s[-1]:g} s. {self.status}>"

    @cached_property
    def task(self) -> Array:
        """True displacement [rotation vector; translation] of the task frame, shape (N, 6)."""
        return self.pose.displacement()

    @property
    def error(self) -> Array:
        """Desired minus true displacements of the major rows, shape (N, m1)."""
        return self.desired - self.true

    def rms(self, ticks: slice = slice(None)) -> Array:
        """RMS error of each major row over some ticks, shape (m1,), [rad] or [m]."""
        return rms(self.error[ticks])

    @property
    def closure_max_m(self) -> float:
        """Largest gap of a closed loop in the whole run, [m]."""
        return float(self.closure_m.max())

    @property
    def arrays(self) -> dict[str, Array]:
        """As they are published."""
        names = ("time_s", "desired", "true", "measured", "task", "inputs", "displacement", "qpos")
        return {name: getattr(self, name) for name in names} | {
            "closure_residual_m": self.closure_m
        }


def rms(signal: Array) -> Array:
    """Root mean square over time, the first axis."""
    return np.sqrt((signal**2).mean(axis=0))


def tick_of(time_s: float, period_s: float) -> int:
    """First control tick at or after a time since tick 0; times are rounded to 1e-6 of a tick."""
    return ceil(time_s / period_s - 1e-6)


def simulate(
    rig: "Rig",
    controller: Controller[Any],
    time_s: Array,
    desired: Array,
    failures: Sequence[Failure],
    *,
    seed: int,
    lead_in: int,
    events: object,
    on_tick: Callable[[int], None] | None,
) -> Run:
    """A run, `lead_in` ticks at rest before it; see :meth:`fjh.rig.Rig.fly`."""
    times = np.concatenate([np.full(lead_in, time_s[0]), time_s])
    bench, kept = rig.bench(times, failures, seed, events), slice(lead_in, None)
    demands = rig.feedforward_demands(desired)
    if demands is not None:
        demands = after_rest(lead_in, demands)
    reference = after_rest(lead_in, desired)
    machine = bench if on_tick is None else _Counted(bench, on_tick)
    try:
        looped = run_loop(machine, controller, reference, demands, log=_estimate)
    except (ValueError, TypeError, AttributeError):
        if bench.gap is None:
            raise
        raise bench.gap from None
    return run_of(rig, bench, looped, times, reference, failures, kept)


def run_of(
    rig: "Rig",
    bench: Bench,
    looped: LoopRun[Any],
    time_s: Array,
    desired: Array,
    failures: Sequence[Failure],
    kept: slice,
    since: int = 0,
) -> Run:
    """What a machine has logged, and a loop beside it, at some ticks.

    Args:
        rig: The robot.
        bench: Its machine.
        looped: What passed between it and its controller.
        time_s: Of all ticks, (N,).
        desired: Likewise, (N, m1).
        failures: That happened.
        kept: Ticks of the run.
        since: The tick at which the controller began.
    """
    pose = Pose(bench.rotation[kept], bench.translation_m[kept])
    assert bench.qpos is not None and bench.actuator_force is not None  # rigs keep them
    state = looped.state
    diagnoses, true = diagnoses_of(rig, state, time_s[since:]), rig.reached(pose)
    task_lost = isinstance(state, SupervisorState) and state.task_lost
    lost = _lost(rig, time_s[kept], desired[kept] - true, failures, believed=task_lost)
    said = status_of(rig, state, diagnoses)
    return Run(
        time_s=time_s[kept],
        desired=desired[kept],
        true=true,
        measured=looped.measured[kept],
        pose=pose,
        estimated=_estimated(rig, looped.logged[kept]),
        inputs=looped.inputs[kept],
        displacement=bench.displacement[kept],
        qpos=bench.qpos[kept],
        closure_m=bench.closure_residual_m[kept],
        saturated=_saturated(bench.plant.drives, bench.actuator_force[kept]),
        failures=tuple(failures),
        state=state,
        diagnoses=diagnoses,
        task_lost=task_lost,
        undiagnosed=None if diagnoses else _undiagnosed(state, rig.actuators),
        status=said if lost is None else f"{lost} {said}",
        lost=lost,
    )


_LOST = 5.0
"""Error in path sizes beyond which a task is lost: to stand still would cost one."""


def _lost(
    rig: "Rig", time_s: Array, error: Array, failures: Sequence[Failure], *, believed: bool
) -> str | None:
    """That the task is lost: in the second half of the time since a failure, or by belief."""
    since_s = min((each.time_s for each in failures), default=np.inf)
    late = np.abs(error[time_s >= (since_s + time_s[-1]) / 2])
    if late.size and np.sqrt((late**2).sum(axis=1).mean()) > _LOST * rig.size:
        tick, row = np.unravel_index(greatest(late), late.shape)
        unit = rig.row_units[row]
        return (
            f"The major task is lost: it ends up to {1e3 * late[tick, row]:.3g} m{unit} off its "
            f"path, whose size is {1e3 * rig.size:.3g} m{unit}."
        )
    return "The major task cannot be done whole any more." if believed else None


def _estimate(state: Any) -> tuple[Array, Array] | None:
    """Rotation and translation of the task frame as a state has them; None where it has none."""
    pose = getattr(state, "pose", None)
    return (pose.rotation, pose.translation_m) if isinstance(pose, Pose) else None


def _estimated(rig: "Rig", poses: Sequence[tuple[Array, Array] | None]) -> Array | None:
    """Task coordinates (N, 6) of estimated poses of the task frame; None where one is missing."""
    known = [each for each in poses if each is not None]
    if not known or len(known) < len(poses):
        return None
    rotation, translation_m = map(np.array, zip(*known, strict=True))
    return rig.coordinates(Pose(rotation, translation_m))


def after_rest(ticks: int, signal: Array) -> Array:
    """A signal that is zero for some ticks before it begins."""
    return np.concatenate([np.zeros((ticks, *signal.shape[1:])), signal])


def _saturated(drives: Sequence[Drive], force: Array) -> Array:
    """Of each drive (N, n), from the forces of all outputs of the actuators."""
    at_limit = []
    for drive in drives:
        along, (lower, upper) = force[:, drive.outputs] @ drive.gear, drive.force_range
        at_limit.append((along <= lower) | (along >= upper))
    return np.column_stack(at_limit)


def diagnoses_of(rig: "Rig", state: Any, time_s: Array) -> tuple[Diagnosed, ...]:
    """What a controller diagnosed, by its state and the times of its ticks.

    Another kind of the same actuator is one of its own, a confirmation none.
    """
    if not isinstance(state, SupervisorState):
        return ()
    withdrawn, named = dict(state.withdrawn), list[Diagnosed]()
    for found in state.diagnoses:
        one = Diagnosed(
            rig.actuators[found.fault.actuator],
            found.fault.kind,
            float(time_s[found.tick]),
            float(time_s[withdrawn[found]]) if found in withdrawn else None,
            float(time_s[found.tick]) if found in state.acted else None,
        )
        last = next((each for each in named[::-1] if each.actuator == one.actuator), None)
        if found.fault.is_healthy:  # it works again, which a confirmation must show
            if last is not None and last.withdrawn_s is None and found.confirmed:
                named[named.index(last)] = replace(last, withdrawn_s=one.time_s)
            continue
        if last is None or last.kind != one.kind or last.withdrawn_s is not None:
            named.append(one)
            continue
        acted_s = one.acted_s if last.acted_s is None else last.acted_s
        back_s = last.withdrawn_s if one.withdrawn_s is None else one.withdrawn_s
        named[named.index(last)] = replace(last, withdrawn_s=back_s, acted_s=acted_s)
    return tuple(named)


def diagnosed_since(rig: "Rig", run: Run, failure: Failure) -> list[Diagnosed]:
    """Diagnoses of an actuator since its failure."""
    name, since = rig.actuators[failure.number], failure.time_s - 1e-9
    return [each for each in run.diagnoses if each.actuator == name and each.time_s >= since]


def entry_of(rig: "Rig", happened: Failure | Event) -> dict[str, Any]:
    """A failure or an event as JSON has it, its actuator by name."""
    actuator = happened.actuator
    name = None if actuator is None else rig.actuators[rig.number(actuator)]
    kind = {"kind": happened.kind} if isinstance(happened, Failure) else {"name": happened.name}
    return {"actuator": name, **kind, "time_s": happened.time_s}


def called(rig: "Rig", failure: Failure) -> str:
    """A failure in words: "motor4 locked"."""
    return f"{rig.actuators[failure.number]} {failure.kind}"


def diagnosis_entries(rig: "Rig", run: Run) -> list[dict[str, Any]]:
    """All diagnoses of a run as JSON has them; of a false alarm `delay_s` is None."""
    since_s = {
        rig.actuators[int(each.actuator)]: each.time_s
        for each in (*run.events, *run.failures)
        if each.actuator is not None
    }
    delays_s = [each.time_s - since_s.get(each.actuator, np.inf) for each in run.diagnoses]
    return [
        asdict(each) | {"delay_s": delay_s if delay_s >= 0 else None}
        for each, delay_s in zip(run.diagnoses, delays_s, strict=True)
    ]


_UNEXPLAINED = "there was an alarm that no single failure explains"


def _undiagnosed(state: Any, names: Sequence[str]) -> str:
    """Why nothing was named."""
    if not isinstance(state, SupervisorState):
        return "this controller does not diagnose"
    if state.monitor_state.unexplained:
        return _UNEXPLAINED
    if state.monitor_state.alarm_ticks:
        causes = dict.fromkeys(explanation(each, names) for each in state.monitor_state.causes)
        return f"there was an alarm, explained by {' and '.join(causes) or 'nothing yet'}"
    if state.is_learning:
        return f"it takes the first {LEARNING_S:g} s for the robot without a failure"
    return "the sensors read what the model without a failure predicts"


def status_of(rig: "Rig", state: Any, named: Sequence[Diagnosed]) -> str:
    """What the controller makes of the run, one sentence."""
    sensors: Sensors | None = getattr(state, "sensors", None)
    read = ""
    if sensors is not None and sensors.failed:
        read = f"; at its end {sensors.sentence(rig.period_s)}"
    if not isinstance(state, SupervisorState):
        return f"This controller does not diagnose{read}."
    found = "; ".join(map(str, named)) or (
        f"Nothing was diagnosed; {_undiagnosed(state, rig.actuators)}"
    )
    if named and state.monitor_state.unexplained:
        found += f"; {_UNEXPLAINED}"
    return f"{found}{read}."


class _Counted:
    """A machine in the loop that tells how many ticks it has done."""

    def __init__(self, bench: Bench, on_tick: Callable[[int], None]) -> None:
        self.measure, self._bench, self._on_tick, self._done = bench.measure, bench, on_tick, 0

    def apply(self, inputs: Array) -> None:
        """As the machine."""
        self._bench.apply(inputs)
        self._done += 1
        self._on_tick(self._done)
