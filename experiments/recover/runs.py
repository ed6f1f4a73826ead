"""The study: flights as rows, and what is computed beside them with the exact model."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import chain, islice
from typing import Any

from experiments.recover import exact_flights, predictions
from experiments.recover.campaign import flights_of
from experiments.recover.exact_flights import INFORMED_LATE
from experiments.recover.flight import Flight, exact_rig
from experiments.recover.plan import QUICK, FlightPlan, for_hours
from experiments.recover.predictions import FREQUENCIES_HZ, SETTINGS
from experiments.recover.recovery import BEFORE_S, Identification, supervised
from experiments.recover.row import flown_with, other_columns
from experiments.rig.hexapod.metrics import plant_constants
from experiments.rig.hexapod.simulation import Trajectory, trajectory
from experiments.study.campaign import Row
from experiments.study.controllers import controller_factory
from experiments.study.parallel import in_parallel
from experiments.study.resumable import Complete, complete
from experiments.study.study import Interrupted, OnProgress
from sim import Failure, load_model

SHOWN = {
    "locked": (Failure(0, "locked", 8.25),),
    "free": (Failure(0, "free", 8.25),),
    "cascade": (
        Failure(0, "locked", 4.0),
        Failure(3, "free", 6.0),
        Failure(1, "locked", 8.0),
        Failure(4, "locked", 10.0),
    ),
}
"""Failures of the runs that are kept whole, by name. The cascade leaves struts 3 and 6 in the end,
which pull in one direction of the (alpha, beta) plane."""

_LEFT_S = 2.0

SIZE: dict[str, tuple[Any, Any]] = {
    "fault_free_s": (16.0, 1.0),
    "settings": (4, 1),
    "struts": (6, 1),
    "informed": (3, 0),
    "shown": (3, 1),
    "dither_designs": (1, 0),
}
"""How much of what is beside the flights in the whole study, and with --quick."""


@dataclass(frozen=True)
class Recover:
    """All of it; what are dictionaries here are entries of the JSON file.

    Attributes:
        done: The flights; their rows are on disk.
        lookalikes: Distances between failures in the linear model.
        beliefs: Of pairs of true and diagnosed fault.
        informed: Flights of controllers that are informed late or wrongly.
        dither_design: Distances by direction, frequency and amplitude of the dither.
        dither_cost: What the dither costs without failures.
        shown: Whole runs, by name.
        plant: Constants of the plant.
        controller: Another one, package.module:factory.
        others: Its columns of the flights that it is compared in.
        compared: Whole runs with it, by name, each with a sentence if it failed.
    """

    done: Complete[FlightPlan]
    lookalikes: list[dict[str, Any]]
    beliefs: list[dict[str, Any]]
    informed: list[dict[str, Any]]
    dither_design: list[dict[str, Any]]
    dither_cost: dict[str, Any]
    shown: dict[str, tuple[Trajectory, Identification]]
    plant: dict[str, Any]
    controller: str | None = None
    others: list[Row] = field(default_factory=list)
    compared: dict[str, tuple[Trajectory, str | None]] = field(default_factory=dict)


@contextmanager
def run_recover(
    *,
    seed: int,
    quick: bool,
    hours: float,
    controller: str | None,
    on_progress: OnProgress,
    **options: Any,
) -> Iterator[Recover | dict[str, Any]]:
    """Everything, on the workers there are; further options as of :func:`complete`.

    Flights are kept as they finish. What is beside them takes minutes, and is done again by a
    command that goes on.

    Args:
        seed: Of all that is drawn, and of all noise.
        quick: A small set.
        hours: Flown without failures, unless `quick`.
        controller: Another one, to be compared in the same flights.
        on_progress: Called with finished and total number of flights and other jobs.
        options: As of :func:`complete`.

    Raises:
        WrongInput: There is no such controller; or as :func:`complete`.
    """
    if controller is not None:
        controller_factory(controller)  # a wrong name is refused before anything runs
    plan = FlightPlan(QUICK if quick else for_hours(hours), seed, controller)
    jobs = _jobs(plan, quick)
    flights, total = len(plan), len(plan) + sum(len(calls) for _, calls in jobs.values())

    def progress(done: int, _total: int) -> None:
        on_progress(done, total)

    with complete("recover", flights_of(plan), on_progress=progress, **options) as done:
        if not isinstance(done, Complete):
            yield done
            return
        try:
            beside = _by_name(jobs, lambda k, _: on_progress(flights + k, total))
        except KeyboardInterrupt:
            raise Interrupted(
                f"interrupted: all {flights} runs are kept; --resume continues"
            ) from None
        yield Recover(
            done=done,
            lookalikes=list(chain(*beside["lookalikes"])),
            beliefs=beside["beliefs"][0],
            informed=list(chain(*beside["informed"])),
            dither_design=list(chain(*beside["dither_design"])),
            dither_cost=beside["dither_cost"][0],
            shown=dict(zip(SHOWN, beside["shown"], strict=False)),
            plant=plant_constants(load_model()),
            controller=controller,
            others=beside["others"],
            compared=dict(zip(SHOWN, beside["compared"], strict=False)),
        )


def shown_flight(failures: tuple[Failure, ...], begin_s: float, seed: int) -> Flight:
    """From a time on the spiral to two seconds after the last failure, with all mismatches."""
    return Flight(
        number=0,
        sort="pair",
        draw=0,
        mismatch="all",
        factor=1.0,
        plant_seed=seed,
        failures=failures,
        begin_s=begin_s,
        duration_s=failures[-1].time_s + _LEFT_S - begin_s,
        posture_m=(0.0,) * 6,
        seed=seed,
    )


def _shown(flight: Flight) -> tuple[Trajectory, Identification]:
    run, found = supervised(flight.rig(), flight)
    return trajectory(run), found


def _compared(flight: Flight, controller: str) -> tuple[Trajectory, str | None]:
    run, failed = flown_with(flight, controller)
    return trajectory(run), failed


def _exactly(job: Callable[..., Any], *arguments: Any) -> Any:
    """A function of the exact rig, which every process makes once."""
    return job(exact_rig(), *arguments)


Jobs = tuple[Callable[..., Any], list[tuple[Any, ...]]]
"""A function, and its arguments, a tuple for each call."""


def _jobs(plan: FlightPlan, quick: bool) -> dict[str, Jobs]:
    """Independent jobs, by what they are for."""
    size = {name: both[quick] for name, both in SIZE.items()}
    failing = list(SHOWN.values())[: size["shown"]]
    begin_s = [each[0].time_s - BEFORE_S if quick else 0.0 for each in failing]
    shown = [shown_flight(*each, plan.seed) for each in zip(failing, begin_s, strict=True)]
    struts, settings = range(size["struts"]), SETTINGS[: size["settings"]]
    names = [] if plan.controller is None else [plan.controller]
    late, cost = exact_flights.informed_late_or_wrongly, exact_flights.dither_cost
    design = predictions.dither_design, struts[:3], FREQUENCIES_HZ
    return {
        "shown": (_shown, [(flight,) for flight in shown]),
        "compared": (_compared, [(flight, name) for name in names for flight in shown]),
        "others": (other_columns, [(each, name) for name in names for each in plan.compared()]),
        "dither_design": (_exactly, [design] * size["dither_designs"]),
        "lookalikes": (_exactly, [(predictions.lookalikes, each, struts) for each in settings]),
        "informed": (_exactly, [(late, each) for each in INFORMED_LATE[: size["informed"]]]),
        "dither_cost": (_exactly, [(cost, plan[0], size["fault_free_s"])]),
        "beliefs": (_exactly, [(predictions.beliefs, struts)]),
    }


def _by_name(jobs: dict[str, Jobs], on_progress: OnProgress) -> dict[str, list[Any]]:
    """Results of all calls, in parallel, by the names of the jobs."""
    calls = [
        {"job": job, "arguments": arguments}
        for job, all_arguments in jobs.values()
        for arguments in all_arguments
    ]
    results = iter(in_parallel(_run, calls, on_progress))
    return {name: list(islice(results, len(calls))) for name, (_, calls) in jobs.items()}


def _run(job: Callable[..., Any], arguments: tuple[Any, ...]) -> Any:
    return job(*arguments)
