"""Tests of the cases of `fjh paper recover`, sampled from a seed and an index."""

import pickle
from dataclasses import replace
from functools import cache, partial
from math import sqrt
from typing import get_args

import numpy as np
import pytest

from experiments.recover import hexapod_basis, plan
from experiments.recover.plan import BENCH, Case, exact_rig, healthy_for, sizes_of
from fjh.rig.events import EVENTS
from fjh.rig.hexapod.mismatch import ALL, ALONE, SAMPLED
from fjh.rig.options import RobotOptions
from fjh.rig.random_streams import CORRELATION, RandomStreams
from sim import HEXAPOD_MJCF
from sim.plant import FailureKind

full = cache(partial(plan.hexapod_failures, plan.WHOLE, healthy_for(2.0), BENCH.duration_s))
with_events = cache(partial(plan.hexapod_events, EVENTS, plan.EVENTS_EACH, 600.0))


@pytest.mark.parametrize("cases", [full, with_events])
def test_cases_are_a_pure_function_of_the_seed_and_small(cases):
    own, other = cases(7), cases(4)
    assert cases.__wrapped__(7) == own and [case.number for case in own] == list(range(len(own)))
    assert all(one != two for one, two in zip(own, other, strict=True))
    assert max(len(pickle.dumps(case)) for case in own[:100]) < 2000


def test_the_failures_are_the_published_ones():
    """Numbers are those of the published dataset; all sizes are valid for a plant."""
    cases = plan.hexapod_failures(plan.WHOLE, healthy_for(0.1), BENCH.duration_s, 3)
    first = {0: (4.085, 3017326895), 400: (4.038, 1069903208), 900: (4.085, 3017326895)}
    assert len(cases) == 989
    for number, expected in first.items():
        case = cases[number]
        assert (round(case.begin_s, 9), case.plant_seed) == expected
        assert (case.events, case.course) == ((), "spiral")
        spiral = BENCH.spiral_rad(case.duration_s, case.begin_s)
        np.testing.assert_array_equal(case.path(exact_rig()), spiral)
    for _, mismatch, factor, count in plan.WHOLE:
        assert count > 0
        sizes_of(exact_rig(), mismatch).scaled(factor)  # which rejects all others
    failing = {mismatch for sort, mismatch, _, _ in plan.WHOLE if sort == "failure"}
    assert failing == {"exact", *plan.FAMILIES, *ALONE}


def test_more_hours_append_cases():
    sampling = hexapod_basis(3, False, False, None)
    short, long = (plan.hexapod_cases(sampling, healthy) for healthy in (9, 12))
    assert short == long[: len(short)] and len(long) == len(short) + 3
    assert plan.healthy_for(1.0) == 225 and plan.healthy_for(1e-3) == 1


def test_a_failure_is_the_same_with_any_plant_and_all_kinds_are_sampled():
    """Errors with different mismatches can then be compared."""
    cases = [case for case in full(7) if case.sort in ("failure", "size")]
    by_index: dict[int, set[Case]] = {}
    same_values = {"number": 0, "sort": "size", "mismatch": "exact", "factor": 1.0, "compared": ()}
    for case in cases:
        by_index.setdefault(case.draw, set()).add(replace(case, **same_values))
    assert {len(same) for same in by_index.values()} == {1}
    assert len({(case.failures[0].actuator, case.failures[0].kind) for case in cases[:18]}) == 18
    for case in cases[:18]:
        after_s = case.onset_s - case.begin_s
        assert round(after_s, 3) == plan.BEFORE_S
        assert case.begin_s > 0 and case.begin_s + case.duration_s <= 16.0
    pairs = [case for case in full(7) if case.sort == "pair"]
    assert len(pairs) >= 20
    for first, second in (case.failures for case in pairs):
        assert first.actuator != second.actuator
        assert 0.1 <= second.time_s - first.time_s <= 2.0


def test_every_event_has_cases_that_differ_only_in_the_event():
    cases = with_events(1)[1:]
    assert len(cases) == 12 * len(EVENTS) and len(EVENTS) >= 30
    assert [case.events[0].name for case in cases] == [n for n in EVENTS for _ in range(12)]
    times = {(case.draw, case.events[0].time_s) for case in cases}
    same = {replace(case, number=0, events=(), compared=()) for case in cases}
    assert len(times) == len(same) == 12
    informed = {case.events[0].name for case in cases if "informed" in case.compared}
    assert informed == {name for name in EVENTS if name in get_args(FailureKind)}
    assert {case.events[0].actuator for case in cases[:12]} == set(range(6))


def test_the_other_family_is_log_normal_correlated_and_twice_as_wide():
    draws, width = range(1500), 0.06
    logs = np.log([RandomStreams(k, "lognormal").factors("gain", 2, width) for k in draws])
    assert logs.std() == pytest.approx(width / sqrt(3), rel=0.06)
    assert logs.mean() == pytest.approx(0, abs=4 * width / sqrt(3 * 1500))
    assert np.asarray(np.corrcoef(logs.T))[0, 1] == pytest.approx(CORRELATION, abs=0.08)
    other = sizes_of(exact_rig(), "other family")
    assert all(getattr(other, name) == 2 * getattr(ALL, name) for name in SAMPLED)


@pytest.mark.long
def test_a_robot_has_the_same_cases_with_every_sensing(monkeypatch):
    monkeypatch.setattr(plan, "check_reachable", lambda *_: None)
    options = RobotOptions(major=(3, 4), sense="both", crossover=0.7)
    arguments = (HEXAPOD_MJCF.with_name("platform.xml"), options, 4.0)
    [locked], _ = plan.robot_cases(*arguments, "designed", (), seed=0, quick=True)
    assert locked.isolable and locked.sort == "failure"
    cases, dithers = plan.robot_cases(*arguments, "none", (), seed=0, quick=False)
    assert len(cases) == 3 * (4 * 3 + 12) and dithers == dict.fromkeys(("task", "joints", "both"))
    assert len({case.seed for case in cases}) == 24
    assert not any(case.isolable for case in cases)
