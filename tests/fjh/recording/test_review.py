"""Review of runs side by side: data, common properties, and consistency with JSON files."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from experiments.app.cli import main
from fjh.recording.review import check_stated, names_of
from fjh.study.errors import WrongInput
from tests import rrd
from tests.synthetic import synthetic_run, synthetic_view, write_synthetic_run


def test_reviewed_runs_equal_their_data_in_the_given_order(recorded, tmp_path):
    """Two folders with a locked and a healthy run of the hexapod, and a file of an arm."""
    places = [tmp_path / "one", tmp_path / "other", recorded.file.with_suffix(".npz")]
    for folder in places[:2]:
        folder.mkdir()
        write_synthetic_run(folder, locked=folder.name == "one")
    review = tmp_path / "review.rrd"
    assert main(["review", *map(str, places), "--out", str(review)]) == 0
    rows = rrd.notes(review).partition("| --- |")[2].splitlines()
    assert [row.split(" | ")[0] for row in rows[1:4]] == ["| one", "| other", "| new"]
    for k, run in enumerate((synthetic_run(), synthetic_run(), recorded.run)):
        times, error = rrd.scalars(review, f"/run_{k}/task/error")
        np.testing.assert_array_equal(error, 1e6 * (run.desired - run.true)[::5])  # 200 Hz
        np.testing.assert_array_equal(times, np.rint(1e9 * run.time_s[::5]))
    _, texts = rrd.rows(review, "/run_2/events", "TextLog:text")
    assert texts == [["new: motor2 locked"]]
    marked = {e.split("/")[1] for e in rrd.entities(review) if e.endswith("/failure_0/text")}
    assert marked == {"run_0", "run_2"}


@pytest.mark.parametrize(
    ("files", "names"),
    [
        (["a/W_a", "b/W_e"], ["W_a", "W_e"]),
        (["a/track", "b/track"], ["a", "b"]),
        (["a/W_a", "b/W_a", "b/W_e"], ["a/W_a", "b/W_a", "b/W_e"]),
        (["x/a/W_a", "y/a/W_a"], ["x/a/W_a", "y/a/W_a"]),
    ],
)
def test_names_of_runs_are_short_and_different(files, names):
    assert names_of([Path(f"{file}.npz") for file in files]) == names


def test_data_without_a_recording_can_be_reviewed(made, tmp_path):
    shutil.copy(made / "made.npz", tmp_path / "bare.npz")
    out, files = tmp_path / "two.rrd", [str(tmp_path / "bare.npz"), str(made)]
    assert main(["review", *files, "--out", str(out)]) == 0
    assert "| bare |" in rrd.notes(out)


@pytest.mark.parametrize("alpha", [0.0, 1e300, -1.0, float("nan"), None, "1", [1.0]])
def test_json_that_contradicts_the_data_is_rejected(alpha):
    content = {"made.json": {"runs": [{"data": "made.npz", "alpha_rms_urad": alpha}]}}
    with pytest.raises(WrongInput, match=r"made\.json states alpha_rms_urad = .* whose data give"):
        check_stated("made.npz", synthetic_view(), content)


@pytest.mark.parametrize("place", [".", "made.npz"])
def test_review_compares_json_with_the_data(capfd, made, tmp_path, place):
    folder, out = Path(shutil.copytree(made, tmp_path / "runs")), tmp_path / "new" / "review.rrd"
    rms_urad = 1e6 * synthetic_run().rms()[0]
    for stated, code in ((2 * rms_urad, 2), (rms_urad, 0)):
        rows = [{"data": "other.npz"}, {"data": "made.npz", "alpha_rms_urad": stated}]
        (folder / "made.json").write_text(json.dumps({"columns": rows}))
        assert main(["review", str(folder / place), "--out", str(out)]) == code
        assert ("made.json states alpha_rms_urad" in capfd.readouterr().err) == bool(code)
        assert out.exists() != bool(code)
