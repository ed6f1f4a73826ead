"""The runs that are kept whole, and those of a dataset that are run again."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from experiments.recording.keep import record_run
from experiments.recording.marks import Mark
from experiments.recover.case import Case
from experiments.recover.plan import BEFORE_S, of_hexapod
from experiments.recover.row import supervised_columns
from experiments.recover.simulate import distance, other, supervised
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
        entry: What is published of it, ready for JSON.
        marks: Of its failures, for a recording.
        controller: Somebody else's; None is the supervised one.
    """

    name: str
    run: Run
    entry: dict[str, Any]
    marks: list[Mark]
    controller: str | None


def kept(name: str, seed: int, quick: bool, controller: str | None) -> Kept:
    """One of the runs that are shown, with all mismatches: the spiral from its start.

    Or, if `quick`, from shortly before the failures.
    """
    failures = SHOWN[name]
    begin_s = failures[0].time_s - BEFORE_S if quick else 0.0
    duration_s = failures[-1].time_s + 2.0 - begin_s
    case = of_hexapod("pair", 0, (seed, seed), begin_s, duration_s, 0.0, failures)
    rig = (case := replace(case, mismatch="all")).rig()
    if controller is None:
        run = supervised(rig, case)
        row = supervised_columns(rig, case, run)
        found = [_entry(rig, each.fault) for each in run.state.standing]
        entry = {"found": found, "right": row["all_right"], "task_lost": run.task_lost}
        entry |= {"unexplained": row["unexplained"]}
    else:
        run, failed = other(rig, case, controller)
        name, entry = f"{controller_label(controller)}_{name}", {"controller_failure": failed}
    error, last_second = distance(rig, run), round(1 / rig.period_s)
    entry |= {
        "happened": [_entry(rig, Fault.of(f)) | {"time_s": f.time_s} for f in failures],
        "rms_in_the_end": float(np.sqrt((error[-last_second:] ** 2).mean())),
        "peak": float(error[run.time_s >= failures[0].time_s].max()),
        "closure_residual_max_m": run.closure_max_m,
    }
    return Kept(name, run, entry, marks_of(rig, run), controller)


def _entry(rig: Rig, fault: Fault) -> dict[str, Any]:
    entry = {"actuator": rig.actuators[fault.actuator], "kind": fault.kind}
    return entry | ({"effectiveness": fault.effectiveness} if fault.kind == "weak" else {})


def marks_of(rig: Rig, run: Run) -> list[Mark]:
    """Each failure, when its actuator was first named, and as what in the end."""
    marks = []
    last = {} if not run.diagnoses else {d.fault.actuator: d.fault for d in run.state.diagnoses}
    for failure in run.failures:
        fault = Fault.of(failure)
        happened = failure.number, failure.time_s, fault_text(fault)
        if named := named_since(rig, run, failure):
            text, first = f"found: {fault_text(last[failure.number])}", named[0]
            found = first.time_s, text, fault.kind, first.kind
            marks.append(Mark(*happened, *found))
        else:
            marks.append(Mark(*happened, kind=fault.kind))
    return marks


def record(summary: dict[str, Any], own: Kept, checks: list[Check], folder: Path) -> None:
    """Write data and recording of a run that is kept whole."""
    seed, controller = summary["seed"], own.controller
    properties, status = recording_properties(summary), own.run.status
    if controller is not None:
        properties |= {"controller": controller}
        status = own.entry["controller_failure"] or f"Controller {controller}."
    failures = [f"- {mark.failure} at {mark.failed_s:g} s" for mark in own.marks]
    record_run(
        folder,
        own.name,
        f"recover-{own.name}-seed{seed}",
        load_model(),
        own.run,
        own.marks,
        said=["Nothing announces the failures, and the plant differs from the model.", *failures],
        beside={},
        properties=properties,
        checks=checks,
        verdict=status,
    )


def fly(case: Case) -> tuple[Row, Run, list[Mark]]:
    """The supervised controller's columns of a row, its run, and marks of the failures."""
    rig = case.rig()
    run = supervised(rig, case)
    return supervised_columns(rig, case, run), run, marks_of(rig, run)
