"""Flights of any robot: each actuator fails in each way, seen by each of three sensings."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, get_args

import numpy as np

from experiments.output.parallel import in_parallel
from experiments.output.study import OnProgress
from experiments.recover.mechanism_flight import (
    LEFT_S,
    MechanismFlight,
    MechanismFlown,
    fly,
    recovered_s,
)
from experiments.robot.choices import Sensing
from experiments.robot.dither import rig_dither
from experiments.robot.mjcf import robot_rig
from experiments.robot.options import RobotOptions, check_positive
from experiments.robot.reach import check_reach
from experiments.robot.rig import Rig
from ftc.fdi.dither_design import DitherDesign
from ftc.fdi.fault_model import KINDS, FaultKind
from sim import Failure, model_sha256

SENSINGS: tuple[Sensing, ...] = get_args(Sensing)

_EARLIEST_S, _LATEST_S = 1.5, 3.5
_EFFECTIVENESS = 0.2, 0.8
_SOUND_S, _SOUND = 6.0, 3
"""Flights without failures for each sensing: how long, and how many."""


@dataclass(frozen=True)
class Sensed:
    """A robot as one of the sensings has it.

    Attributes:
        rig: With the exact model as its plant.
        dither: In which failures are looked for; None is none.
        flown: What became of its flights.
    """

    rig: Rig
    dither: DitherDesign | None
    flown: tuple[MechanismFlown, ...]


@dataclass(frozen=True)
class Mechanisms:
    """Everything that `fjh recover --model` publishes.

    Attributes:
        seed: Of all that is drawn.
        model_sha256: Of the file.
        sensed: By sensing.
    """

    seed: int
    model_sha256: str
    sensed: dict[Sensing, Sensed]


def run_mechanisms(
    *,
    seed: int,
    quick: bool,
    on_progress: OnProgress,
    model: Path,
    turn: float,
    dither: str,
    **robot: Any,
) -> Mechanisms:
    """Fly a robot whose actuators fail, on all cores.

    Args:
        seed: Of all that is drawn.
        quick: One lock, seen by both sensors.
        on_progress: Called with finished and total number of flights.
        model: MJCF file.
        turn: Time of one turn of the circle, in seconds.
        dither: As of :func:`experiments.robot.dither.rig_dither`.
        robot: Of :class:`experiments.robot.options.RobotOptions`, but for `sense`.

    Raises:
        WrongInput: Something that the robot does not have or cannot do.
        sim.ModelError: The file, or what it says.
        sim.SimulationDiverged: The physics left the finite numbers.
    """
    check_positive("turn", turn)
    options = RobotOptions(**robot)
    rigs, designs, flights = {}, {}, []
    for sense in ("both",) if quick else SENSINGS:
        chosen = replace(options, sense=sense)
        rigs[sense] = rig = robot_rig(model, chosen)
        designs[sense] = design = rig_dither(rig, dither)
        driven = None if design is None else design.dither
        for failure, duration_s, number in _drawn(rig, seed, quick):
            flight = MechanismFlight(model, chosen, driven, failure, turn, duration_s, number)
            check_reach(rig, flight.path(rig))
            flights.append(flight)
    flown = in_parallel(fly, [{"flight": flight} for flight in flights], on_progress)
    sensed = {
        sense: Sensed(
            rig, designs[sense], tuple(each for each in flown if each.flight.sense == sense)
        )
        for sense, rig in rigs.items()
    }
    return Mechanisms(seed, model_sha256(model), sensed)


def _drawn(rig: Rig, seed: int, quick: bool) -> list[tuple[Failure | None, float, int]]:
    """Failures, durations and seeds of the flights: those of every sensing, and of every robot."""
    each: list[tuple[int, FaultKind]] = [
        (actuator, kind) for actuator in range(len(rig.actuators)) for kind in KINDS
    ]
    drawn: list[tuple[Failure | None, float, int]] = []
    for place, (actuator, kind) in enumerate(each[:1] if quick else each):
        rng = np.random.default_rng([seed, place])
        when_s = round(float(rng.uniform(_EARLIEST_S, _LATEST_S)), 3)
        left = float(rng.uniform(*_EFFECTIVENESS)) if kind == "weak" else 0.0
        failure = Failure(actuator, kind, when_s, left)
        drawn.append(
            (failure, round(when_s + recovered_s(rig) + LEFT_S, 3), int(rng.integers(2**32)))
        )
    for k in range(0 if quick else _SOUND):
        rng = np.random.default_rng([seed, len(each) + k])
        drawn.append((None, _SOUND_S, int(rng.integers(2**32))))
    return drawn
