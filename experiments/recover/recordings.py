"""The runs of the hexapod that are kept whole, and those of a dataset that are run again."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from experiments.recording.record import About, write_run
from experiments.recover.plan import BEFORE_S, Case, about, exact_rig
from experiments.recover.row import supervised_columns
from experiments.recover.simulate import errors, other, supervised
from experiments.rig.hexapod.columns import hexapod_arrays
from experiments.rig.hexapod.metrics import recording_properties
from experiments.rig.run import Run
from experiments.study.campaign import Row
from experiments.study.controllers import controller_label
from experiments.study.results import Check
from sim import Failure

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
        controller: Somebody else's; None is the supervised one.
    """

    name: str
    run: Run
    row: Row
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
        columns, run, _ = fly(case)
        return Kept(name, run, case.parameters() | columns, controller)
    run, failed = other(rig := case.rig(), case, controller)
    row = case.parameters() | errors(rig, case, run, "other") | {"controller_failure": failed}
    return Kept(f"{controller_label(controller)}_{name}", run, row, controller)


def fly(case: Case) -> tuple[Row, Run, str]:
    """The supervised controller's columns of a row, its run, and nothing more of its failures."""
    rig = case.rig()
    run = supervised(rig, case)
    return supervised_columns(rig, case, run), run, ""


def record(summary: dict[str, Any], own: Kept, checks: list[Check], folder: Path) -> None:
    """Write data and recording of a run that is kept whole."""
    properties, failed = recording_properties(summary), own.row.get("controller_failure")
    if own.controller is not None:
        properties |= {"controller": own.controller}
    about = About(
        study="recover",
        identity=f"recover-{own.name}-seed{summary['seed']}",
        title=own.name,
        said=["Nothing announces the failures, and the plant differs from the model."],
        parameters=properties,
        checks=checks,
        verdict=failed or "",
    )
    arrays = hexapod_arrays(own.run)
    write_run(folder / f"{own.name}.rrd", exact_rig(), own.run, about, arrays=arrays)
