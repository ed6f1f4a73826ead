"""Flights of any robot in which anything happens, on the workers there are."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from experiments.recover.mechanism_event_row import SCHEMA, row_of
from experiments.recover.mechanism_flight import MechanismFlight
from experiments.recover.mechanisms import SOURCES
from experiments.rig.dither import rig_dither
from experiments.rig.events import EVENTS, Event
from experiments.rig.mjcf import robot_rig
from experiments.rig.options import RobotOptions
from experiments.rig.reach import check_reach
from experiments.rig.rig import Rig
from experiments.study.campaign import Campaign
from experiments.study.resumable import Complete, complete
from experiments.study.study import OnProgress
from ftc.fdi.dither_design import DitherDesign
from sim import model_sha256

EACH, QUICK = 2, ("locked", "sag", "bias")
"""Flights of each event; with --quick one of each of these."""

AFTER_S = 1.5
"""Of a flight, from its event on."""

_EARLIEST_S, _LATEST_S, _STREAM = 1.0, 2.0, 8

_SOURCES = replace(
    SOURCES,
    files=(
        *SOURCES.files,
        *(f"experiments/recover/{name}.py" for name in ("event_row", "mechanism_event*")),
    ),
)


@dataclass(frozen=True)
class MechanismEvents:
    """Everything that `fjh recover --model --events` publishes.

    Attributes:
        done: The flights; their rows are on disk.
        model_sha256: Of the file.
        rig: The robot, with the exact model as its plant.
        dither: In which failures are looked for; None is none.
    """

    done: Complete[tuple[MechanismFlight, ...]]
    model_sha256: str
    rig: Rig
    dither: DitherDesign | None


@contextmanager
def run_mechanism_events(
    *,
    seed: int,
    quick: bool,
    model: Path,
    turn: float,
    dither: str,
    folder: Path,
    workers: int | None,
    resume: bool | None,
    on_progress: OnProgress,
    **robot: Any,
) -> Iterator[MechanismEvents | dict[str, Any]]:
    """Fly a robot in all events; arguments and errors as of `mechanisms.run_mechanisms`."""
    options, file = RobotOptions(**robot), model.resolve()
    rig = robot_rig(file, options)
    design = rig_dither(rig, dither)
    first = MechanismFlight(
        number=0,
        model=file,
        options=options,
        dither=None if design is None else design.dither,
        failure=None,
        isolable=False,
        turn_s=turn,
        duration_s=0.0,
        seed=seed,
    )
    flights = drawn(first, QUICK if quick else tuple(EVENTS), 1 if quick else EACH, rig)
    for flight in flights[: 1 if quick else EACH]:  # those of one draw have the same path
        check_reach(rig, flight.path(rig))
    drawn_from = {
        "seed": seed,
        "events": [1 if quick else EACH, *(flight.events[0].name for flight in flights)],
        "robot": asdict(options),
        "robot_sha256": model_sha256(file),
        "turn_s": turn,
        "dither": dither,
    }
    campaign = Campaign(flights, row_of, SCHEMA, _SOURCES, drawn_from)
    how: dict[str, Any] = {"scheduler": None, "workers": workers, "resume": resume}
    with complete("recover", campaign, folder=folder, on_progress=on_progress, **how) as done:
        if isinstance(done, Complete):
            yield MechanismEvents(done, drawn_from["robot_sha256"], rig, design)
        else:
            yield done


def drawn(
    first: MechanismFlight, names: tuple[str, ...], each: int, rig: Rig
) -> tuple[MechanismFlight, ...]:
    """Flights of each event; those of one draw differ in what happens, and to which actuator.

    `first` has the seed of all that is drawn, and what all flights have in common.
    """
    flights: list[MechanismFlight] = []
    for place, name in enumerate(names):
        for draw in range(each):
            rng = np.random.default_rng([first.seed, _STREAM, draw])
            time_s = round(float(rng.uniform(_EARLIEST_S, _LATEST_S)), 3)
            own_seed, begin = (int(number) for number in rng.integers(2**32, size=2))
            actuator = None
            if EVENTS[name].of == "actuator":
                actuator = (begin + place + draw) % len(rig.actuators)
            flight = replace(
                first,
                number=len(flights),
                duration_s=round(time_s + AFTER_S, 3),
                seed=own_seed,
                events=(Event(name, time_s, actuator),),
            )
            flights.append(flight)
    return tuple(flights)
