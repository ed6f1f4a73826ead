"""Runs side by side: what each is, what they have in common, and what JSON says beside them."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from experiments.app.cli import main
from fjh.recording.review import check_stated, names_of
from fjh.study.errors import WrongInput
from sim import MODELS
from tests import rrd
from tests.conftest import fjh
from tests.fjh.recording.conftest import Kept
from tests.made import keep_made, made_run, made_view

EVERY = 5
"""Ticks a row: 200 Hz."""


@pytest.fixture(scope="module")
def places(kept: Kept, tmp_path_factory) -> list[str]:
    """A locked and a healthy run of the hexapod, and one of an arm: two folders and a file."""
    folders = [tmp_path_factory.mktemp(name) for name in ("one", "other")]
    keep_made(folders[0], "locked", gravity=0.0)
    keep_made(folders[1], "healthy", gravity=9.81, locked=False)
    return [*map(str, folders), str(kept.file.with_suffix(".npz"))]


@pytest.fixture(scope="module")
def review(places, tmp_path_factory) -> Path:
    """Of all of them, made by the command."""
    path = tmp_path_factory.mktemp("review") / "review.rrd"
    assert main(["review", *places, "--out", str(path)]) == 0
    return path


def test_every_run_is_itself_to_the_bit_in_the_order_given(review, kept):
    rows = rrd.notes(review).partition("| --- |")[2].splitlines()
    assert [row.split(" | ")[0] for row in rows[1:4]] == ["| locked", "| healthy", "| run"]
    for k, run in enumerate((made_run(), made_run(), kept.run)):
        times, error = rrd.scalars(review, f"/run_{k}/task/error")
        np.testing.assert_array_equal(error, 1e6 * (run.desired - run.true)[::EVERY])
        np.testing.assert_array_equal(times, np.rint(1e9 * run.time_s[::EVERY]))
    _, texts = rrd.rows(review, "/run_2/events", "TextLog:text")
    assert texts == [["run: motor2 locked"]]
    drawn = {"/run_0/machine/bodies/payload", "/run_2/machine/bodies/camera"}
    assert drawn <= rrd.entities(review)


def test_the_plane_of_each_run_has_its_error_on_the_errors_own_scale(review):
    """Desired minus true, image axes down; the label states the RMS error."""
    times, pieces = rrd.rows(review, "/run_0/plane/reached", "LineStrips2D:strips")
    run = made_run()
    error_urad = 1e6 * (run.desired - run.true)[times // 1_000_000]
    np.testing.assert_allclose(np.array(pieces)[:, 0, 1], error_urad * [1, -1], atol=1e-5)
    (label,) = rrd.static(review, "/run_0/plane/scale", "Points2D:labels")
    assert f"RMS alpha {1e6 * run.rms()[0]:.3g} µrad" in label


def test_marks_are_of_the_run_that_failed_and_properties_of_all(review, tmp_path, places):
    worn = {e.split("/")[1] for e in rrd.entities(review) if e.endswith("/failure_0/text")}
    assert worn == {"run_0", "run_2"}
    assert main(["review", *places[:2], "--out", str(tmp_path / "two.rrd")]) == 0
    held = rrd.properties(tmp_path / "two.rrd")
    assert held["seed"] == 0 and "gravity" not in held


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


def test_data_without_a_recording_beside_it_is_a_run_that_says_nothing(made, tmp_path):
    shutil.copy(made / "made.npz", tmp_path / "bare.npz")
    out, files = tmp_path / "two.rrd", [str(tmp_path / "bare.npz"), str(made)]
    assert main(["review", *files, "--out", str(out)]) == 0
    assert "| bare |" in rrd.notes(out)


# JSON beside a run.


@pytest.mark.parametrize("alpha", [0.0, 1e300, -1.0, float("nan"), None, "1", [1.0]])
def test_json_that_contradicts_the_data_is_noticed(alpha):
    told = {"made.json": {"runs": [{"data": "made.npz", "alpha_rms_urad": alpha}]}}
    with pytest.raises(WrongInput, match=r"made\.json says alpha_rms_urad = .* whose data give"):
        check_stated("made.npz", made_view(), told)


@pytest.mark.parametrize("place", [".", "made.npz"])
def test_review_compares_json_with_the_data(capfd, made, tmp_path, place):
    folder, out = Path(shutil.copytree(made, tmp_path / "runs")), tmp_path / "new" / "review.rrd"
    rms_urad = 1e6 * made_run().rms()[0]
    for stated, code in ((2 * rms_urad, 2), (rms_urad, 0)):
        rows = [{"data": "other.npz"}, {"data": "made.npz", "alpha_rms_urad": stated}]
        (folder / "made.json").write_text(json.dumps({"columns": rows}))
        assert main(["review", str(folder / place), "--out", str(out)]) == code
        assert ("made.json says alpha_rms_urad" in capfd.readouterr().err) == bool(code)
        assert out.exists() != bool(code)


# What the studies leave.


def test_all_columns_of_table_1_stand_in_its_order(table1, table1_folder, tmp_path):
    path = tmp_path / "review.rrd"
    assert main(["review", str(table1_folder), "--out", str(path)]) == 0
    notes = rrd.notes(path)
    places = [notes.index(f"\n| {column['name']} |") for column in table1["columns"]]
    assert places == sorted(places)
    held = rrd.properties(path)
    assert held["detector_noise_m"] == table1["bench"]["detector_noise_m"]


@pytest.mark.long
@pytest.mark.night
def test_the_review_of_a_tracked_run_has_the_numbers_of_its_table(made_once, tmp_path):
    """Digit by digit, before and after the failure."""
    words = ("--major", "0,1", "--crossover", "0.7", "--duration", "0.4", "--turn", "1")
    arm, fails = str(MODELS / "arm.xml"), ("--fail", "joint2:locked@0.3")
    folder = made_once("track_of_the_arm", fjh("track", arm, *words, *fails))
    out = tmp_path / "review.rrd"
    assert main(["review", str(folder), "--out", str(out)]) == 0
    [row] = [line for line in rrd.notes(out).splitlines() if "turn x" in line]
    assert row.startswith("| track | redundant serial arm, pointing | ")
    printed = (folder / "track.md").read_text().splitlines()
    for name in ("turn x", "turn y"):
        [(before, _, after)] = [line.split(" | ")[1:4] for line in printed if f"| {name} |" in line]
        assert f"{name} {before}" in row.split(";")[0] and f"{name} {after}" in row.split(";")[1]
