"""`fjh track --event`: what happens besides failures is said, and held to no linear model."""

import re

import numpy as np
import pytest

from experiments.recording.properties import properties_of
from experiments.recording.view import Change, view_of
from experiments.study.study import WrongInput
from experiments.track import STUDY
from experiments.track.results import (
    checks,
    first_tick,
    happened,
    notes,
    record,
    summarize,
    tables,
)
from experiments.track.runs import Tracked
from tests import rrd
from tests.studies.test_track_command import ARM, tracked


@pytest.fixture(scope="module")
def pushed() -> Tracked:
    events = ["hard_over:joint2@0.3", "bump@0.2", "late@0.35"]
    return tracked(ARM, duration=0.4, event=events, diagnosis="off", fail=["motor4:locked@0.32"])


@pytest.fixture(scope="module")
def locked() -> Tracked:
    return tracked(ARM, duration=0.2, event=["locked:motor4@0.1"], diagnosis="off")


def test_events_are_published_in_the_order_of_time_with_names_of_actuators(pushed):
    summary = summarize(pushed)
    assert summary["events"] == [
        {"name": "bump", "actuator": None, "time_s": 0.2},
        {"name": "hard_over", "actuator": "motor2", "time_s": 0.3},
        {"name": "late", "actuator": None, "time_s": 0.35},
    ]
    said = "bump at 0.2 s, hard_over of motor2 at 0.3 s, motor4 locked at 0.32 s, late at 0.35 s"
    assert happened(summary) == said
    assert f"after {said} the RMS error is" in summary["verdict"]
    assert "not compared after it, as it does not have bump" in " ".join(notes(pushed, summary))
    _, log = tables(pushed, summary)
    assert [row[:2] for row in log.rows] == [
        *(("0.200", "bump"), ("0.300", "motor2 hard_over"), ("0.320", "motor4 locked")),
        ("0.350", "late"),
    ]
    assert log.rows[2][2].startswith("major task possible: The actuators reach")


def test_the_linear_model_is_held_to_what_was_before_the_first_event(pushed):
    summary = summarize(pushed)
    assert first_tick(pushed.run) == 200
    assert summary["prediction_off_before"] < 0.1
    for key in ("predicted_rms_after", "predicted_rms_after_when_named", "prediction_off_after"):
        assert summary[key] is None
    assert len(checks(summary)) == 2  # loops, and before
    assert summary["rms_after"][0] > 10 * summary["rms_before"][0]
    assert summary["limited_by"] is None


def test_a_failure_that_is_an_event_is_said_once_and_classified(locked):
    summary = summarize(locked)
    assert summary["failures"] == [{"actuator": "motor4", "kind": "locked", "time_s": 0.1}]
    assert happened(summary) == "motor4 locked at 0.1 s"
    assert len(summary["possible_after"]) == 1


def test_an_actuator_fails_once():
    with pytest.raises(WrongInput, match="--fail and --event must name each actuator once"):
        tracked(ARM, event=["bump_then_lock:joint2@0.1"], fail=["motor2:free@0.2"])


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ("hardover:strut1@3", 'no event "hardover"; did you mean "hard_over"'),
        ("hard_over@3", "hard_over is of an actuator, which must be named"),
        ("bump:strut1@3", "bump is of no single actuator, got strut1"),
        ("bump", "must be NAME@SECONDS or NAME:ACTUATOR@SECONDS, got 'bump'"),
        ("bump@-1", "time_s must be a time from zero on"),
        ("bump@nan", "time_s must be a time from zero on"),
    ],
)
def test_an_event_that_cannot_be_is_refused_by_the_name_of_the_option(asked, said):
    option = next(each for each in STUDY.options if each.name == "event")
    with pytest.raises(WrongInput, match="^--event.*" + re.escape(said)):
        option.checked(asked, option.flag)


def test_where_nothing_is_diagnosed_the_verdict_says_so(locked):
    assert summarize(locked)["verdict"].endswith("; nothing was diagnosed.")


def test_a_verdict_is_two_sentences_that_name_the_failed_actuator(pushed, locked):
    for one in (pushed, locked):
        said = summarize(one)["verdict"]
        assert said.count(". ") == 1 and said.endswith(".") and "\n" not in said
        assert "motor4 locked at 0." in said


def test_the_recording_has_failed_actuators_and_lists_all_that_happens(pushed, locked, tmp_path):
    """An event that is a failure is marked once."""
    summary = summarize(pushed)
    record(pushed, summary, tmp_path)
    times, texts = rrd.rows(tmp_path / "track.rrd", "/events", "TextLog:text")
    assert {text: int(at) // 1_000_000 for at, (text,) in zip(times, texts, strict=True)} == {
        **{"bump": 200, "motor2 hard_over": 300, "motor4 locked": 320, "late": 350}
    }
    held = properties_of(tmp_path / "track.rrd")
    assert (held["study"], held["actuator"], held["kind"]) == ("track", "motor2", "hard_over")
    assert held["verdict"] == summary["verdict"]
    assert held["rms_before_rad"] == pytest.approx(np.linalg.norm(summary["rms_before_rad"]))
    assert view_of(locked.rig, locked.run).failures == [Change("motor4", "locked", 0.1)]
