"""The figure of `fjh track`: errors by unit, actuators by name, the result as title."""

from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest

from experiments.rig.units import prefixed
from experiments.track.figure import figure_track
from experiments.track.results import verdict
from tests.figure_checks import overlapping_texts, text_faults

MJCF = """<mujoco><worldbody>
  <body><joint name="lift" type="slide"/><geom size=".1"/>
    <body><joint name="turn" type="hinge"/><geom size=".1"/></body></body>
</worldbody></mujoco>"""


def tracked(displacement: np.ndarray) -> Any:
    """A turn about x and a shift along y, with constant errors."""
    time_s = np.linspace(0, 2, len(displacement))
    desired = np.stack([1e-3 * np.sin(time_s), 2e-3 * np.cos(time_s)], axis=1)
    run = SimpleNamespace(time_s=time_s, desired=desired, displacement=displacement)
    run.true = desired - [3e-6, 4e-5]
    rig = SimpleNamespace(model=mujoco.MjModel.from_xml_string(MJCF), major=(0, 4))
    rig.actuators, rig.units = ("motor", "screw"), ("rad", "m")
    return SimpleNamespace(rig=rig, run=run, other=None)


SUMMARY: dict[str, Any] = {
    "robot": "crane",
    "units": ["rad", "m"],
    "rms_before": [3e-6, 4e-5],
    "predicted_rms_before": [2e-6, 3e-5],
    "rms_after": [6e-6, 8e-5],
    "failures": [{"actuator": "motor", "kind": "locked", "time_s": 1.0}],
    "possible_after": [True],
    "lost": None,
    "events": [],
    "diagnoses": [{"actuator": "motor", "kind": "locked", "time_s": 1.1, "delay_s": 0.1}],
}
SUMMARY["verdict"] = verdict(SUMMARY)
LOCK = (
    "crane: after motor locked at 1 s the RMS error is 6 µrad and 80 µm, 3 µrad and 40 µm before."
)


def test_the_verdict_says_what_failed_what_it_cost_what_is_left_and_what_was_diagnosed():
    assert verdict(SUMMARY) == (
        f"{LOCK} The remaining actuators can do the major task; motor was diagnosed locked after "
        "100 ms."
    )
    wrong = {"diagnoses": [SUMMARY["diagnoses"][0] | {"delay_s": None}], "possible_after": [False]}
    assert verdict(SUMMARY | wrong) == (
        f"{LOCK} The remaining actuators cannot do the major task; motor was diagnosed locked "
        "wrongly."
    )
    assert verdict(SUMMARY | {"lost": "It is lost."}) == f"{LOCK} It is lost."
    bump = {"name": "bump", "actuator": None, "time_s": 0.5}
    assert "after bump at 0.5 s, motor locked at 1 s the" in verdict(SUMMARY | {"events": [bump]})
    healthy = SUMMARY | {"failures": [], "rms_after": None}
    assert verdict(healthy) == (
        "crane: without a failure the RMS error is 3 µrad and 40 µm; by the linear model 2 µrad "
        "and 30 µm."
    )


def test_rows_of_one_unit_are_one_error_their_norm():
    together = SUMMARY | {"units": ["m", "m"], "rms_after": [3e-6, 4e-6]}
    assert "is 5 µm," in verdict(together)


def test_actuators_are_named_and_scaled_by_their_own_unit():
    """Each row is as high as twice the furthest that any actuator of the unit goes."""
    displacement = np.linspace([0.0, 0.0], [0.2, -0.01], 50)
    figure = figure_track(tracked(displacement), SUMMARY)
    path, turn, shift, rows = figure.axes
    assert (path.get_xlabel(), path.get_ylabel()) == ("turn x, mrad", "y, mm")
    assert (turn.get_ylabel(), shift.get_ylabel()) == ("error, µrad", "error, µm")
    np.testing.assert_allclose(np.asarray(shift.lines[0].get_ydata()), 40)
    assert [label.get_text() for label in rows.get_yticklabels()] == ["motor", "screw"]
    assert rows.get_title().endswith("a row is 400 mrad or 20 mm high")
    for k, line in enumerate(rows.lines[:2]):
        half = np.abs(displacement[:, k]).max()
        np.testing.assert_allclose(
            k - np.asarray(line.get_ydata()), displacement[:, k] / (2 * half)
        )
    figure.draw_without_rendering()
    assert text_faults(figure) == overlapping_texts(figure) == []


@pytest.mark.parametrize(("size", "said"), [(2.0, "2"), (5e-3, "5 m"), (4e-5, "40 µ"), (0.0, "0")])
def test_a_prefix_makes_numbers_from_one_to_a_thousand(size, said):
    factor, prefix = prefixed(size)
    assert f"{factor * size:.3g} {prefix}".strip() == said
