"""A run tick by tick equals the planned run, and failures can be repaired."""

from collections.abc import Sequence
from dataclasses import fields
from typing import Any

import numpy as np
import pytest

from fjh.live.live_run import LiveRun
from fjh.rig import Rig, Run
from fjh.rig.events import Event
from sim import Failure, Pose
from tests.fjh.rigs import shared_rig

SEED = 3
EVENTS = (("hum", 0.2), ("bump", 0.4), ("sag", 0.45))


def simulated(rig: Rig, controller: Any, path: np.ndarray, failed: Sequence[Any]) -> LiveRun:
    """Simulate by clicks, with failures and events between two ticks."""
    live, period_s = LiveRun(rig, controller, len(path), SEED), rig.period_s
    demands = rig.feedforward_demands(path)
    failing = {round(at_s / period_s): (rig.number(which), kind) for which, kind, at_s in failed}
    starting = {round(at_s / period_s): name for name, at_s in EVENTS}
    for k, reference in enumerate(path):
        if k in failing:
            live.make(*failing[k])
        if k in starting:
            live.start_event(starting[k])
        live.step(reference, None if demands is None else demands[k])
    return live


def assert_same(run: Run, other: Run) -> None:
    """Assert that two runs are equal to the bit, without estimated poses, which are not logged."""
    for field in fields(Run):
        here, there = getattr(run, field.name), getattr(other, field.name)
        if isinstance(here, np.ndarray):
            np.testing.assert_array_equal(here, there, err_msg=field.name)
        elif isinstance(here, Pose):
            np.testing.assert_array_equal(here.rotation, there.rotation)
            np.testing.assert_array_equal(here.translation_m, there.translation_m)
        elif field.name in ("failures", "events", "diagnoses", "status", "undiagnosed"):
            assert here == there, field.name


LATER = [(1, "weak", 0.3), (4, "locked", 1.2)]


@pytest.mark.parametrize(
    ("name", "controller", "failed", "duration_s"),
    [
        ("hexapod", "controller", [(1, "weak", 0.3), (4, "locked", 0.5)], 0.61),
        *(
            pytest.param(each, "supervisor", LATER, 2.0, marks=pytest.mark.long)
            for each in ("hexapod", "arm")
        ),
    ],
)
def test_run_by_clicks_equals_planned_run_bit_for_bit(name, controller, failed, duration_s):
    rig = shared_rig(name)
    controller, path = getattr(rig, controller)(), rig.path("circle", duration_s=duration_s)
    failed = [(rig.actuators[k], kind, at_s) for k, kind, at_s in failed]
    failures, events = [Failure(*each) for each in failed], [Event(*each) for each in EVENTS]
    planned = rig.fly(controller, path, failures=failures, events=events, seed=SEED)
    assert_same(simulated(rig, controller, path, failed).logged_run(0), planned)
    assert planned.failures and len(planned.events) == len(EVENTS)


@pytest.mark.long
def test_diagnosis_after_a_switch_has_the_time_of_the_run():
    """The supervisor takes over at 0.2 s and learns until 1 s; the lock is at 1.1 s."""
    rig = shared_rig("hexapod")
    path, controller = rig.path("circle", duration_s=1.4), rig.supervisor()
    live = LiveRun(rig, rig.controller(), len(path), SEED)
    for k, reference in enumerate(path):
        if k == 200:
            live.switch_controller(controller)
        if k == 1100:
            live.make(3, "locked")
        live.step(reference, None)
    run = live.logged_run(0)
    (diagnosis,) = run.diagnoses
    assert (diagnosis.actuator, diagnosis.kind) == (
        "strut4",
        "locked",
    ) and 1.1 < diagnosis.time_s < 1.4
    assert run.status == f"{diagnosis}." and live.diagnosis_text.startswith("strut4 is locked")
