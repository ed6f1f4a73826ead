"""Runs of a case by the controllers that are compared, and their errors."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import ceil
from typing import Any

import numpy as np

from experiments.recover.case import Case
from experiments.rig.events import events_of
from experiments.rig.other_controller import fly_with
from experiments.rig.rig import Rig
from experiments.rig.run import Run
from experiments.study.campaign import Row
from ftc.controller import Measurement
from ftc.fdi.diagnosis import Diagnosis
from ftc.fdi.dither import Dither
from ftc.fdi.fault_model import Fault, static_share
from ftc.oracle import NEVER, OracleController, OracleState
from ftc.reconfiguration import goal_after
from ftc.tracking import is_possible
from sim import Array, Failure, SimulationDiverged

SPANS = ("before", "during", "after", "since")
"""Of a run: before what happens, from then until recovery, from recovery on; and both of these."""


@dataclass(frozen=True)
class Holding(OracleController):
    """Controller that keeps its state at a tick without a finite reading."""

    def step(
        self,
        state: OracleState,
        reference: Array,
        measurement: Measurement,
        *,
        feedforward: Array | None = None,
    ) -> OracleState:
        """One control tick."""
        if not np.isfinite(measurement.output).all():
            return replace(state, ticks=state.ticks + 1)
        return super().step(state, reference, measurement, feedforward=feedforward)


def supervised(rig: Rig, case: Case) -> Run:
    """The run with a controller that diagnoses."""
    return _run(rig, case, rig.supervisor(case.dither))


def unaware(rig: Rig, case: Case, dither: Dither | None = None) -> Run:
    """The run with a controller that goes on as if nothing had happened.

    `dither` is another one than that of the case.
    """
    controller, dither = rig.controller(), dither or case.dither
    secondary = None if dither is None else dither.at
    return _run(rig, case, Holding(controller, controller, NEVER, secondary=secondary))


def informed(rig: Rig, case: Case, fault: Fault, displacement: float, late_s: float = 0.0) -> Run:
    """The run with a controller that is informed of a fault so long after what happens.

    `displacement` is where that actuator stood when it failed, with any controller.
    """
    n, share = len(rig.actuators), static_share(rig.nominal, fault)
    lost, acting = np.zeros(n), np.zeros(n)
    acting[fault.actuator] = share
    if fault.kind != "locked" and late_s == 0:
        lost[fault.actuator] = (1 - share) * displacement
    news = Diagnosis.told(fault, displacement)
    after = rig.controller(goal_after(rig.goal, [news], rig.nominal, rig.unused))
    tick = tick_of(rig, case, case.happens_s) + round(late_s / rig.period_s)
    secondary = None if case.dither is None else case.dither.at
    return _run(rig, case, OracleController(rig.controller(), after, tick, lost, secondary, acting))


def other(rig: Rig, case: Case, name: str) -> tuple[Run, str | None]:
    """The run with somebody else's controller, and a sentence if it failed."""
    how = {"failures": case.failures, "seed": case.seed, "begin_s": case.begin_s}
    return fly_with(rig, name, case.path(rig), **how)


def _run(rig: Rig, case: Case, controller: Any) -> Run:
    how = {"failures": case.failures, "seed": case.seed, "begin_s": case.begin_s}
    return rig.fly(controller, case.path(rig), events=case.events or None, **how)


def attempted(run: Callable[[], Run]) -> tuple[Run | None, str | None]:
    """A run; or nothing, and why it ended early: that is a result, not the end of the study."""
    try:
        return run(), None
    except (ValueError, SimulationDiverged) as error:
        return None, f"{type(error).__name__}: {error}"


def caused(rig: Rig, case: Case) -> tuple[Failure, ...]:
    """All failures of a case, those that events bring included.

    Raises:
        WrongInput: The robot cannot have such an event.
    """
    _, of_events = events_of(rig, case.events, begin_s=case.begin_s, seed=case.seed)
    return (*case.failures, *of_events)


def is_lost(rig: Rig, failures: tuple[Failure, ...]) -> bool:
    """Whether the actuators that are left cannot do the major task, by the failure atlas."""
    return not is_possible(rig.classified([Fault.of(each) for each in failures]))


def tick_of(rig: Rig, case: Case, time_s: float) -> int:
    """The first tick of a run from a time on; one beyond its last if that is infinite."""
    ticks = (min(time_s, case.begin_s + case.duration_s) - case.begin_s) / rig.period_s
    return ceil(ticks - 1e-6)


def distance(rig: Rig, run: Run) -> Array:
    """Size of desired minus true displacements of all major rows, in sizes of the path, (N,)."""
    return np.linalg.norm(run.error, axis=1) / rig.size


def errors(rig: Rig, case: Case, run: Run, controller: str) -> Row:
    """RMS and peak error in each span, in sizes of the path, as columns of a controller."""
    begin, recovers = (round(s / rig.period_s) for s in (case.transient_s, case.recovered_s))
    tick, error = tick_of(rig, case, case.happens_s), distance(rig, run)
    ends = (begin, tick), (tick, tick + recovers), (tick + recovers, None), (tick, None)
    row: Row = {}
    for span, (first, last) in zip(SPANS, ends, strict=True):
        if len(part := error[first:last]):
            row[f"rms_{controller}_{span}"] = float(np.sqrt((part**2).mean()))
            row[f"peak_{controller}_{span}"] = float(part.max())
    return row
