"""A run of a robot on its path, what the controller made of it, and what was predicted."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from experiments.rig.asked import asked_rig
from experiments.rig.choices import Diagnosing, Sensing
from experiments.rig.dither import option_dither
from experiments.rig.events import Event
from experiments.rig.mjcf import robot_rig
from experiments.rig.options import DITHER, RobotOptions
from experiments.rig.other_controller import fly_with
from experiments.rig.prediction import Prediction
from experiments.rig.reach import check_reach
from experiments.rig.rig import Rig
from experiments.rig.run import Run
from experiments.study.controllers import controller_factory
from experiments.study.interrupts import notice
from experiments.study.study import OnProgress, WrongInput
from experiments.track.advice import Means, advice, not_isolable
from experiments.track.announced import announced, happening
from experiments.track.failures import learnt_s, modelled, numbered, uncompared
from ftc.fdi.dither_design import DitherDesign
from ftc.fdi.fault_model import Fault
from ftc.tracking import deciding_sentence, is_possible
from sim import Failure, SimulationDiverged, model_sha256
from sim.plant.beyond_linear import Met

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
        run: See there; its failures are in the order of time.
        told: Whether the controller looks for failures, and the predicted one is told of them.
        predicted: RMS errors before and after the first failure, or before the first event, by the
            linear model with the noise that the sensors had, of a controller that is informed at
            once; without a diagnosis of one that never is.
        comparable: The same of a controller that learns of each failure when this one did.
        uncompared: Why that is not what the controller did; None: it is.
        verdicts: For each number of failures so far, in words, why the task can be done or not.
        possible: Likewise, whether the major task can still be done.
        advice: For each failure that was never named, what would tell it apart.
        met: Effects outside the linear model that the run met, a sentence each.
        dither: For the diagnosis; None is none.
        other: With another controller; None where none was given.
        events: What else happened, in the order of time, actuators by number.
        undiagnosed: The same run without a diagnosis; None where nothing happens, where this one
            has none either, and where the physics left the finite numbers.
    """

    seed: int
    model_sha256: str
    rig: Rig
    run: Run
    told: bool
    predicted: Prediction
    comparable: Prediction
    uncompared: str | None
    verdicts: tuple[str, ...]
    possible: tuple[bool, ...]
    advice: tuple[str, ...] = ()
    met: tuple[str, ...] = ()
    dither: DitherDesign | None = None
    other: Other | None = None
    events: tuple[Event, ...] = ()
    undiagnosed: Run | None = None


def run_track(
    *,
    seed: int,
    quick: bool,
    on_progress: OnProgress,
    model: Path | None,
    fail: Sequence[str],
    event: Sequence[str],
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
    told = diagnosis == "on"
    if not told:
        if dither not in ("none", DITHER.default):
            raise WrongInput(f"--dither {dither} is for the diagnosis, which is off")
        dither = "none"
    options, shorter = RobotOptions(**robot), 0.5 if quick else 1.0
    given, others = announced(fail, duration), happening(event, duration)
    rig = asked_rig(model, options)
    desired = rig.path(path, duration_s=shorter * duration, turn_s=turn)
    happens = numbered(rig, given, others, shorter, seed)
    failures, events = happens.failures, happens.events
    check_reach(rig, desired)
    for said in rig.warnings:
        notice(said)
    if controller is not None:
        controller_factory(controller)  # a wrong name is refused before anything flies
    design = option_dither(rig, dither)
    if design is None and dither not in ("none", DITHER.default):
        raise WrongInput(f"--dither {dither}: the major task leaves no motion for a dither")
    advised = partial(_advice, rig, model, options, dither)
    if told:
        for each in not_isolable(rig, design, desired, failures):
            notice(f"{_called(rig, each)} may not be found: {advised(each)}")
    pilot: Any = rig.controller() if not told else rig.supervisor(design and design.dither)
    compares = told and bool(failures or events)
    runs = 1 + compares + (controller is not None)

    def options_of(before: int) -> dict[str, Any]:
        def on_tick(done: int) -> None:
            if done % _SHOWN_EVERY == 0 or done == len(desired):
                on_progress(before * len(desired) + done, runs * len(desired))

        return {"failures": happens.asked, "seed": seed, "on_tick": on_tick}

    met = Met(rig.model, rig.part)
    run = rig.fly(pilot, desired, events=[*events, met], **options_of(0))
    other = undiagnosed = None
    if compares:
        with suppress(SimulationDiverged):
            undiagnosed = rig.fly(rig.controller(), desired, events=events, **options_of(1))
    if controller is not None:
        flight = options_of(runs - 1)
        other = Other(controller, *fly_with(rig, controller, desired, events=events, **flight))
    faults = [Fault.of(failure) for failure in failures]
    reports = [rig.classified(faults[:count]) for count in range(len(faults) + 1)]
    learnt = learnt_s(rig, run, failures)
    noise = np.nan_to_num(run.measured - run.true)  # samples may be missing
    seen = {"failures": modelled(failures, events), "noise": noise}
    predict = partial(rig.predict, desired, dither=design and design.dither, **seen)
    predicted = predict(told=told)
    return Tracked(
        seed=seed,
        model_sha256=model_sha256(model),
        rig=rig,
        run=run,
        told=told,
        predicted=predicted,
        comparable=predict(told=learnt) if failures and not events else predicted,
        uncompared=uncompared(rig, run, failures, events),
        verdicts=tuple(deciding_sentence(report) for report in reports),
        possible=tuple(is_possible(report) for report in reports),
        advice=tuple(
            f"{_called(rig, failure)} was not named: {advised(failure)}"
            for failure, known_s in zip(failures, learnt, strict=True)
            if told and known_s is None
        ),
        met=tuple(met.sentences),
        dither=design,
        other=other,
        events=events,
        undiagnosed=undiagnosed,
    )


def _called(rig: Rig, failure: Failure) -> str:
    return f"{rig.actuators[failure.number]} {failure.kind}"


def _advice(
    rig: Rig, model: Path | None, options: RobotOptions, dither: str, failure: Failure
) -> str:
    """What tells a failure apart, which neither the present sensors nor dither did."""

    def sensing(sense: Sensing) -> Rig:
        if model is None or sense == options.sense:
            return rig
        return robot_rig(model, replace(options, sense=sense))

    senses: list[Sensing] = [options.sense]
    if model is not None and options.sense != "both":
        senses.append("both")
    tried = [
        Means(sense, each, partial(sensing, sense))
        for sense in senses
        for each in (DITHER.default, "designed")
    ]
    now = Means(options.sense, dither, lambda: rig)
    return advice(failure, now, [each for each in tried if each[:2] != now[:2]])
