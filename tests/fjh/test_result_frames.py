"""Results of studies as frames."""

from pathlib import Path

import pandas as pd
import pytest

from fjh.result_frames import results
from fjh.study.errors import WrongInput
from fjh.study.result import Check, Result
from tests.made import keep_made

DATA = Path(__file__).parents[2] / "docs" / "data"


def test_runs_checks_and_files_of_every_folder_are_frames():
    """The first question of docs/find.md, on the published rows."""
    found = results(DATA)
    late = found.runs.query("named_s > 0.1 and kind == 'locked' and mismatch == 'all'")
    assert len(late) and set(late.study) == {"recover"}
    assert {"study", "folder"} <= set(found.files)
    with pytest.raises(WrongInput, match="no results of a study"):
        results("nowhere")


def test_a_folder_of_recordings_alone_is_a_row_for_each(tmp_path):
    for name in ("one", "two"):
        keep_made(tmp_path, name)
    found = results(tmp_path)
    assert list(found.runs.recording) == ["one", "two"] and set(found.runs.study) == {"made"}
    assert list(found.runs)[:2] == list(found.files)[:2] == ["study", "folder"]


def test_a_study_of_tables_gives_its_first_and_its_checks(tmp_path):
    spirals, arm = pd.DataFrame({"name": ["a", "b"]}), pd.DataFrame({"name": ["c"]})
    checks = [Check("gap [m]", "a", 1e-9, 1e-8), Check("gap [m]", "b", 1e-7, 1e-8)]
    Result({"seed": 0}, {"spirals": spirals, "arm": arm}, checks).publish("limits", tmp_path)
    found = results(tmp_path)
    assert list(found.runs.name) == ["a", "b"]
    assert found.checks.passed.tolist() == [True, False]
    assert {".json", ".parquet"} <= set(found.files.kind)
