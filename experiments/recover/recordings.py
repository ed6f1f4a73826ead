"""The runs of the hexapod that are kept whole, and those of a dataset that are run again."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from experiments.recording.keep import record_run
from experiments.recording.marks import Mark
from experiments.recover.plan import BEFORE_S, Case, about
from experiments.recover.row import supervised_columns
from experiments.recover.simulate import errors, other, supervised
from experiments.rig.hexapod.fault_tolerance import fault_text
from experiments.rig.hexapod.metrics import recording_properties
from experiments.rig.rig import Rig
from experiments.rig.run import Run, named_since
from experiments.study.campaign import Row
from experiments.study.controllers import controller_label
from experiments.study.results import Check
from ftc.fdi.fault_model import Fault
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


@dataclass(frozen=True)
class Kept:
    """A run that is kept whole.

    Attributes:
        name: Of its files.
        run: All of it.
        row: Its columns, as of the dataset; of somebody else's controller what it has of them.
        marks: Of its failures, for a recording.
        controller: Somebody else's; None is the supervised one.
    """

    name: str
    run: Run
    row: Row
    marks: list[Mark]
    controller: str | None


def kept(name: str, seed: int, quick: bool, controller: str | None) -> Kept:
    """One of the runs that are shown, with all mismatches: the spiral from its start.

    Or, if `quick`, from shortly before the failures.
    """
    begin_s = SHOWN[name][0].time_s - BEFORE_S if quick else 0.0
    duration_s = SHOWN[name][-1].time_s + 2.0 - begin_s
    case = Case("pair", plant_seed=seed, seed=seed, dither=about(0.0), failures=SHOWN[name])
    case = replace(case, begin_s=begin_s, duration_s=duration_s)
    if controller is None:
        columns, run, marks = fly(case)
        return Kept(name, run, case.parameters() | columns, marks, controller)
    rig, name = case.rig(), f"{controller_label(controller)}_{name}"
    run, failed = other(rig, case, controller)
    row = case.parameters() | errors(rig, case, run, "other")
    row |= {"controller_failure": failed, "closure_residual_max_m": run.closure_max_m}
    return Kept(name, run, row, marks_of(rig, run), controller)


def fly(case: Case) -> tuple[Row, Run, list[Mark]]:
    """The supervised controller's columns of a row, its run, and marks of the failures."""
    rig = case.rig()
    run = supervised(rig, case)
    return supervised_columns(rig, case, run), run, marks_of(rig, run)


def marks_of(rig: Rig, run: Run) -> list[Mark]:
    """Each failure, when its actuator was first named, and as what in the end."""
    marks = []
    for failure in run.failures:
        fault, found = Fault.of(failure), dict[str, Any]()
        if named := named_since(rig, run, failure):
            faults = {each.fault.actuator: each.fault for each in run.state.diagnoses}
            found = {"diagnosed_s": named[0].time_s, "named": named[0].kind}
            found["diagnosis"] = f"found: {fault_text(faults[fault.actuator])}"
        happened = failure.number, failure.time_s, fault_text(fault)
        marks.append(Mark(*happened, kind=fault.kind, **found))
    return marks


def record(summary: dict[str, Any], own: Kept, checks: list[Check], folder: Path) -> None:
    """Write data and recording of a run that is kept whole."""
    properties, status = recording_properties(summary), own.run.status
    if own.controller is not None:
        properties |= {"controller": own.controller}
        status = own.row["controller_failure"] or f"Controller {own.controller}."
    failures = [f"- {mark.failure} at {mark.failed_s:g} s" for mark in own.marks]
    record_run(
        folder,
        own.name,
        f"recover-{own.name}-seed{summary['seed']}",
        load_model(),
        own.run,
        own.marks,
        said=["Nothing announces the failures, and the plant differs from the model.", *failures],
        beside={},
        properties=properties,
        checks=checks,
        verdict=status,
    )
