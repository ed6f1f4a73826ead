"""Session of two machines, with actions between two ticks."""

from collections.abc import Callable
from typing import get_args

import numpy as np
import pytest

from fjh.live import session as sessions
from fjh.live.live_run import Kind
from fjh.live.panel import LASTING
from fjh.live.reference_path import PATHS
from fjh.live.session import Session
from fjh.rig.run import HEALTHY
from tests.fjh.rigs import shared_rig

KINDS: tuple[Kind, ...] = get_args(Kind)
LSB_PERCENT = 100 / 2**15
LEARNED = 1000
"""Ticks after which the healthy machine is learned, which takes 0.8 s."""


@pytest.fixture
def session() -> Session:
    return Session(shared_rig("hexapod"))


def diagnosis(session: Session) -> str:
    """Return the supervised controller's diagnosis."""
    return session.runs[0].diagnosis_text


def inputs(session: Session) -> np.ndarray:
    """Return the present inputs of both runs, (2, n)."""
    return np.array([live.state.inputs for live in session.runs])


def test_every_actuator_of_both_machines_can_have_every_state(session):
    """Repeated clicks have no further effect; the models of both machines remain equal."""
    for actuator in range(6):
        for kind in (*KINDS[::-1], KINDS[1]):
            for _ in range(2):
                session.make(actuator, kind)
            assert session.states[actuator] == kind
        session.advance(1)
    assert session.states == [KINDS[1]] * 6
    for live in session.runs:
        active = [(k, kind) for _, k, kind in live.changes if kind != HEALTHY]
        assert active == [(k, kind) for k in range(6) for kind in (*KINDS[:0:-1], KINDS[1])]
        plant = live._bench.plant
        locks = [plant.model.equality(f"lock{k}").id for k in range(1, 7)]
        assert plant.data.eq_active[locks].all()


def test_actions_undone_between_two_ticks_have_no_effect(session):
    """Events switched on and off twice and repaired failures leave no trace; events can restart."""
    calm = Session(shared_rig("hexapod"))
    for kind in (*KINDS[1:], KINDS[0]):
        session.make(2, kind)
    for name in LASTING:
        for on in (True, True, False, False):
            session.disturb(name, on)
            assert session.going_on == ({name} if on else set())
    for one in (session, calm):
        one.advance(20)
    for changed, calm_run in zip(session.runs, calm.runs, strict=True):
        np.testing.assert_array_equal(changed.logged_run(0).qpos, calm_run.logged_run(0).qpos)
    for name in (*LASTING, "bump"):
        start = session.tick
        session.disturb(name, None if name == "bump" else True)
        assert session.going_on == {name} - {"bump"}  # which ends by itself
        for one in (session, calm):
            one.advance(20)
        session.disturb(name, False)
        for changed, calm_run in zip(session.runs, calm.runs, strict=True):
            assert (
                changed.logged_run(start).measured != calm_run.logged_run(start).measured
            ).any(), name


def test_weights_change_without_a_step_of_the_inputs(session):
    """Inputs differ from those with former weights by the last bit at first, and later by more."""
    as_before = Session(shared_rig("hexapod"))
    for one in (session, as_before):
        one.advance(150)
    session.weigh([8.0, 1.0, 1.0, 8.0, 1.0, 1.0])
    for one in (session, as_before):
        one.advance(1)
    assert np.abs(inputs(session) - inputs(as_before)).max() <= 2 * LSB_PERCENT
    for one in (session, as_before):
        one.advance(100)
    assert (np.abs(inputs(session) - inputs(as_before)).max(axis=1) > 20 * LSB_PERCENT).all()
    assert session.goal.joint_weight == (8.0, 1.0, 1.0, 8.0, 1.0, 1.0)


def test_new_machines_are_healthy_and_repeat_the_run_bit_for_bit(session):
    session.advance(60)
    first = [live.logged_run(0) for live in session.runs]
    session.make(2, "free")
    session.disturb("hum", True)
    session.follow("steps")
    session.advance(30)
    session.follow("circle")
    session.restart()
    assert session.tick == 1 and session.states == [HEALTHY] * 6 and session.going_on == set()
    session.advance(60)
    for run, live in zip(first, session.runs, strict=True):
        again = live.logged_run(0)
        for name in ("qpos", "inputs", "measured", "desired"):
            np.testing.assert_array_equal(getattr(again, name), getattr(run, name))
        assert again.failures == () and again.events == ()


@pytest.mark.parametrize("name", PATHS)
def test_another_path_is_followed_by_both_and_by_new_machines(session, name):
    session.advance(30)
    session.follow(name)
    start = session.tick
    session.advance(20)
    expected, _ = session.reference.at(np.arange(20))
    for live in session.runs:
        np.testing.assert_array_equal(live.desired[start : start + 20], expected)
    session.restart()
    assert session.reference.name == name and not session.reference.desired[0].any()


def test_last_minute_is_cut_and_includes_earlier_active_failures(session, monkeypatch):
    """The saved duration is 0.1 s here."""
    monkeypatch.setattr(sessions, "SAVED_S", 0.1)
    session.make(0, "locked")
    session.make(1, "weak")
    session.advance(39)
    early = session.last_minute()[0]
    assert len(early.time_s) == 40 and early.time_s[0] == 0.0
    session.make(0, HEALTHY)
    session.advance(120)
    for run in session.last_minute():
        assert len(run.time_s) == 100 and run.time_s[-1] == pytest.approx(0.159)
        assert [(one.number, one.kind) for one in run.failures] == [(1, "weak")]


def test_ended_run_simulates_no_more_ticks(monkeypatch):
    monkeypatch.setattr(sessions, "LONGEST_S", 0.05)
    session = Session(shared_rig("hexapod"))
    assert [session.advance(30) for _ in range(3)] == [30, 19, 0]
    assert session.tick == 50 and not any(live.ticks_left for live in session.runs)
    session.restart()
    assert session.advance(10) == 10


def until(session: Session, holds: Callable[[str], bool], within_s: float) -> float:
    """Simulate until the diagnosis satisfies a condition; return the time [s]."""
    start = session.tick
    while not holds(diagnosis(session)):
        assert (session.tick - start) * shared_rig("hexapod").period_s < within_s, diagnosis(
            session
        )
        session.advance(20)
    return (session.tick - start) * shared_rig("hexapod").period_s


@pytest.mark.long
@pytest.mark.parametrize("while_looking", [True, False])
def test_restarted_diagnosis_identifies_failures(session, while_looking):
    """A failed strut is identified after the diagnosis is switched on again."""
    session.advance(LEARNED)
    if while_looking:
        session.make(0, "free")
        until(session, lambda it: it.startswith("strut1 is free"), 0.5)
    session.diagnose(False)
    assert diagnosis(session).startswith("No diagnosis")
    if not while_looking:
        session.make(3, "locked")
    session.advance(300)
    session.diagnose(True)
    assert "Learning" not in diagnosis(session)
    expected = "strut1 is " if while_looking else "strut4 is locked"
    until(session, lambda it: it.startswith(expected), 1.0)


@pytest.mark.long
def test_diagnosis_without_calibration_reports_that_it_learns(session):
    session.advance(100)
    session.diagnose(False)
    session.diagnose(True)
    assert diagnosis(session).startswith("The diagnosis is calibrated in the first 0.8 s")
    duration_s = until(session, lambda it: it == "All actuators are assumed healthy.", 1.0)
    assert duration_s == pytest.approx(0.8, abs=0.03)
