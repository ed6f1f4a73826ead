"""Runs of a case by the controllers that are compared, and their errors."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from experiments.recover.plan import Case, about, around, exact_rig
from experiments.rig.events.hooks import events_of
from experiments.rig.hexapod.fault_tolerance import STILL, fault_text
from experiments.rig.other_controller import fly_with
from experiments.rig.rig import Rig
from experiments.rig.run import Run, tick_of
from experiments.study.campaign import Row
from ftc.controller import Measurement
from ftc.fdi.diagnosis import Diagnosis
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


def unaware(rig: Rig, case: Case) -> Run:
    """The run with a controller that goes on as if nothing had happened."""
    controller, secondary = rig.controller(), None if case.dither is None else case.dither.at
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
    tick = tick_at(rig, case, case.happens_s) + round(late_s / rig.period_s)
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


def tick_at(rig: Rig, case: Case, time_s: float) -> int:
    """The first tick of a run from a time on; one beyond its last if that is infinite."""
    return tick_of(min(time_s - case.begin_s, case.duration_s), rig.period_s)


def distance(rig: Rig, run: Run) -> Array:
    """Size of desired minus true displacements of all major rows, in sizes of the path, (N,)."""
    return np.linalg.norm(run.error, axis=1) / rig.size


def errors(rig: Rig, case: Case, run: Run, controller: str) -> Row:
    """RMS and peak error in each span, in sizes of the path, as columns of a controller."""
    begin, recovers = (round(s / rig.period_s) for s in (case.transient_s, case.recovered_s))
    tick, error = tick_at(rig, case, case.happens_s), distance(rig, run)
    ends = (begin, tick), (tick, tick + recovers), (tick + recovers, None), (tick, None)
    row: Row = {}
    for span, (first, last) in zip(SPANS, ends, strict=True):
        if len(part := error[first:last]):
            row[f"rms_{controller}_{span}"] = float(np.sqrt((part**2).mean()))
            row[f"peak_{controller}_{span}"] = float(part.max())
    return row


LATE_S = (0.03, 0.1, 0.3, 1.0)
INFORMED_LATE = (
    Failure(0, "locked", 8.25),
    Failure(0, "free", 8.25),
    Failure(0, "weak", 8.25, effectiveness=1.0),
)
"""Of these a controller is informed so late, or wrongly; the last is no failure at all."""


def informed_late(failure: Failure) -> list[dict[str, Any]]:
    """Entries on a controller that is told the truth, ever later; then, that another strut locked.

    The struts stand without a secondary displacement; errors in sizes of the path.
    """
    case = around(Case("failure", mismatch="exact", dither=about(0.0), failures=(failure,)))
    rig, truth = exact_rig(), Fault.of(failure)
    run, tick = unaware(rig, case), tick_at(rig, case, case.happens_s)
    nothing = errors(rig, case, run, "told_nothing")["rms_told_nothing_after"]
    news = [(truth, late_s) for late_s in LATE_S]
    news += [(Fault(k, "locked"), 0.0) for k in range(6) if k != truth.actuator]
    entries = []
    for fault, late_s in news:
        stood = float(run.displacement[tick, fault.actuator])
        found = errors(rig, case, informed(rig, case, fault, stood, late_s), "told")
        named = {"truth": fault_text(None if truth.is_sound else truth), "told": fault_text(fault)}
        kept = ("peak_told_during", "rms_told_after", "peak_told_after")
        entry = named | {"late_s": late_s, "rms_told_nothing_after": nothing}
        entries.append(entry | {key: found[key] for key in kept})
    return entries


def dither_cost(case: Case, duration_s: float) -> dict[str, Any]:
    """RMS errors (m1,) without failures on the exact plant, and their changes by dither and seed.

    And how far the dither moves the major rows, all together, on a plant that is not the model:
    there the actuators do not cancel. In sizes of the path.
    """
    rig, mixed = exact_rig(), exact_rig().drawn("all", case.plant_seed)
    case = replace(case, begin_s=0.0, duration_s=duration_s, failures=())
    still = replace(case, dither=replace(case.dither or STILL, amplitude=0.0))
    quiet, moved = (unaware(mixed, each) for each in (still, case))
    alone, swinging, reseeded = (
        unaware(rig, each).rms() / rig.size
        for each in (still, case, replace(still, seed=case.seed + 1))
    )
    apart = distance(rig, replace(quiet, desired=moved.true))
    return {
        "rms": alone.tolist(),
        "change": (swinging - alone).tolist(),
        "reseeded": (reseeded - alone).tolist(),
        "moved": float(np.sqrt((apart**2).mean())),
    }
