"""File of a recording: identity, times, and errors of the writer."""

import re
from dataclasses import replace

import numpy as np
import pytest
import rerun.blueprint as rrb

from fjh.recording.file import RecordingInfo, log_series, recording_file, screen, time_column
from fjh.study.files import published


def test_different_recordings_have_different_identities():
    """The viewer merges recordings of one identity."""
    one = RecordingInfo("table1-W_a-seed0", "W_a", "notes", {"seed": 0})
    assert one.identity == replace(one).identity
    assert one.identity != replace(one, notes="others").identity
    assert one.identity != replace(one, properties={"seed": 1}).identity
    assert re.fullmatch(r"[\w-]+", replace(one, recording_id="a/b c.d").identity)


def test_error_of_the_writer_leaves_no_file(tmp_path):
    """Three times with two values are only a warning, without data, unless in strict mode."""
    about = RecordingInfo("x", "x", "notes", {"seed": 0})
    nothing = screen(rrb.Horizontal(rrb.TextDocumentView(origin="notes")))
    with (
        pytest.raises(ValueError, match="length"),
        published(tmp_path, index="x.rrd") as staging,
        recording_file(staging / "x.rrd", about, nothing) as recording,
    ):
        log_series(recording, time_column(np.arange(3.0)), "x", ["a [1]"], np.zeros((2, 1)))
    assert list(tmp_path.iterdir()) == []
