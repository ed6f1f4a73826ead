"""What a recording states about itself and its run, for whoever looks for one among many."""

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rerun.chunk import RrdReader

from experiments.study.results import Check
from experiments.study.study import WrongInput

if TYPE_CHECKING:
    from experiments.recording.shown import Shown

GROUPS = ("run", "results")
"""Of properties: how the run was made, and what came out."""


def properties_of(path: Path) -> dict[str, Any]:
    """All properties of a recording by name, those of both groups; one value, or a list of several.

    Raises:
        WrongInput: It is no whole recording.
    """
    run, results = groups_of(path)
    return run | results


def groups_of(path: Path) -> list[dict[str, Any]]:
    """The properties of each of `GROUPS`; as of :func:`properties_of`."""
    try:
        with warnings.catch_warnings(action="error"):  # of a file that ends too early it only warns
            reader = RrdReader(path)
            places = [f"/__properties/{group}" for group in GROUPS]
            found = [reader.stream().filter(content=each).to_chunks() for each in places]
    except Exception as error:  # the reader's own errors have no common class
        reason = " ".join(str(error).split())
        raise WrongInput(f"{path} is not a readable recording: {reason}") from None
    return [
        {
            name: cell[0][0] if len(cell[0]) == 1 else cell[0]
            for chunk in chunks
            for name, cell in chunk.to_record_batch().to_pydict().items()
            if not name.startswith("rerun.")
        }
        for chunks in found
    ]


def results_of(
    shown: "Shown",
    study: str,
    *,
    checks: Sequence[Check] = (),
    predicted_before: Any = None,
    predicted_after: Any = None,
    verdict: str = "",
) -> dict[str, Any]:
    """The results of a flight as properties; what it does not have is absent.

    Args:
        shown: The flight.
        study: By whom it was flown.
        checks: Of the study.
        predicted_before: RMS error of each major row before the first failure [rad] or [m]; None
            where the study predicts none.
        predicted_after: Likewise from then on.
        verdict: One sentence; the status of the flight where the study has none.
    """
    happened = shown.happened
    found: dict[str, Any] = {"study": study, "robot": shown.robot}
    found["failures"] = "; ".join(f"{text} at {at_s:g} s" for at_s, text in happened) or "none"
    if shown.marks:
        first = shown.marks[0]
        found |= {"actuator": shown.actuators[first.actuator], "kind": first.kind or first.failure}
        found["failed_s"] = float(first.failed_s)
        if first.is_found:
            found["named_s"] = float(first.diagnosed_s - first.failed_s)
            found["named_kind"] = first.named or first.diagnosis
    parts = shown.parts
    for when, predicted in (("before", predicted_before), ("after", predicted_after)):
        if when in parts:
            found |= _by_row(shown, f"rms_{when}", shown.rms(parts[when]))
            found |= _by_row(shown, f"predicted_rms_{when}", predicted)
    found["verdict"] = verdict or shown.status or _verdict(shown)
    return found | {"checks": checked(checks)}


def checked(checks: Sequence[Check]) -> str:
    """The first check that failed, or "passed"."""
    return next((str(check) for check in checks if not check.passed), "passed")


def _by_row(shown: "Shown", name: str, values: Any) -> dict[str, float]:
    """One entry a major row; and one of all of them, where they have one unit."""
    if values is None or not np.isfinite(values).all():
        return {}
    named = zip(shown.rows, shown.row_units, values, strict=True)
    found = {f"{name}_{row.replace(' ', '_')}_{unit}": float(each) for row, unit, each in named}
    if len(units := set(shown.row_units)) == 1:
        found[f"{name}_{units.pop()}"] = float(np.linalg.norm(values))
    return found


def _verdict(shown: "Shown") -> str:
    """The errors in a sentence."""
    first = shown.happened[0][1] if shown.happened else "No failure"
    return f"{first}: RMS error of {shown.rms_said()}."
