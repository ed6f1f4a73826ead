"""The last minute as a recording: what happened to both machines can be read back."""

import json
from functools import cache

import numpy as np
import pytest

from fjh.live.kept import keep
from fjh.live.session import Session
from fjh.recording.properties import properties_of
from fjh.rig import Rig
from fjh.study.errors import OutputError
from tests import rrd


@cache
def flown() -> Session:
    """A strut that locked and was repaired, another one that is weak, a bump."""
    session = Session(Rig.hexapod(), seed=4)
    session.advance(19)
    session.make(0, "locked")
    session.advance(20)
    session.make(0, "sound")
    session.make(3, "weak")
    session.disturb("bump")
    session.advance(60)
    return session


@pytest.mark.long
def test_what_happened_is_read_back_from_the_recording(tmp_path):
    said = keep(tmp_path / "new", flown())
    file = tmp_path / "new" / "live_1.rrd"
    assert said == f"The last 0 s are in {file}."
    assert [each.name for each in (tmp_path / "new").iterdir()] == ["live_1.rrd"]
    stated = json.loads(properties_of(file)["flight"])
    happened = {(each["actuator"], each["kind"], each["time_s"]) for each in stated["incidents"]}
    assert happened == {
        *(("strut1", "locked", 0.02), ("strut1", "sound", 0.04), ("strut4", "weak", 0.04)),
        (None, "bump", 0.04),
    }
    assert "strut1 sound at 0.04 s" in str(properties_of(file)["failures"])
    notes = rrd.notes(file)
    assert notes.startswith("# University of Wyoming hexapod")
    assert "- supervised: Nothing was diagnosed; it takes the first 0.8 s" in notes
    assert "- not supervised: This controller does not diagnose." in notes


@pytest.mark.long
def test_the_recording_has_the_paths_of_both_machines_and_leaves_former_ones(tmp_path):
    """What was true of the major rows, as the session has it."""
    (tmp_path / "live_1.rrd").write_text("of another day")
    assert str(tmp_path / "live_2.rrd") in keep(tmp_path, flown())
    assert (tmp_path / "live_1.rrd").read_text() == "of another day"
    for number, run in enumerate(flown().last_minute()):
        times, true = rrd.scalars(tmp_path / "live_2.rrd", f"/run_{number}/task/true")
        ticks = np.rint(times * 1e-9 / flown().rig.period_s).astype(int)
        assert len(ticks) >= 20
        np.testing.assert_allclose(true, 1e6 * run.true[ticks], rtol=1e-3, atol=1e-6)


@pytest.mark.long
def test_a_folder_that_refuses_is_said(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError):
        keep(tmp_path / "file", flown())
    assert (tmp_path / "file").read_text() == ""
