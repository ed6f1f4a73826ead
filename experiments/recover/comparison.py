"""Another controller in the scenarios of `fjh recover`."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from experiments.recording.keep import record_run
from experiments.recording.marks import Mark
from experiments.recover.pointing import pointing_error_urad
from experiments.recover.runs import SHOWN, Recover
from experiments.rig.hexapod.fault_tolerance import fault_text
from experiments.rig.hexapod.metrics import (
    closure_check,
    closure_residual_max_m,
    recording_properties,
)
from experiments.study.campaign import Row
from experiments.study.controllers import controller_label
from experiments.study.results import Check
from ftc.fdi.fault_model import Fault
from sim import load_model


def controller_summary(outcome: Recover, rows: Sequence[Row]) -> dict[str, Any]:
    """What is added to the summary, of flights with all mismatches; nothing without another one."""
    if outcome.controller is None:
        return {}
    after = [[row[f"rms_{name}_after_urad"] for name in ("other", "informed")] for row in rows]
    ratio = np.divide(*np.sqrt(np.square(after).mean(axis=0)))
    failures = [
        *(row["controller_failure"] for row in rows),
        *(why for _, why in outcome.compared.values()),
    ]
    entry = {
        "name": outcome.controller,
        "after_over_oracle": float(ratio),
        "runs": len(failures),
        "failures": [sentence for sentence in failures if sentence is not None],
        "shown": {
            name: {
                "failure": failure,
                "peak_urad": float(pointing_error_urad(run.desired_rad, run.true_rad).max()),
                "closure_residual_max_m": closure_residual_max_m(run),
            }
            for name, (run, failure) in outcome.compared.items()
        },
    }
    return {"controller": entry}


def controller_checks(summary: dict[str, Any]) -> list[Check]:
    """Checks that the controller did not fail and that its shown runs kept the loops closed."""
    if "controller" not in summary:
        return []
    entry = summary["controller"]
    said = (entry["failures"] or ["none"])[0]
    what = f"number of runs in which it failed ({said})"
    return [
        Check(what, f"controller {entry['name']}", len(entry["failures"]), 0.5),
        *(
            closure_check(f"{entry['name']}, run {name}", shown["closure_residual_max_m"])
            for name, shown in entry["shown"].items()
        ),
    ]


def controller_notes(summary: dict[str, Any]) -> list[str]:
    """Its error in one sentence, its failures in another."""
    if "controller" not in summary:
        return []
    entry = summary["controller"]
    failures = entry["failures"]
    notes = [
        f"With {entry['name']} the RMS error after recovery is {entry['after_over_oracle']:.4g} "
        "times that of the controller informed at once. It is told of no failure, and does not "
        "take the postures and the dither that the others have."
    ]
    if failures:
        notes.append(
            f"It failed in {len(failures)} of {entry['runs']} runs, which went on with its last "
            f"inputs held. The first: {failures[0]}."
        )
    return notes


def record_compared(outcome: Recover, summary: dict[str, Any], name: str, folder: Path) -> None:
    """Write data and recording of a whole run with the other controller."""
    run, failure = outcome.compared[name]
    controller, seed = str(outcome.controller), summary["seed"]
    file = f"{controller_label(controller)}_{name}"
    said = [
        f"Controller {controller}, seed {seed}; the failures are unannounced.",
        "",
        "Failures:",
        *(f"- {fault_text(Fault.of(each))} at {each.time_s:g} s" for each in SHOWN[name]),
    ]
    if failure is not None:
        said += ["", f"{failure}; its last inputs were held."]
    marks = [
        Mark(e.actuator, e.time_s, fault_text(Fault.of(e)), kind=str(e.kind)) for e in SHOWN[name]
    ]
    record_run(
        folder,
        file,
        f"recover-{file}-seed{seed}",
        load_model(),
        run,
        marks,
        said=said,
        beside={},
        properties=recording_properties(summary) | {"controller": controller},
        checks=controller_checks(summary),
    )
