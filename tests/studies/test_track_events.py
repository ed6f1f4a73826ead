"""`fjh track --event`: what happens besides failures is said, and held to no linear model."""

import re

import numpy as np
import pytest

from fjh.recording.properties import properties_of
from fjh.rig.events import Event
from fjh.study.errors import WrongInput
from fjh.study.result import Result
from fjh.track import parsed
from tests import rrd
from tests.studies.test_track import ARM, tracked


@pytest.fixture(scope="module")
def pushed() -> Result:
    events = ["hard_over:joint2@0.3", "bump@0.2", "late@0.35"]
    return tracked(ARM, duration=0.4, event=events, diagnosis="off", fail=["motor4:locked@0.32"])


@pytest.fixture(scope="module")
def locked() -> Result:
    return tracked(ARM, duration=0.2, event=["locked:motor4@0.1"], diagnosis="off")


def test_events_are_published_in_the_order_of_time_with_names_of_actuators(pushed):
    assert pushed.settings["events"] == [
        {"name": "bump", "actuator": None, "time_s": 0.2},
        {"name": "hard_over", "actuator": "motor2", "time_s": 0.3},
        {"name": "late", "actuator": None, "time_s": 0.35},
    ]
    said = "bump at 0.2 s, motor2 hard_over at 0.3 s, motor4 locked at 0.32 s, late at 0.35 s"
    assert f"after {said} the RMS error is" in pushed.found["verdict"]
    log = pushed.shown[1].frame
    assert list(zip(log.time_s, log.what, strict=True)) == [
        *((0.2, "bump"), (0.3, "motor2 hard_over"), (0.32, "motor4 locked"), (0.35, "late"))
    ]
    assert log.meaning.iloc[2].startswith("major task possible: The actuators reach")


def test_the_linear_model_is_held_to_what_was_before_the_first_event(pushed):
    found, run = pushed.found, pushed.arrays["track.npz"]
    before = np.asarray(run["desired"] - run["true"])[:200]
    np.testing.assert_allclose(found["rms_before"], np.sqrt((before**2).mean(axis=0)))
    assert found["prediction_off_before"] < 0.1
    assert found["predicted_rms_after"] is None
    assert found["predicted_rms_after_when_named"] is None
    assert found["uncompared"].startswith("the linear model does not have bump")
    assert len(pushed.checks) == 2  # loops, and before
    assert found["rms_after"][0] > 10 * found["rms_before"][0]
    assert found["limited_by"] is None


def test_a_failure_that_is_an_event_is_said_once_and_classified(locked):
    assert locked.settings["failures"] == [{"actuator": "motor4", "kind": "locked", "time_s": 0.1}]
    said = locked.found["verdict"]
    assert "after motor4 locked at 0.1 s the RMS error" in said
    assert said.endswith("; nothing was diagnosed.") and ". " not in said
    assert list(locked.shown[1].frame.what) == ["motor4 locked"]
    assert locked.found["possible_after"] == [True]


def test_an_event_that_cannot_be_is_refused_by_the_name_of_the_option():
    for asked, said in (
        ("hardover:strut1@3", 'no event "hardover"; did you mean "hard_over"'),
        ("hard_over@3", "hard_over is of an actuator, which must be named"),
        ("bump", "must be NAME@SECONDS or NAME:ACTUATOR@SECONDS, got 'bump'"),
    ):
        with pytest.raises(WrongInput, match="^--event.*" + re.escape(said)):
            parsed("--event", Event, [asked])


def test_the_recording_has_failed_actuators_and_lists_all_that_happens(pushed, tmp_path):
    pushed.records[0](tmp_path)
    times, texts = rrd.rows(tmp_path / "track.rrd", "/events", "TextLog:text")
    assert {text: int(at) // 1_000_000 for at, (text,) in zip(times, texts, strict=True)} == {
        **{"bump": 200, "motor2 hard_over": 300, "motor4 locked": 320, "late": 350}
    }
    held, found = properties_of(tmp_path / "track.rrd"), pushed.found
    assert (held["study"], held["actuator"], held["kind"]) == ("track", "motor2", "hard_over")
    assert held["verdict"] == found["verdict"]
    assert held["rms_before_rad"] == pytest.approx(np.linalg.norm(found["rms_before_rad"]))
