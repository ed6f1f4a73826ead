"""A run of a robot on its path, what its controller made of it, and what was predicted."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from experiments.rig.dither import not_isolable, rig_dither
from experiments.rig.events import Event
from experiments.rig.events.hooks import events_of
from experiments.rig.mjcf import rig_of
from experiments.rig.options import DITHER, RobotOptions, Switch
from experiments.rig.other_controller import fly_with
from experiments.rig.prediction import Prediction
from experiments.rig.reach import check_reach, learnt_s, uncompared
from experiments.rig.rig import Rig
from experiments.rig.run import Run
from experiments.study.interrupts import notice
from experiments.study.study import OnProgress, WrongInput
from ftc.fdi.dither_design import DitherDesign
from ftc.fdi.fault_model import Fault
from prioritized import Manipulability
from sim import Failure, SimulationDiverged
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
        rig: The robot.
        run: See there; failures and events are in the order of time.
        told: Whether the controller diagnoses failures, and the predicted one is informed of them.
        predicted: RMS errors before and after the first failure, or before the first event, by the
            linear model with the noise that the sensors had, of a controller that is informed at
            once; without a diagnosis of one that never is.
        comparable: The same of a controller that learns of each failure when this one did.
        uncompared: Why that is not what the controller did; None: it is.
        reports: Classification for each number of failures so far.
        advice: For each failure that was never diagnosed, what would tell it apart.
        met: Effects outside the linear model that the run met, a sentence each.
        dither: For the diagnosis; None is none.
        other: With another controller; None where none was given.
        undiagnosed: The same run without a diagnosis; None where nothing happens, where this one
            has none either, and where the physics left the finite numbers.
    """

    seed: int
    rig: Rig
    run: Run
    told: bool
    predicted: Prediction
    comparable: Prediction
    uncompared: str | None
    reports: tuple[Manipulability, ...]
    advice: tuple[str, ...] = ()
    met: tuple[str, ...] = ()
    dither: DitherDesign | None = None
    other: Other | None = None
    undiagnosed: Run | None = None


def run_track(
    *,
    seed: int,
    quick: bool,
    on_progress: OnProgress,
    model: Path | None,
    fail: Sequence[Failure],
    event: Sequence[Event],
    path: str,
    duration: float,
    turn: float,
    diagnosis: Switch,
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
    told, options, scale = diagnosis == "on", RobotOptions(**robot), 0.5 if quick else 1.0
    if not told and dither not in ("none", DITHER.default):
        raise WrongInput(f"--dither {dither} is for the diagnosis, which is off")
    for flag, given in (("--fail", fail), ("--event", event)):
        if late := [each.time_s for each in given if not each.time_s < duration]:
            end = f"before the run ends at {duration:g} s"
            raise WrongInput(f"{flag} must be {end}, got {late[0]:g} s")
    rig = rig_of(model, options)
    desired = rig.path(path, duration_s=scale * duration, turn_s=turn)
    announced, events, failures = _happening(rig, fail, event, scale, seed)
    check_reach(rig, desired)
    for warning in rig.warnings:
        notice(warning)
    design = rig_dither(rig, dither if told else "none")
    if told and design is None and dither not in ("none", DITHER.default):
        raise WrongInput(f"--dither {dither}: the major task leaves no motion for a dither")
    advised = partial(advice, rig, model, options, dither)
    for each in not_isolable(rig, design, desired, failures) if told else ():
        notice(f"{_called(rig, each)} may not be found: {advised(each)}")

    same = {"failures": announced, "seed": seed}
    met = Met(rig.model, rig.part)
    own: Any = rig.supervisor(design and design.dither) if told else rig.controller()
    compares = told and bool(failures or events)
    counted = _counting(on_progress, len(desired), 1 + compares + (controller is not None))
    run = rig.fly(own, desired, events=[*events, met], on_tick=next(counted), **same)
    undiagnosed = other = None
    if compares:
        with suppress(SimulationDiverged):
            how = {"events": events, "on_tick": next(counted)}
            undiagnosed = rig.fly(rig.controller(), desired, **how, **same)
    if controller is not None:
        how = {"events": events, "on_tick": next(counted)}
        other = Other(controller, *fly_with(rig, controller, desired, **how, **same))
    learnt = learnt_s(rig, run, failures)
    predict = _predictor(rig, run, design)
    faults = [Fault.of(failure) for failure in failures]
    return Tracked(
        seed=seed,
        rig=rig,
        run=run,
        told=told,
        predicted=(predicted := predict(told=told)),
        comparable=predict(told=learnt) if failures and not events else predicted,
        uncompared=uncompared(rig, run, failures),
        reports=tuple(rig.classified(faults[:count]) for count in range(len(faults) + 1)),
        advice=tuple(
            f"{_called(rig, failure)} was not diagnosed: {advised(failure)}"
            for failure, learnt_at_s in zip(failures, learnt, strict=True)
            if told and learnt_at_s is None
        ),
        met=tuple(met.sentences),
        dither=design,
        other=other,
        undiagnosed=undiagnosed,
    )


def _counting(on_progress: OnProgress, ticks: int, runs: int) -> Iterator[Callable[[int], None]]:
    """For each of some runs: what is told of its ticks, and shows the progress of all runs."""

    def on_tick(done: int, before: int) -> None:
        if done % _SHOWN_EVERY == 0 or done == ticks:
            on_progress(before * ticks + done, runs * ticks)

    return (partial(on_tick, before=k) for k in range(runs))


def _happening(
    rig: Rig, fail: Sequence[Failure], event: Sequence[Event], scale: float, seed: int
) -> tuple[list[Failure], list[Event], list[Failure]]:
    """Failures by number and events, at so much of their times; and all failures, in their order.

    To all failures belong those that events bring.

    Raises:
        WrongInput: An actuator that the robot does not have, that fails twice, or that cannot have
            an event.
    """
    # A name of digits is looked up before it is taken for a number.
    announced = [
        replace(each, actuator=rig.number(str(each.actuator)), time_s=scale * each.time_s)
        for each in fail
    ]
    in_order = sorted(event, key=lambda one: one.time_s)
    events = [replace(each, time_s=scale * each.time_s) for each in in_order]
    _, caused = events_of(rig, events, seed=seed)
    every = sorted((*announced, *caused), key=lambda one: one.time_s)
    if len({failure.actuator for failure in every}) < len(every):
        raise WrongInput(f"--fail{' and --event' * bool(events)} must name each actuator once")
    return announced, events, every


def _predictor(rig: Rig, run: Run, design: DitherDesign | None) -> Callable[..., Prediction]:
    """Predictions of a run with the noise that its sensors had, samples that are missing without.

    Of a run with events what is predicted ends with the first thing that happens: there a failure
    is put that changes nothing.
    """
    failures: Sequence[Failure] = run.failures
    if run.events:
        first_s = min(each.time_s for each in (*failures, *run.events))
        failures = [Failure(0, "weak", first_s, effectiveness=1.0)]
    noise = np.nan_to_num(run.measured - run.true)
    dither = design and design.dither
    return partial(rig.predict, run.desired, failures=failures, noise=noise, dither=dither)


def advice(
    rig: Rig, model: Path | None, options: RobotOptions, dither: str, failure: Failure
) -> str:
    """Name sensors or a dither that would tell a failure apart, as options of the command."""
    senses = dict.fromkeys([options.sense, *([] if model is None else ["both"])])
    for sense, designed in product(senses, (DITHER.default, "designed")):
        own = sense == options.sense
        if own and designed == dither:
            continue
        with suppress(WrongInput):
            sensing = rig if own else rig_of(model, replace(options, sense=sense))
            design = rig_dither(sensing, designed)
            if design and design.separations.isolates(failure.number, failure.kind):
                added = "" if own else f"--sense {sense} "
                return f"by the linear model {added}--dither {designed} tells it apart"
    return "by the linear model no --sense and no designed --dither tells it apart"


def _called(rig: Rig, failure: Failure) -> str:
    return f"{rig.actuators[failure.number]} {failure.kind}"
