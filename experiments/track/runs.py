"""A run of a robot on its path, what the controller made of it, and what was predicted."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

import numpy as np

from experiments.output.controllers import controller_factory
from experiments.output.study import OnProgress, WrongInput
from experiments.robot.choices import Diagnosing
from experiments.robot.dither import rig_dither
from experiments.robot.hexapod import hexapod_rig
from experiments.robot.mjcf import robot_rig
from experiments.robot.options import RobotOptions, check_positive
from experiments.robot.paths import path_of
from experiments.robot.reach import check_reach
from experiments.robot.rig import Rig
from experiments.track.prediction import Known, predicted_rms
from ftc.fdi.diagnosis import Diagnosis
from ftc.fdi.dither_design import DitherDesign
from ftc.fdi.fault_model import Fault
from ftc.guarded_controller import GuardedController
from ftc.loop import LoopRun, run_loop
from ftc.supervisor import SupervisorState
from ftc.tracking import is_possible
from sim import Array, Bench, Failure, FailureKind, Pose, model_sha256

_FAILURE = re.compile(
    rf"(?P<name>.+):(?P<kind>{'|'.join(get_args(FailureKind))})@(?P<time>\d*\.?\d+)"
)
_SHOWN_EVERY = 100


@dataclass(frozen=True)
class Run:
    """What happened, at every control tick.

    Attributes:
        time_s: (N,).
        desired: (N, m1) major displacements, [rad] or [m].
        true: (N, m1).
        measured: (N, m1).
        task: (N, 6) true displacement [rotation vector; translation] of the task frame.
        inputs: (N, n) sent to the drives: displacements, or percent of the hexapod's inputs.
        displacement: (N, n) of the actuators.
        qpos: (N, nq) joint positions.
        closure_residual_m: (N,).
    """

    time_s: Array
    desired: Array
    true: Array
    measured: Array
    task: Array
    inputs: Array
    displacement: Array
    qpos: Array
    closure_residual_m: Array


@dataclass(frozen=True)
class Other:
    """The same run with somebody else's controller.

    Attributes:
        name: As given to the command.
        run: What happened.
        failure: What it did wrong, in a sentence; None is nothing.
    """

    name: str
    run: Run
    failure: str | None


@dataclass(frozen=True)
class Tracked:
    """Everything that `fjh track` publishes.

    Attributes:
        seed: Of the noise.
        model_sha256: Of the file.
        rig: The robot.
        failures: What happened, in the order of time.
        run: See there.
        diagnoses: That the controller made.
        task_lost: Whether the controller gave the major task up.
        predicted: RMS errors before and after the first failure by the linear model, (m1,) each.
        verdicts: For each number of failures so far, in words, what the classification says.
        possible: Likewise, whether the major task can still be done.
        dither: For the diagnosis; None is none.
        other: With another controller; None where none was given.
    """

    seed: int
    model_sha256: str
    rig: Rig
    failures: tuple[Failure, ...]
    run: Run
    diagnoses: tuple[Diagnosis, ...]
    task_lost: bool
    predicted: tuple[Array, Array]
    verdicts: tuple[str, ...]
    possible: tuple[bool, ...]
    dither: DitherDesign | None = None
    other: Other | None = None


def run_track(
    *,
    seed: int,
    quick: bool,
    on_progress: OnProgress,
    model: Path | None,
    fail: Sequence[str],
    path: str,
    duration: float,
    turn: float,
    diagnosis: Diagnosing,
    dither: str,
    controller: str | None,
    **robot: Any,
) -> Tracked:
    """Track a path, and predict what the failures cost; `robot` is of :class:`RobotOptions`.

    Raises:
        WrongInput: Something that the robot does not have or cannot do.
        sim.ModelError: The file, or what it says.
        sim.SimulationDiverged: The physics left the finite numbers.
    """
    check_positive("duration", duration)
    check_positive("turn", turn)
    if dither != "none" and diagnosis == "off":
        raise WrongInput(f"--dither {dither} is for the diagnosis, which is off")
    options = RobotOptions(**robot)
    rig = hexapod_rig(options.size) if model is None else robot_rig(model, options)
    shorter = 0.5 if quick else 1.0
    time_s = np.arange(max(2, round(shorter * duration / rig.period_s))) * rig.period_s
    failures = tuple(sorted(_failures(rig, fail, shorter, time_s), key=lambda one: one.time_s))
    desired = path_of(path, len(rig.major), rig.size, time_s, turn, rig.period_s)
    check_reach(rig, desired)
    factory = None if controller is None else controller_factory(controller)
    design = rig_dither(rig, dither)
    if design is None and dither != "none":
        raise WrongInput(f"--dither {dither}: the major task leaves no motion for a dither")
    supervisor = rig.supervisor(None if design is None else design.dither)
    pilot: Any = supervisor if diagnosis == "on" else supervisor.first
    runs = 1 if factory is None else 2

    def simulated(steers: Any, before: int) -> tuple[Run, Any]:
        done = before * len(time_s)
        shown = _Shown(rig.bench(time_s, failures, seed), done, runs * len(time_s), on_progress)
        looped = run_loop(shown, steers, desired)
        return _run(rig, time_s, desired, shown.bench, looped), looped.state

    run, state = simulated(pilot, 0)
    other = None
    if factory is not None and controller is not None:
        guarded = GuardedController(controller, factory, rig.task)
        theirs, their_state = simulated(guarded, 1)
        other = Other(controller, theirs, their_state.failure)
    supervised = isinstance(state, SupervisorState)
    faults = [_fault(failure) for failure in failures]
    reports = [rig.classified(faults[:count]) for count in range(len(faults) + 1)]
    return Tracked(
        seed=seed,
        model_sha256=model_sha256(model),
        rig=rig,
        failures=failures,
        run=run,
        diagnoses=state.diagnoses if supervised else (),
        task_lost=supervised and state.task_lost,
        predicted=predicted_rms(rig, desired, _known(rig, failures, told=diagnosis == "on")),
        verdicts=tuple(str(report) for report in reports),
        possible=tuple(is_possible(report) for report in reports),
        dither=design,
        other=other,
    )


def _run(rig: Rig, time_s: Array, desired: Array, bench: Bench, looped: LoopRun[Any]) -> Run:
    task = Pose(bench.rotation, bench.translation_m).displacement()
    assert bench.qpos is not None  # rigs keep it
    return Run(
        time_s=time_s,
        desired=desired,
        true=task[:, list(rig.major)],
        measured=looped.measured,
        task=task,
        inputs=looped.input_percent,
        displacement=bench.displacement,
        qpos=bench.qpos,
        closure_residual_m=bench.closure_residual_m,
    )


class _Shown:
    """A machine in the loop that shows how far the run has come."""

    def __init__(self, bench: Bench, done: int, total: int, on_progress: OnProgress) -> None:
        self.bench, self.measure = bench, bench.measure
        self._done, self._total, self._on_progress = done, total, on_progress

    def apply(self, input_percent: Array) -> None:
        self.bench.apply(input_percent)
        self._done += 1
        if self._done % _SHOWN_EVERY == 0 or self._done == self._total:
            self._on_progress(self._done, self._total)


def _failures(rig: Rig, asked: Sequence[str], shorter: float, time_s: Array) -> list[Failure]:
    """Failures as NAME:KIND@S, within the run; each actuator fails once."""
    found = []
    for text in asked:
        match = _FAILURE.fullmatch(text)
        if match is None:
            kinds = ", ".join(get_args(FailureKind))
            raise WrongInput(f"--fail must be NAME:KIND@SECONDS with KIND of {kinds}, got {text}")
        when_s = shorter * float(match["time"])
        if not when_s < time_s[-1]:
            raise WrongInput(f"--fail {text}: the run ends at {time_s[-1] / shorter:g} s")
        found.append(Failure(rig.actuator(match["name"]), match["kind"], when_s))  # type: ignore[arg-type]
    if len({failure.actuator for failure in found}) < len(found):
        raise WrongInput("--fail must name each actuator once")
    return found


def _fault(failure: Failure) -> Fault:
    """What a failure leaves behind, as the theory and the diagnosis have it."""
    if failure.kind == "weak":
        return Fault(failure.actuator, "weak", failure.effectiveness)
    return Fault(failure.actuator, "locked" if failure.kind == "locked" else "free")


def _known(rig: Rig, failures: Sequence[Failure], *, told: bool) -> list[Known]:
    """The faults, and from when on a mapping knows of them that is told at once, or never."""
    known, goal = [], rig.goal
    for failure in failures:
        fault = _fault(failure)
        goal = rig.told(goal, fault, 0.0) if told else goal
        known.append(Known(fault, math.ceil(failure.time_s / rig.period_s - 1e-6), goal))
    return known
