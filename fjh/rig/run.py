"""Run of a robot: its log at every control tick, and the diagnoses of its controller."""

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


HEALTHY: Final = "healthy"
"""State of an actuator that works, or for which no failure is diagnosed."""


@dataclass(frozen=True)
class DiagnosedFailure:
    """Failure of an actuator that a controller diagnosed.

    Attributes:
        actuator: Name of the actuator.
        kind: Diagnosed kind of failure.
        time_s: Time of the diagnosis [s].
        withdrawn_s: Time [s] at which the controller withdrew the diagnosis; None is never.
        acted_s: Time [s] from which the commands account for the diagnosed failure; None is never.
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
        return f"{self.actuator} was identified as {self.kind} at {self.time_s:.3f} s{acted}{back}"


@dataclass(frozen=True)
class Run:
    """Log of a run at every control tick, with the diagnoses of its controller.

    Attributes:
        time_s: Times (N,) [s].
        desired: Desired major displacements (N, m1), [rad] or [m].
        true: True major displacements (N, m1).
        measured: Measured major displacements (N, m1).
        pose: True pose of the task frame at N ticks, relative to the nominal one.
        estimated: Task coordinates (N, 6) that the controller estimates; None if it estimates no
            pose of the task frame.
        inputs: Inputs (N, n) sent to the drives: displacements, or percent of the hexapod's inputs.
        displacement: Displacements (N, n) of the actuators, [rad] or [m].
        qpos: Joint positions (N, nq).
        closure_m: Largest closure residual of the loops (N,) [m].
        saturated: True where an actuator gave its largest force, (N, n).
        failures: Failures that occurred, in order of time, actuators by number.
        state: State of the controller after the last tick.
        diagnoses: Diagnoses of the controller, in order of time.
        task_lost: True if the diagnosis leaves the major task not fully reachable.
        undiagnosed: Reason why the controller diagnosed nothing; None if it diagnosed a failure.
        lost: Sentence if the major task is lost, by errors or diagnosis; else None.
        status: Summary of the run for people: `lost`, then the diagnoses.
        events: Named events that occurred, in order of time.
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
    diagnoses: tuple[DiagnosedFailure, ...]
    task_lost: bool
    undiagnosed: str | None
    status: str
    events: tuple[Event, ...] = ()
    lost: str | None = None

    def __repr__(self) -> str:
        """Return one line: the arrays have thousands of rows."""
        return f"<Run of {len(self.time_s)} ticks to {self.time_s[-1]:g} s. {self.status}>"

    @cached_property
    def task(self) -> Array:
        """True displacement [rotation vector; translation] of the task frame, (N, 6)."""
        return self.pose.displacement()

    @property
    def error(self) -> Array:
        """Desired minus true displacements of the major rows, shape (N, m1), [rad] or [m]."""
        return self.desired - self.true

    def rms(self, ticks: slice = slice(None)) -> Array:
        """Return the RMS error of each major row over a slice of ticks, (m1,), [rad] or [m]."""
        return rms(self.error[ticks])

    @property
    def closure_max_m(self) -> float:
        """Largest closure residual of the run [m]."""
        return float(self.closure_m.max())

    @property
    def arrays(self) -> dict[str, Array]:
        """Arrays of the run by their names in published files."""
        names = ("time_s", "desired", "true", "measured", "task", "inputs", "displacement", "qpos")
        arrays = {name: getattr(self, name) for name in names}
        return arrays | {"closure_residual_m": self.closure_m}


def rms(signal: Array) -> Array:
    """Return the root mean square over time, the first axis."""
    return np.sqrt((signal**2).mean(axis=0))


def tick_of(time_s: float, period_s: float) -> int:
    """Return the first control tick at or after a time since tick 0, to 1e-6 of a tick."""
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
    """Simulate a run with `lead_in` ticks at rest before it; see :meth:`fjh.rig.Rig.fly`."""
    times = np.concatenate([np.full(lead_in, time_s[0]), time_s])
    bench, logged = rig.bench(times, failures, seed, events), slice(lead_in, None)
    demands = rig.feedforward_demands(desired)
    if demands is not None:
        demands = zero_padded(lead_in, demands)
    reference = zero_padded(lead_in, desired)
    machine = bench if on_tick is None else _Counted(bench, on_tick)
    try:
        looped = run_loop(machine, controller, reference, demands, log=_estimate)
    except (ValueError, TypeError, AttributeError):
        if bench.reading_error is None:
            raise
        raise bench.reading_error from None
    return run_of(rig, bench, looped, times, reference, failures, logged)


def run_of(
    rig: "Rig",
    bench: Bench,
    looped: LoopRun[Any],
    time_s: Array,
    desired: Array,
    failures: Sequence[Failure],
    logged: slice,
    since: int = 0,
) -> Run:
    """Return the run in the logs of a machine and its control loop.

    Args:
        rig: The robot.
        bench: Its machine.
        looped: Log of the control loop.
        time_s: Times of all ticks, (N,).
        desired: Desired displacements at all ticks, (N, m1).
        failures: Failures that occurred.
        logged: Ticks of the run.
        since: Tick at which the controller started.
    """
    pose = Pose(bench.rotation[logged], bench.translation_m[logged])
    assert bench.qpos is not None and bench.actuator_force is not None  # rigs log them
    state = looped.state
    diagnoses, true = diagnoses_of(rig, state, time_s[since:]), rig.reached(pose)
    task_lost = isinstance(state, SupervisorState) and state.task_lost
    lost = _lost(rig, time_s[logged], desired[logged] - true, failures, is_diagnosed=task_lost)
    summary = status_of(rig, state, diagnoses)
    return Run(
        time_s=time_s[logged],
        desired=desired[logged],
        true=true,
        measured=looped.measured[logged],
        pose=pose,
        estimated=_estimated(rig, looped.logged[logged]),
        inputs=looped.inputs[logged],
        displacement=bench.displacement[logged],
        qpos=bench.qpos[logged],
        closure_m=bench.closure_residual_m[logged],
        saturated=_saturated(bench.plant.drives, bench.actuator_force[logged]),
        failures=tuple(failures),
        state=state,
        diagnoses=diagnoses,
        task_lost=task_lost,
        undiagnosed=None if diagnoses else _undiagnosed(state, rig.actuators),
        status=summary if lost is None else f"{lost} {summary}",
        lost=lost,
    )


_LOST = 5.0
"""RMS error, in sizes of the path, beyond which the task is lost; a robot at rest has about 1."""


def _lost(
    rig: "Rig", time_s: Array, error: Array, failures: Sequence[Failure], *, is_diagnosed: bool
) -> str | None:
    """Return a sentence if the task is lost, by the error late in the run or by diagnosis."""
    since_s = min((failure.time_s for failure in failures), default=np.inf)
    late = np.abs(error[time_s >= (since_s + time_s[-1]) / 2])
    if late.size and np.sqrt((late**2).sum(axis=1).mean()) > _LOST * rig.size:
        tick, row = np.unravel_index(greatest(late), late.shape)
        unit = rig.row_units[row]
        return (
            f"The major task is lost: its error reaches {1e3 * late[tick, row]:.3g} m{unit} on a "
            f"path of size {1e3 * rig.size:.3g} m{unit}."
        )
    return "The major task is no longer fully reachable." if is_diagnosed else None


def _estimate(state: Any) -> tuple[Array, Array] | None:
    """Return rotation and translation of the task frame in a state, None if it has no pose."""
    pose = getattr(state, "pose", None)
    return (pose.rotation, pose.translation_m) if isinstance(pose, Pose) else None


def _estimated(rig: "Rig", poses: Sequence[tuple[Array, Array] | None]) -> Array | None:
    """Return task coordinates (N, 6) of the estimated poses; None if one is missing."""
    estimates = [pose for pose in poses if pose is not None]
    if not estimates or len(estimates) < len(poses):
        return None
    rotation, translation_m = map(np.array, zip(*estimates, strict=True))
    return rig.coordinates(Pose(rotation, translation_m))


def zero_padded(ticks: int, signal: Array) -> Array:
    """Prepend a number of zero ticks to a signal."""
    return np.concatenate([np.zeros((ticks, *signal.shape[1:])), signal])


def _saturated(drives: Sequence[Drive], force: Array) -> Array:
    """Return where drives saturate, (N, n), from the forces of all outputs of the actuators."""
    at_limit = []
    for drive in drives:
        along, (lower, upper) = force[:, drive.outputs] @ drive.gear, drive.force_range
        at_limit.append((along <= lower) | (along >= upper))
    return np.column_stack(at_limit)


def diagnoses_of(rig: "Rig", state: Any, time_s: Array) -> tuple[DiagnosedFailure, ...]:
    """Return the diagnoses of a controller from its state and the times of its ticks.

    A change of kind counts as a new diagnosis, a confirmation does not.
    """
    if not isinstance(state, SupervisorState):
        return ()
    withdrawn, diagnosed = dict(state.withdrawn), list[DiagnosedFailure]()
    for diagnosis in state.diagnoses:
        failure = DiagnosedFailure(
            rig.actuators[diagnosis.fault.actuator],
            diagnosis.fault.kind,
            float(time_s[diagnosis.tick]),
            float(time_s[withdrawn[diagnosis]]) if diagnosis in withdrawn else None,
            float(time_s[diagnosis.tick]) if diagnosis in state.acted else None,
        )
        last = next((d for d in diagnosed[::-1] if d.actuator == failure.actuator), None)
        if diagnosis.fault.is_healthy:  # returned to service, once a confirmation shows it
            if last is not None and last.withdrawn_s is None and diagnosis.confirmed:
                diagnosed[diagnosed.index(last)] = replace(last, withdrawn_s=failure.time_s)
            continue
        if last is None or last.kind != failure.kind or last.withdrawn_s is not None:
            diagnosed.append(failure)
            continue
        acted_s = failure.acted_s if last.acted_s is None else last.acted_s
        back_s = last.withdrawn_s if failure.withdrawn_s is None else failure.withdrawn_s
        diagnosed[diagnosed.index(last)] = replace(last, withdrawn_s=back_s, acted_s=acted_s)
    return tuple(diagnosed)


def diagnosed_since(rig: "Rig", run: Run, failure: Failure) -> list[DiagnosedFailure]:
    """Return the diagnoses of a failure's actuator since onset."""
    name, since = rig.actuators[failure.number], failure.time_s - 1e-9
    return [d for d in run.diagnoses if d.actuator == name and d.time_s >= since]


def entry_of(rig: "Rig", item: Failure | Event) -> dict[str, Any]:
    """Return the JSON entry of a failure or an event, its actuator by name."""
    actuator = item.actuator
    name = None if actuator is None else rig.actuators[rig.number(actuator)]
    kind = {"kind": item.kind} if isinstance(item, Failure) else {"name": item.name}
    return {"actuator": name, **kind, "time_s": item.time_s}


def failure_text(rig: "Rig", failure: Failure) -> str:
    """Return a failure as text, such as "motor4 locked"."""
    return f"{rig.actuators[failure.number]} {failure.kind}"


def diagnosis_entries(rig: "Rig", run: Run) -> list[dict[str, Any]]:
    """Return the JSON entries of all diagnoses; `delay_s` is None for false alarms."""
    since_s = {
        rig.actuators[int(cause.actuator)]: cause.time_s
        for cause in (*run.events, *run.failures)
        if cause.actuator is not None
    }
    delays_s = [d.time_s - since_s.get(d.actuator, np.inf) for d in run.diagnoses]
    return [
        asdict(diagnosis) | {"delay_s": delay_s if delay_s >= 0 else None}
        for diagnosis, delay_s in zip(run.diagnoses, delays_s, strict=True)
    ]


_UNEXPLAINED = "there was an alarm that no single failure explains"


def _undiagnosed(state: Any, names: Sequence[str]) -> str:
    """Return a clause with the reason why no failure was diagnosed."""
    if not isinstance(state, SupervisorState):
        return "this controller does not diagnose"
    if state.monitor_state.unexplained:
        return _UNEXPLAINED
    if state.monitor_state.alarm_ticks:
        causes = dict.fromkeys(explanation(cause, names) for cause in state.monitor_state.causes)
        return f"there was an alarm, attributed to {' and '.join(causes) or 'no cause yet'}"
    if state.is_learning:
        return f"the diagnosis assumes that nothing fails in the first {LEARNING_S:g} s"
    return "the sensors agree with the prediction of the model without a failure"


def status_of(rig: "Rig", state: Any, diagnosed: Sequence[DiagnosedFailure]) -> str:
    """Return a one-sentence summary of a controller's diagnoses."""
    sensors: Sensors | None = getattr(state, "sensors", None)
    read = ""
    if sensors is not None and sensors.failed:
        read = f"; at the end of the run {sensors.sentence(rig.period_s)}"
    if not isinstance(state, SupervisorState):
        return f"This controller does not diagnose{read}."
    sentence = "; ".join(map(str, diagnosed)) or (
        f"Nothing was diagnosed; {_undiagnosed(state, rig.actuators)}"
    )
    if diagnosed and state.monitor_state.unexplained:
        sentence += f"; {_UNEXPLAINED}"
    return f"{sentence}{read}."


class _Counted:
    """Machine for a control loop that reports the number of completed ticks."""

    def __init__(self, bench: Bench, on_tick: Callable[[int], None]) -> None:
        self.measure, self._bench, self._on_tick, self._done = bench.measure, bench, on_tick, 0

    def apply(self, inputs: Array) -> None:
        """Apply inputs to the machine, and report the tick."""
        self._bench.apply(inputs)
        self._done += 1
        self._on_tick(self._done)
