"""The recording of the last minute can be read back."""

import json

import numpy as np
import pytest

from fjh.live.save import save_recording
from fjh.live.session import Session
from fjh.recording.properties import properties_of
from fjh.study.errors import OutputError
from tests import rrd
from tests.fjh.rigs import shared_rig


@pytest.mark.long
def test_last_minute_is_read_back_from_the_next_recording(tmp_path):
    """The run has a locked and repaired strut, a weak one, and a bump."""
    session, file = Session(shared_rig("hexapod"), seed=4), tmp_path / "live_2.rrd"
    (tmp_path / "live_1.rrd").touch()
    session.advance(19)
    session.make(0, "locked")
    session.advance(20)
    session.make(0, "healthy")
    session.make(3, "weak")
    session.disturb("bump")
    session.advance(60)
    assert save_recording(tmp_path, session) == f"The last 0 s are in {file}."
    assert {incident.name for incident in tmp_path.iterdir()} == {"live_1.rrd", "live_2.rrd"}
    stated = json.loads(properties_of(file)["flight"])
    incidents = {
        (incident["actuator"], incident["kind"], incident["time_s"])
        for incident in stated["incidents"]
    }
    assert incidents == {
        *(("strut1", "locked", 0.02), ("strut1", "healthy", 0.04), ("strut4", "weak", 0.04)),
        (None, "bump", 0.04),
    }
    for number, run in enumerate(session.last_minute()):
        times, true = rrd.scalars(file, f"/run_{number}/task/true")
        ticks = np.rint(times * 1e-9 / shared_rig("hexapod").period_s).astype(int)
        assert len(ticks) >= 20
        np.testing.assert_allclose(true, 1e6 * run.true[ticks], rtol=1e-3, atol=1e-6)
    with pytest.raises(OutputError):
        save_recording(tmp_path / "live_1.rrd", session)
