"""Flights of any robot: each actuator fails in each way, seen by each of three sensings."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, get_args

import numpy as np

from experiments.recover.mechanism_flight import LEFT_S, MechanismFlight, recovered_s
from experiments.recover.mechanism_row import SCHEMA, row_of
from experiments.rig.dither import rig_dither
from experiments.rig.mjcf import robot_rig
from experiments.rig.options import RobotOptions, Sensing
from experiments.rig.reach import check_reach
from experiments.rig.rig import Rig
from experiments.study.basis import SHARED, Sources
from experiments.study.campaign import Campaign
from experiments.study.resumable import Complete, complete
from experiments.study.study import OnProgress
from ftc.fdi.dither_design import DitherDesign
from ftc.fdi.fault_model import KINDS, FaultKind
from sim import Failure, model_sha256

SENSINGS: tuple[Sensing, ...] = get_args(Sensing)

SOURCES = Sources(
    (
        *SHARED,
        *(
            f"experiments/recover/{name}.py"
            for name in ("mechanism_flight", "mechanism_row", "mechanisms", "recovery")
        ),
    ),
    (),
)

_EARLIEST_S, _LATEST_S = 1.5, 3.5
_EFFECTIVENESS = 0.2, 0.8
_SOUND_S, _SOUND = 6.0, 3
"""Flights without failures for each sensing: how long, and how many."""


@dataclass(frozen=True)
class Mechanisms:
    """Everything that `fjh recover --model` publishes.

    Attributes:
        done: The flights; their rows are on disk.
        model_sha256: Of the file.
        rigs: The robot as each sensing has it, with the exact model as its plant.
        dithers: In which failures are looked for, by sensing; None is none.
    """

    done: Complete[tuple[MechanismFlight, ...]]
    model_sha256: str
    rigs: dict[Sensing, Rig]
    dithers: dict[Sensing, DitherDesign | None]


@contextmanager
def run_mechanisms(
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
) -> Iterator[Mechanisms | dict[str, Any]]:
    """Fly a robot whose actuators fail, on all cores; flights are kept as they finish.

    Args:
        seed: Of all that is drawn.
        quick: One lock, seen by both sensors.
        model: MJCF file.
        turn: Time of one turn of the circle, in seconds.
        dither: As of :func:`experiments.rig.dither.rig_dither`.
        folder: As of :func:`experiments.study.resumable.complete`.
        workers: Likewise, of this machine: others have no such file.
        resume: Likewise.
        on_progress: Likewise.
        robot: Of :class:`experiments.rig.options.RobotOptions`, but for `sense`.

    Raises:
        WrongInput: Something that the robot does not have or cannot do; or as `complete`.
        sim.ModelError: The file, or what it says.
    """
    options, file = RobotOptions(**robot), model.resolve()
    drawn_from = {
        "seed": seed,
        "quick": quick,
        "robot": asdict(options),
        "robot_sha256": model_sha256(file),
        "turn_s": turn,
        "dither": dither,
    }
    senses: tuple[Sensing, ...] = ("both",) if quick else SENSINGS
    rigs: dict[Sensing, Rig] = {
        sense: robot_rig(file, replace(options, sense=sense)) for sense in senses
    }
    dithers: dict[Sensing, DitherDesign | None] = {
        sense: rig_dither(rig, dither) for sense, rig in rigs.items()
    }
    flights: list[MechanismFlight] = []
    for sense, rig in rigs.items():
        chosen = file, replace(options, sense=sense)
        for drawn in _drawn(rig, dithers[sense], seed, quick):
            flight = MechanismFlight(len(flights), *chosen, turn_s=turn, **drawn)
            check_reach(rig, flight.path(rig))
            flights.append(flight)
    campaign = Campaign(tuple(flights), row_of, SCHEMA, SOURCES, drawn_from)
    how: dict[str, Any] = {"scheduler": None, "workers": workers, "resume": resume}
    with complete("recover", campaign, folder=folder, on_progress=on_progress, **how) as done:
        if isinstance(done, Complete):
            yield Mechanisms(done, drawn_from["robot_sha256"], rigs, dithers)
        else:
            yield done


def _drawn(
    rig: Rig, design: DitherDesign | None, seed: int, quick: bool
) -> Iterator[dict[str, Any]]:
    """Of each flight of a sensing: failures and seeds are those of every sensing and robot."""
    each: list[tuple[int, FaultKind]] = [
        (actuator, kind) for actuator in range(len(rig.actuators)) for kind in KINDS
    ]
    dither = None if design is None else design.dither
    for place, (actuator, kind) in enumerate(each[:1] if quick else each):
        rng = np.random.default_rng([seed, place])
        when_s = round(float(rng.uniform(_EARLIEST_S, _LATEST_S)), 3)
        left = float(rng.uniform(*_EFFECTIVENESS)) if kind == "weak" else 0.0
        yield {
            "dither": dither,
            "failure": Failure(actuator, kind, when_s, left),
            "isolable": design is not None and design.separations.isolates(actuator, kind),
            "duration_s": round(when_s + recovered_s(rig) + LEFT_S, 3),
            "seed": int(rng.integers(2**32)),
        }
    for k in range(0 if quick else _SOUND):
        own_seed = int(np.random.default_rng([seed, len(each) + k]).integers(2**32))
        sound = {"failure": None, "isolable": False, "duration_s": _SOUND_S}
        yield {"dither": dither, **sound, "seed": own_seed}
