"""A second failure after the first, and failures until pointing is lost."""

from dataclasses import dataclass

import mujoco
import numpy as np

from experiments.hexapod.compensator import Loop
from experiments.hexapod.metrics import closure_residual_max_m
from experiments.hexapod.simulation import Trajectory, fly
from experiments.hexapod.supervisor import supervisor
from experiments.hexapod.testbed import Bench
from experiments.recover.cases import BEFORE_S, DITHER, GOAL
from experiments.recover.flights import pointing_error_urad
from ftc.fdi.diagnosis import Diagnosis
from ftc.fdi.fault_model import Fault, Kind, fault_of
from sim import Failure

_FIRST_S, _LEFT_S = (1.5, 9.0), 2.0
_GAP_S = (0.1, 2.0)
_KINDS: tuple[Kind, ...] = ("locked", "free")

CASCADE = (
    Failure(0, "locked", 4.0),
    Failure(3, "free", 6.0),
    Failure(1, "locked", 8.0),
    Failure(4, "locked", 10.0),
)
"""Struts 3 and 6 are left in the end, which pull in one direction of the (alpha, beta) plane."""


@dataclass(frozen=True)
class Succession:
    """Failures one after another, flown with a supervisor.

    Attributes:
        failures: What happened.
        diagnoses: All that were made, in order; ticks count from the start of the flight.
        found: What was held to be true in the end.
        task_lost: Whether it declared the task lost.
        lost_rightly: Whether the atlas says so of what did happen.
        unexplained: Whether it gave up.
        rms_urad: Of the pointing error in the last second.
        peak_urad: Of it, from the first failure on.
        closure_residual_max_m: Of the flight.
    """

    failures: tuple[Failure, ...]
    diagnoses: tuple[Diagnosis, ...]
    found: tuple[Fault, ...]
    task_lost: bool
    lost_rightly: bool
    unexplained: bool
    rms_urad: float
    peak_urad: float
    closure_residual_max_m: float

    @property
    def right(self) -> bool:
        """Whether each failure was found, and no other, and the loss of the task if it is lost."""
        happened = sorted((failure.strut, failure.kind) for failure in self.failures)
        found = sorted((fault.strut, fault.kind) for fault in self.found)
        return happened == found and self.task_lost == self.lost_rightly


def pairs(seed: int, number: int) -> list[tuple[Failure, ...]]:
    """Two struts each, locked or free, some time apart, at random times on the spiral."""
    rng = np.random.default_rng([seed, 4])
    drawn = []
    for _ in range(number):
        struts = rng.permutation(6)[:2]
        first_s = round(float(rng.uniform(*_FIRST_S)), 3)
        second_s = first_s + round(float(rng.uniform(*_GAP_S)), 3)
        kinds = [_KINDS[k] for k in rng.integers(len(_KINDS), size=2)]
        drawn.append(
            tuple(
                Failure(int(strut), kind, time_s)
                for strut, kind, time_s in zip(struts, kinds, (first_s, second_s), strict=True)
            )
        )
    return drawn


def fly_sequence(
    model: mujoco.MjModel,
    bench: Bench,
    loops: tuple[Loop, Loop],
    failures: tuple[Failure, ...],
    seed: int,
    begin_s: float | None = None,
) -> tuple[Trajectory, Succession]:
    """Fly through the failures, and two seconds more.

    `begin_s` is where on the spiral; None: shortly before the first failure.
    """
    first_s, last_s = failures[0].time_s, failures[-1].time_s
    begin_s = first_s - BEFORE_S if begin_s is None else begin_s
    pilot = supervisor(model, bench, loops, GOAL, dither=DITHER)
    run, state = fly(
        model,
        bench,
        pilot,
        failures=failures,
        seed=seed,
        begin_s=begin_s,
        duration_s=last_s + _LEFT_S - begin_s,
    )
    size = pointing_error_urad(run)
    last_second = round(1 / bench.control_period_s)
    happened = [fault_of(failure) for failure in failures]
    return run, Succession(
        failures=failures,
        diagnoses=state.diagnoses,
        found=tuple(each.fault for each in state.standing),
        task_lost=state.task_lost,
        lost_rightly=not pilot.can_point(happened),
        unexplained=state.watch.unexplained,
        rms_urad=float(np.sqrt((size[-last_second:] ** 2).mean())),
        peak_urad=float(size[run.time_s >= first_s].max()),
        closure_residual_max_m=closure_residual_max_m(run),
    )
