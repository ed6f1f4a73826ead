"""The runs that are kept whole, with marks at their failures."""

from pathlib import Path
from typing import Any

import numpy as np

from experiments.recording.keep import record_run
from experiments.recording.marks import Mark
from experiments.recover.checks import checks
from experiments.recover.recovery import Identification
from experiments.recover.runs import Recover
from experiments.rig.hexapod.fault_tolerance import fault_text
from experiments.rig.hexapod.metrics import recording_properties
from experiments.rig.hexapod.simulation import Trajectory
from ftc.fdi.fault_model import Fault
from sim import load_model


def marks(run: Trajectory, found: Identification) -> list[Mark]:
    """For a recording: each failure, when its strut was first named, and the last diagnosis."""
    marks = []
    for failure in found.failures:
        own = [
            each
            for each in found.diagnoses
            if each.fault.actuator == failure.actuator and run.time_s[each.tick] >= failure.time_s
        ]
        found_s = float(run.time_s[own[0].tick]) if own else np.inf
        words = f"found: {fault_text(own[-1].fault)}" if own else ""
        fault, named = Fault.of(failure), str(own[0].fault.kind) if own else ""
        happened = failure.number, failure.time_s, fault_text(fault)
        marks.append(Mark(*happened, found_s, words, kind=str(fault.kind), named=named))
    return marks


def record(outcome: Recover, summary: dict[str, Any], name: str, folder: Path) -> None:
    """Write data and recording of a run."""
    run, found = outcome.shown[name]
    entry, seed = summary["shown"][name], summary["seed"]
    ends = f"In the last second the pointing error is {entry['rms_in_the_end_urad']:.2f} urad RMS."
    if entry["task_lost"]:
        ends = (
            "The remaining struts cannot point: the task is diagnosed as impossible, and the "
            "commands stay constant."
        )
    said = [
        f"Seed {seed}, constant Jacobian, W_a; the failures are unannounced, and the plant differs "
        "from the controller's model in every way that fjh recover knows.",
        "",
        "Failures:",
        *(f"- strut {e['strut']} {e['kind']} at {e['time_s']:g} s" for e in entry["happened"]),
        "",
        "Identified from the pointing angles, the commands and a dither:",
        *(f"- strut {each['strut']} {each['kind']}" for each in entry["found"]),
        "",
        ends,
    ]
    record_run(
        folder,
        name,
        f"recover-{name}-seed{seed}",
        load_model(),
        run,
        marks(run, found),
        said=said,
        beside={},
        properties=recording_properties(summary),
        checks=checks(summary),
        verdict=ends,
    )
