"""A run of a robot on its path, what the controller made of it, and what was predicted."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, get_args

from experiments.rig.choices import Diagnosing
from experiments.rig.dither import option_dither
from experiments.rig.mjcf import robot_rig
from experiments.rig.options import RobotOptions, check_positive
from experiments.rig.other_controller import fly_with
from experiments.rig.prediction import Prediction
from experiments.rig.reach import check_reach
from experiments.rig.rig import Rig
from experiments.rig.run import Run
from experiments.study.controllers import controller_factory
from experiments.study.study import OnProgress, WrongInput
from ftc.fdi.dither_design import DitherDesign
from ftc.fdi.fault_model import Fault
from ftc.tracking import is_possible
from sim import Failure, FailureKind, model_sha256

_FAILURE = re.compile(
    rf"(?P<name>.+):(?P<kind>{'|'.join(get_args(FailureKind))})@(?P<time>\d*\.?\d+)"
)
_SHOWN_EVERY = 100


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
        told: Whether the controller looks for failures, and the predicted one is told of them.
        predicted: RMS errors before and after the first failure by the linear model, with the
            noise that the sensors had.
        comparable: The same of a controller that knew as much as the pilot did: it is never told
            where nothing was diagnosed. None where something was, after some time.
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
    told: bool
    predicted: Prediction
    comparable: Prediction | None
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
    rig = robot_rig(model, options) if model is not None else _hexapod(options)
    shorter = 0.5 if quick else 1.0
    desired = rig.path(path, duration_s=shorter * duration, turn_s=turn)
    failures = _failures(rig, fail, shorter, len(desired))
    check_reach(rig, desired)
    if controller is not None:
        controller_factory(controller)  # a wrong name is refused before anything flies
    design = option_dither(rig, dither)
    if design is None and dither != "none":
        raise WrongInput(f"--dither {dither}: the major task leaves no motion for a dither")
    told = diagnosis == "on"
    pilot: Any = rig.controller() if not told else rig.supervisor(design and design.dither)
    runs = 1 if controller is None else 2

    def options_of(before: int) -> dict[str, Any]:
        def on_tick(done: int) -> None:
            if done % _SHOWN_EVERY == 0 or done == len(desired):
                on_progress(before * len(desired) + done, runs * len(desired))

        return {"failures": failures, "seed": seed, "on_tick": on_tick}

    run, other = rig.fly(pilot, desired, **options_of(0)), None
    if controller is not None:
        other = Other(controller, *fly_with(rig, controller, desired, **options_of(1)))
    faults = [Fault.of(failure) for failure in failures]
    reports = [rig.classified(faults[:count]) for count in range(len(faults) + 1)]
    seen = {"failures": failures, "noise": run.measured - run.true}
    predicted = rig.predict(desired, told=told, **seen)
    comparable = predicted
    if told and failures:
        named = run.diagnoses
        comparable = None if named else rig.predict(desired, told=False, **seen)
    return Tracked(
        seed=seed,
        model_sha256=model_sha256(model),
        rig=rig,
        failures=failures,
        run=run,
        told=told,
        predicted=predicted,
        comparable=comparable,
        verdicts=tuple(str(report) for report in reports),
        possible=tuple(is_possible(report) for report in reports),
        dither=design,
        other=other,
    )


def _hexapod(options: RobotOptions) -> Rig:
    """The hexapod of the testbed, which has its own frame, loops and sensors.

    Raises:
        WrongInput: An option that is for a robot of a file.
    """
    for option in fields(options):
        its_own = option.name not in ("size", "feedforward")
        if its_own and getattr(options, option.name) != option.default:
            name = option.name.replace("_", "-")
            raise WrongInput(f"--{name} needs a MODEL.xml: the hexapod of the testbed has its own")
    return Rig.hexapod(size=options.size, feedforward=options.feedforward == "on")


def _failures(rig: Rig, asked: Sequence[str], shorter: float, ticks: int) -> tuple[Failure, ...]:
    """Failures as NAME:KIND@S, within the run, in the order of time; each actuator fails once."""
    found, last_s = [], (ticks - 1) * rig.period_s
    for text in asked:
        match = _FAILURE.fullmatch(text)
        if match is None:
            kinds = ", ".join(get_args(FailureKind))
            raise WrongInput(f"--fail must be NAME:KIND@SECONDS with KIND of {kinds}, got {text}")
        when_s = shorter * float(match["time"])
        if not when_s < last_s:
            raise WrongInput(f"--fail {text}: the run ends at {last_s / shorter:g} s")
        try:
            number = rig.number(match["name"])
        except WrongInput as error:
            raise WrongInput(f"--fail {match['name']}: {error}") from None
        found.append(Failure(number, match["kind"], when_s))  # type: ignore[arg-type]
    if len({failure.actuator for failure in found}) < len(found):
        raise WrongInput("--fail must name each actuator once")
    return tuple(sorted(found, key=lambda one: one.time_s))
