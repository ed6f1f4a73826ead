"""A flight tick by tick is the one that is planned beforehand; what was struck can be repaired."""

from collections.abc import Sequence
from dataclasses import fields
from functools import cache
from typing import Any, get_args

import numpy as np
import pytest

from fjh.live.flight import Flight, Kind
from fjh.rig import Rig, Run
from fjh.rig.events import Event
from fjh.rig.events.effects import Effect
from fjh.rig.events.hooks import Hooks
from fjh.rig.run import SOUND
from sim import HEXAPOD_MJCF, Failure, Pose

SEED, ON_THE_WAY = 3, 0.61
STRUCK = (("strut2", "weak", 0.3), ("strut5", "locked", 0.5))
HAPPENED = (("hum", 0.2), ("bump", 0.4), ("sag", 0.45))


@cache
def rig(name: str) -> Rig:
    if name == "hexapod":
        return Rig.hexapod()
    return Rig.of_mjcf(HEXAPOD_MJCF.with_name(f"{name}.xml"), major=[3, 4, 5])


def flown(one: Rig, pilot: Any, path: np.ndarray, struck: Sequence[Any] = STRUCK) -> Flight:
    """By clicks: what is to happen at a time happens between two ticks."""
    flight, period_s = Flight(one, pilot, len(path), SEED), one.period_s
    demands = one.feedforward_demands(path)
    failing = {round(at_s / period_s): (one.number(which), kind) for which, kind, at_s in struck}
    begun = {round(at_s / period_s): name for name, at_s in HAPPENED}
    for k, reference in enumerate(path):
        if k in failing:
            flight.make(*failing[k])
        if k in begun:
            flight.begin(begun[k])
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


def compared(one: Rig, pilot: Any, struck: Sequence[Any], duration_s: float) -> None:
    path = one.path("circle", duration_s=duration_s)
    failures = [Failure(*each) for each in struck]
    events = [Event(*each) for each in HAPPENED]
    planned = one.fly(pilot, path, failures=failures, events=events, seed=SEED)
    assert_same(flown(one, pilot, path, struck).run(0), planned)
    assert planned.failures and len(planned.events) == len(HAPPENED)


def test_a_controller_flies_by_clicks_as_it_does_by_plan_bit_for_bit():
    compared(rig("hexapod"), rig("hexapod").controller(), STRUCK, ON_THE_WAY)


@pytest.mark.long
@pytest.mark.parametrize("name", ["hexapod", "arm"])
def test_a_supervisor_flies_by_clicks_as_it_does_by_plan_bit_for_bit(name):
    one = rig(name)
    later = [(one.actuators[k], kind, at) for k, kind, at in ((1, "weak", 0.3), (4, "locked", 1.2))]
    compared(one, one.supervisor(), later, 2.0)


def test_what_is_struck_and_repaired_between_two_ticks_leaves_no_trace():
    one = rig("hexapod")
    path = one.path("circle", duration_s=0.3)
    runs, kinds = [], get_args(Kind)
    for clicks in ((), (*kinds[1:], kinds[0])):
        flight = Flight(one, one.controller(), len(path), SEED)
        for k, reference in enumerate(path):
            for kind in clicks if k == 150 else ():
                flight.make(2, kind)
            flight.step(reference, None)
        runs.append(flight.run(0))
    np.testing.assert_array_equal(runs[0].qpos, runs[1].qpos)
    np.testing.assert_array_equal(runs[0].inputs, runs[1].inputs)


def test_a_flight_ends_after_its_ticks_and_knows_of_the_last_what_still_is_so():
    """A repair in time is forgotten, and what was made of an actuator since is not."""
    one = rig("hexapod")
    path = one.path("circle", duration_s=0.1)
    flight = Flight(one, one.controller(), len(path), SEED)
    clicks: dict[int, tuple[int, Kind]]
    clicks = {10: (0, "locked"), 20: (1, "weak"), 30: (0, SOUND), 40: (2, "free"), 70: (3, "weak")}
    for k, reference in enumerate(path):
        assert flight.left == len(path) - k and flight.now_s == pytest.approx(k * one.period_s)
        if k in clicks:
            flight.make(*clicks[k])
        if k == 5:
            flight.begin("bump")
        flight.step(reference, None)
    assert flight.left == 0
    late = flight.run(50)
    assert [(each.actuator, each.kind) for each in late.failures] == [
        (1, "weak"),
        (2, "free"),
        (3, "weak"),
    ]
    assert late.events == () and [each.name for each in flight.run(0).events] == ["bump"]
    np.testing.assert_array_equal(late.time_s, np.arange(50, 100) * one.period_s)
    np.testing.assert_array_equal(late.true, flight.run(0).true[50:])


def test_an_event_that_has_ended_does_nothing_more():
    """The hum is on the readings of its ticks alone."""
    one = rig("hexapod")
    read = []
    for begun in (False, True):
        flight = Flight(one, one.controller(), 120, SEED)
        for k in range(120):
            if begun and k == 40:
                flight.begin("hum")
            if begun and k == 80:
                flight.end("hum")
            flight.step(np.zeros(2), None)
        run = flight.run(0)
        read.append(run.measured - run.true)
    differs = (np.abs(read[1] - read[0]) > 1e-6).any(axis=1)
    assert not differs[:40].any() and differs[41:80].any() and not differs[80:].any()


def test_an_event_that_was_not_begun_can_be_ended_and_one_begun_twice_is_one():
    one = rig("hexapod")
    runs = []
    for times in (1, 2):
        flight = Flight(one, one.controller(), 60, SEED)
        flight.end("sag")
        for k in range(60):
            if k == 20:
                for _ in range(times):
                    flight.begin("sag")
            flight.step(np.full(2, 1e-5), None)
        runs.append(flight.run(0))
    np.testing.assert_array_equal(runs[0].inputs, runs[1].inputs)
    np.testing.assert_array_equal(runs[0].qpos, runs[1].qpos)


def test_hooks_add_effects_in_their_order_and_take_the_one_that_ends():
    hooks, double = Hooks(), Effect(sent=lambda _, inputs: 2 * inputs)
    shift = Effect(sent=lambda since, inputs: inputs + since)
    assert hooks.is_empty
    hooks.begin(0, double)
    hooks.begin(5, shift)
    inputs = np.ones(2)
    np.testing.assert_array_equal(hooks.sent(4, inputs), 2.0)
    np.testing.assert_array_equal(hooks.sent(7, inputs), 2.0 + 2)
    hooks.end(double)
    np.testing.assert_array_equal(hooks.sent(7, inputs), 1.0 + 2)
    hooks.end(shift)
    assert hooks.is_empty


@pytest.mark.long
def test_what_a_pilot_names_that_took_over_is_dated_by_the_flight():
    """Not by its own first tick: it learned from 0.2 to 1 s, and the lock is at 1.1 s."""
    one = rig("hexapod")
    path, pilot = one.path("circle", duration_s=1.4), one.supervisor()
    flight = Flight(one, one.controller(), len(path), SEED)
    for k, reference in enumerate(path):
        if k == 200:
            flight.hand_over(pilot)
        if k == 1100:
            flight.make(3, "locked")
        flight.step(reference, None)
    run = flight.run(0)
    (named,) = run.diagnoses
    assert (named.actuator, named.kind) == ("strut4", "locked") and 1.1 < named.time_s < 1.4
    assert run.status == f"{named}."
    assert flight.belief.startswith("strut4 is locked")
