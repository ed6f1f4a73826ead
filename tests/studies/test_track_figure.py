"""The verdict of `fjh track`, and its figure: errors by unit, actuators by name."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd

from fjh.track import figure, verdict
from tests.figure_checks import overlapping_texts, text_faults

FOUND: dict[str, Any] = {
    "robot": "crane",
    "units": ["rad", "m"],
    "rms_before": [3e-6, 4e-5],
    "predicted_rms_before": [2e-6, 3e-5],
    "rms_after": [6e-6, 8e-5],
    "failures": [{"actuator": "motor", "kind": "locked", "time_s": 1.0}],
    "events": [],
    "diagnoses": [{"actuator": "motor", "kind": "locked", "time_s": 1.1}],
    "possible_after": [True],
    "lost": None,
}
LOG = pd.DataFrame({"time_s": [1.0], "what": ["motor locked"], "meaning": [""]})
NAMED = pd.DataFrame({"what": ["motor diagnosed locked"], "meaning": ["after 0.100 s"]})


def test_the_verdict_says_what_failed_what_it_cost_what_is_left_and_what_was_diagnosed():
    first = "crane: after motor locked at 1 s the RMS error is "
    cost = f"{first}6 µrad and 80 µm, 3 µrad and 40 µm before; "
    left = "the remaining actuators {} do the major task; "
    named = "motor diagnosed locked after 0.100 s."
    assert verdict(FOUND, LOG, NAMED) == cost + left.format("can") + named
    lost = FOUND | {"possible_after": [False]}
    nothing = f"{cost}{left.format('cannot')}nothing was diagnosed."
    assert verdict(lost, LOG, NAMED[:0]) == nothing
    assert verdict(FOUND | {"lost": "It is lost."}, LOG, NAMED) == f"{cost}it is lost."
    together = FOUND | {"units": ["m", "m"], "rms_after": [3e-6, 4e-6]}
    assert verdict(together, LOG, NAMED).startswith(f"{first}5 µm, ")  # their norm
    assert verdict(FOUND | {"rms_after": None}, LOG[:0], NAMED[:0]) == (
        "crane: without a failure the RMS error is 3 µrad and 40 µm, predicted 2 µrad and 30 µm."
    )


def test_actuators_are_named_and_scaled_by_their_own_unit():
    """Each row is as high as twice the furthest that any actuator of the unit goes."""
    displacement, time_s = np.linspace([0.0, 0.0], [0.2, -0.01], 50), np.linspace(0, 2, 50)
    desired = np.stack([1e-3 * np.sin(time_s), 2e-3 * np.cos(time_s)], axis=1)
    run = SimpleNamespace(time_s=time_s, desired=desired, displacement=displacement)
    run.error = np.broadcast_to([3e-6, 4e-5], desired.shape)
    run.true = desired - run.error
    rig = SimpleNamespace(major=(0, 4), actuators=("motor", "screw"), units=("rad", "m"))
    flown: Any = SimpleNamespace(rig=rig, run=run, other=None)
    drawn = figure(flown, FOUND | {"verdict": verdict(FOUND, LOG, NAMED)})
    _, _, shift, rows = drawn.axes
    np.testing.assert_allclose(np.asarray(shift.lines[0].get_ydata()), 40)
    assert [label.get_text() for label in rows.get_yticklabels()] == ["motor", "screw"]
    assert rows.get_title().endswith("a row is 400 mrad or 20 mm high")
    for k, line in enumerate(rows.lines[:2]):
        part = displacement[:, k] / (2 * np.abs(displacement[:, k]).max())
        np.testing.assert_allclose(k - np.asarray(line.get_ydata()), part)
    drawn.draw_without_rendering()
    assert text_faults(drawn) == overlapping_texts(drawn) == []
