"""Which cases `fjh paper recover` has: drawn from a seed and a place, and small."""

import pickle
from dataclasses import replace
from functools import cache, partial
from math import sqrt
from typing import Any, get_args

import numpy as np
import pandas as pd
import pytest

from experiments.recover import hexapod_basis, plan
from experiments.recover.plan import BENCH, Case, exact_rig, healthy_for, sizes_of
from experiments.study import Where, basis_of, rows_of
from fjh.rig.draw import CORRELATION, Draw
from fjh.rig.events import EVENTS
from fjh.rig.hexapod.mismatch import ALL, ALONE, DRAWN, OTHER, differing
from fjh.rig.mismatch import Mismatch
from fjh.rig.options import RobotOptions
from fjh.study.errors import Interrupted, WrongInput
from sim import HEXAPOD_MJCF
from sim.plant import FailureKind

whole = cache(partial(plan.hexapod_failures, plan.WHOLE, healthy_for(2.0), BENCH.duration_s))
eventful = cache(partial(plan.hexapod_events, EVENTS, plan.EVENTS_EACH, 3600.0))


@pytest.mark.parametrize("cases", [whole, eventful])
def test_cases_are_a_pure_function_of_the_seed_and_small(cases):
    own, other = cases(7), cases(4)
    assert cases.__wrapped__(7) == own and [case.number for case in own] == list(range(len(own)))
    assert all(one != two for one, two in zip(own, other, strict=True))
    assert max(len(pickle.dumps(case)) for case in own[:100]) < 2000


def test_the_failures_are_those_that_were_published():
    """As first drawn, and nothing else happens to them; each size is one that a plant can have."""
    cases = plan.hexapod_failures(plan.WHOLE, healthy_for(0.1), BENCH.duration_s, 3)
    first = {0: (4.085, 3017326895), 400: (4.038, 1069903208), 1000: (10.592, 2805759266)}
    assert len(cases) == 1127
    for number, expected in first.items():
        case = cases[number]
        assert (round(case.begin_s, 9), case.plant_seed) == expected
        assert (case.events, case.course) == ((), "spiral")
        spiral = BENCH.spiral_rad(case.duration_s, case.begin_s)
        np.testing.assert_array_equal(case.path(exact_rig()), spiral)
    for _, mismatch, factor, count in plan.WHOLE:
        assert count > 0
        sizes_of(exact_rig(), mismatch).scaled(factor)  # which refuses all others
    failing = {mismatch for sort, mismatch, _, _ in plan.WHOLE if sort == "failure"}
    assert failing == {"exact", "all", *ALONE}


def test_a_study_goes_on_with_more_hours_or_fewer(tmp_path, monkeypatch):
    """The cases before them are the same, and so is what the dataset depends on."""
    drawn_from = hexapod_basis(3, False, False, None)
    short, long = (plan.hexapod_cases(drawn_from, healthy) for healthy in (9, 12))
    assert plan.healthy_for(1.0) == 225 and plan.healthy_for(1e-3) == 1
    assert short == long[: len(short)] and len(long) == len(short) + 3
    basis = basis_of(**drawn_from)

    def done(pool, function, calls):
        for number, each in enumerate(calls):
            yield number, function(**each)

    monkeypatch.setattr("experiments.study.finished", done)

    def rows(count: int, stop_at: int = -1, **changed: Any) -> pd.DataFrame:
        def interrupt(done: int, _total: int) -> None:
            if done == stop_at:
                raise KeyboardInterrupt

        where = Where(workers=1, resume=True if changed else None)
        how: dict[str, Any] = {"name": "recover", "folder": tmp_path, "on_progress": interrupt}
        return rows_of(short[:count], Case.parameters, basis | changed, where, **how)

    with pytest.raises(Interrupted, match="4 of 6 runs are kept; --resume continues"):
        rows(6, stop_at=4)
    with pytest.raises(WrongInput, match="another seed"):
        rows(6, seed=1)
    assert list(rows(8).case) == list(range(8)) and len(rows(3)) == 3
    expected = pd.DataFrame([case.parameters() for case in short[:8]])
    pd.testing.assert_frame_equal(rows(8), expected)


def test_a_failure_is_the_same_whatever_the_plant_and_all_are_drawn():
    """So that what a mismatch costs is not the luck of the draw."""
    cases = [case for case in whole(7) if case.sort in ("failure", "size")]
    by_draw: dict[int, set[Case]] = {}
    alike = {"number": 0, "sort": "size", "mismatch": "exact", "factor": 1.0, "compared": ()}
    for case in cases:
        by_draw.setdefault(case.draw, set()).add(replace(case, **alike))
    assert {len(same) for same in by_draw.values()} == {1}
    assert len({(case.failures[0].actuator, case.failures[0].kind) for case in cases[:18]}) == 18
    for case in cases[:18]:
        assert plan_tick(case) == round(1e3 * plan.BEFORE_S)
        assert case.begin_s > 0 and case.begin_s + case.duration_s <= 16.0
    pairs = [case for case in whole(7) if case.sort == "pair"]
    assert len(pairs) >= 20
    for case in pairs:
        first, second = case.failures
        assert first.actuator != second.actuator
        assert 0.1 <= second.time_s - first.time_s <= 2.0
        assert case.begin_s + case.duration_s == pytest.approx(second.time_s + 2.0)


def plan_tick(case: Case) -> int:
    """The control tick of the first failure."""
    return round((case.happens_s - case.begin_s) / BENCH.control_period_s)


def test_every_event_has_cases_and_those_of_one_draw_differ_in_it_alone():
    cases = eventful(1)[1:]
    assert len(cases) == 12 * len(EVENTS) and len(EVENTS) >= 30
    assert [case.events[0].name for case in cases] == [n for n in EVENTS for _ in range(12)]
    times = {(case.draw, case.events[0].time_s) for case in cases}
    same = {replace(case, number=0, events=(), compared=()) for case in cases}
    assert len(times) == len(same) == 12
    told = {case.events[0].name for case in cases if "informed" in case.compared}
    assert told == {name for name in EVENTS if name in get_args(FailureKind)}
    # All courses and struts are run with either family, some before all is learned.
    cases = cases[:12]
    after_s = [case.happens_s - case.begin_s for case in cases]
    assert sum(each < 0.8 for each in after_s) == 2 and max(after_s) > 2.0
    for mismatch in ("all", "other family"):
        own = [case for case in cases if case.mismatch == mismatch]
        assert len({(case.course, case.turn_s, case.radius) for case in own}) == plan.COURSES
        assert {case.events[0].actuator for case in own} == set(range(6))
    for case in cases:
        assert case.begin_s + case.duration_s <= 16.0
        assert case.path(exact_rig()).shape == (round(1e3 * case.duration_s), 2)


def test_the_other_family_is_log_normal_correlated_and_as_wide_as_stated():
    """Twice the standard deviation of the uniform one, which is what it was."""
    draws, width = range(1500), 0.06
    logs = np.log([Draw(k, "lognormal").factors("gain", 2, width) for k in draws])
    assert logs.std() == pytest.approx(width / sqrt(3), rel=0.06)
    assert logs.mean() == pytest.approx(0, abs=4 * width / sqrt(3 * 1500))
    assert np.asarray(np.corrcoef(logs.T))[0, 1] == pytest.approx(CORRELATION, abs=0.08)
    uniform = np.array([Draw(k).factors("gain", 2, width) for k in draws])
    assert float(np.abs(uniform - 1).max()) <= width
    assert uniform.std() == pytest.approx(width / sqrt(3), rel=0.06)
    assert np.asarray(np.corrcoef(uniform.T))[0, 1] == pytest.approx(0, abs=0.08)
    for name in DRAWN:
        assert getattr(OTHER, name) == 2 * getattr(ALL, name)
    model = exact_rig().model
    own = differing(model, Mismatch(gain=0.06, family="lognormal"), 5).model
    assert own is not None
    gains = own.actuator_gainprm[:, 0] / model.actuator_gainprm[:, 0]
    np.testing.assert_allclose(gains, Draw(5, "lognormal").factors("gain", 6, 0.06), rtol=1e-12)


# Any robot.


@pytest.mark.long
def test_a_robot_has_the_same_cases_with_every_sensing(monkeypatch):
    monkeypatch.setattr(plan, "check_reach", lambda *_: None)
    options = RobotOptions(major=(3, 4), sense="both", crossover=0.7)
    given = (HEXAPOD_MJCF.with_name("platform.xml"), options, 4.0)
    [locked], _ = plan.robot_cases(*given, "designed", (), seed=0, quick=True)
    assert locked.isolable and locked.sort == "failure"
    cases, dithers = plan.robot_cases(*given, "none", (), seed=0, quick=False)
    assert len(cases) == 3 * (4 * 3 + 3) and dithers == dict.fromkeys(("task", "joints", "both"))
    assert len({case.seed for case in cases}) == 15
    assert not any(case.isolable for case in cases)


def test_events_of_a_robot_differ_in_what_happens_and_to_which_actuator():
    options = RobotOptions(major=(3, 4), crossover=0.7)
    first = Case("event", seed=5, model=HEXAPOD_MJCF.with_name("hand.xml"), options=options)
    cases = list(plan.robot_events(first, EVENTS, plan.ROBOT_EVENTS_EACH, 3))
    assert len(cases) == plan.ROBOT_EVENTS_EACH * len(EVENTS)
    assert len({(case.seed, case.duration_s, case.plane_seed) for case in cases}) == 2
    assert {case.events[0].name for case in cases} == set(EVENTS)
    assert {case.events[0].actuator for case in cases} == {None, 0, 1, 2, 3}
    for case in cases:
        assert case.duration_s == pytest.approx(case.events[0].time_s + 1.5)
