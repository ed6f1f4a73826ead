"""A flight tick by tick is the one that is planned beforehand; what was struck can be repaired."""

from collections.abc import Sequence
from dataclasses import fields
from typing import Any

import numpy as np
import pytest

from fjh.live.live_run import LiveRun
from fjh.rig import Rig, Run
from fjh.rig.events import Event
from sim import Failure, Pose
from tests.fjh.rigs import rig

SEED = 3
HAPPENED = (("hum", 0.2), ("bump", 0.4), ("sag", 0.45))


def flown(one: Rig, pilot: Any, path: np.ndarray, struck: Sequence[Any]) -> LiveRun:
    """By clicks: what is to happen at a time happens between two ticks."""
    flight, period_s = LiveRun(one, pilot, len(path), SEED), one.period_s
    demands = one.feedforward_demands(path)
    failing = {round(at_s / period_s): (one.number(which), kind) for which, kind, at_s in struck}
    begun = {round(at_s / period_s): name for name, at_s in HAPPENED}
    for k, reference in enumerate(path):
        if k in failing:
            flight.make(*failing[k])
        if k in begun:
            flight.start_event(begun[k])
        flight.step(reference, None if demands is None else demands[k])
    return flight


def assert_same(one: Run, other: Run) -> None:
    """All that is known of two runs, to the bit; a flight keeps no estimated poses."""
    for field in fields(Run):
        ours, theirs = getattr(one, field.name), getattr(other, field.name)
        if isinstance(ours, np.ndarray):
            np.testing.assert_array_equal(ours, theirs, err_msg=field.name)
        elif isinstance(ours, Pose):
            np.testing.assert_array_equal(ours.rotation, theirs.rotation)
            np.testing.assert_array_equal(ours.translation_m, theirs.translation_m)
        elif field.name in ("failures", "events", "diagnoses", "status", "undiagnosed"):
            assert ours == theirs, field.name


LATER = [(1, "weak", 0.3), (4, "locked", 1.2)]


@pytest.mark.parametrize(
    ("name", "pilot", "struck", "duration_s"),
    [
        ("hexapod", "controller", [(1, "weak", 0.3), (4, "locked", 0.5)], 0.61),
        *(
            pytest.param(each, "supervisor", LATER, 2.0, marks=pytest.mark.long)
            for each in ("hexapod", "arm")
        ),
    ],
)
def test_run_by_clicks_equals_planned_run_bit_for_bit(name, pilot, struck, duration_s):
    one = rig(name)
    pilot, path = getattr(one, pilot)(), one.path("circle", duration_s=duration_s)
    struck = [(one.actuators[k], kind, at_s) for k, kind, at_s in struck]
    failures, events = [Failure(*each) for each in struck], [Event(*each) for each in HAPPENED]
    planned = one.fly(pilot, path, failures=failures, events=events, seed=SEED)
    assert_same(flown(one, pilot, path, struck).logged_run(0), planned)
    assert planned.failures and len(planned.events) == len(HAPPENED)


@pytest.mark.long
def test_diagnosis_after_a_switch_has_the_time_of_the_run():
    """Not by its own first tick: it learned from 0.2 to 1 s, and the lock is at 1.1 s."""
    one = rig("hexapod")
    path, pilot = one.path("circle", duration_s=1.4), one.supervisor()
    flight = LiveRun(one, one.controller(), len(path), SEED)
    for k, reference in enumerate(path):
        if k == 200:
            flight.switch_controller(pilot)
        if k == 1100:
            flight.make(3, "locked")
        flight.step(reference, None)
    run = flight.logged_run(0)
    (named,) = run.diagnoses
    assert (named.actuator, named.kind) == ("strut4", "locked") and 1.1 < named.time_s < 1.4
    assert run.status == f"{named}." and flight.diagnosis_text.startswith("strut4 is locked")
