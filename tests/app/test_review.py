"""Runs side by side: every column of Table I, and any other set."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from experiments.app.cli import main
from fjh.recording.review import names_of
from sim import HEXAPOD_MJCF
from tests import rrd
from tests.conftest import fjh
from tests.fjh.recording.test_recording import SIGNALS

EVERY = 5
"""Ticks a row: 200 Hz."""


@pytest.fixture(scope="module")
def review(table1_folder, tmp_path_factory):
    """All columns of Table I, made by the command."""
    path = tmp_path_factory.mktemp("review") / "review.rrd"
    assert main(["review", str(table1_folder), "--out", str(path)]) == 0
    return path


def test_all_columns_stand_in_the_tables_order(review, table1):
    told = rrd.notes(review)
    places = [told.index(f"\n| {column['name']} |") for column in table1["columns"]]
    assert places == sorted(places)
    assert sum(e.endswith("task/error") for e in rrd.entities(review)) == 6


def test_every_column_is_its_run_to_the_bit(review, table1, runs):
    for k, column in enumerate(table1["columns"]):
        for entity in ("/task/true", "/actuators/input", "/secondary/true"):
            field, factor = SIGNALS[entity]
            times, values = rrd.scalars(review, f"/run_{k}{entity}")
            np.testing.assert_array_equal(values, factor * runs[column["name"]][field][::EVERY])
            np.testing.assert_array_equal(times, np.arange(3200) * EVERY * 1_000_000)


def test_the_plane_of_each_run_has_its_error_on_the_errors_own_scale(review, table1, runs):
    """Desired minus true, image axes down; the label states the RMS of the JSON file."""
    for k, column in enumerate(table1["columns"]):
        run, plane = runs[column["name"]], f"/run_{k}/plane"
        times, pieces = rrd.rows(review, f"{plane}/reached", "LineStrips2D:strips")
        error_urad = 1e6 * (run["desired_rad"] - run["true_rad"])[times // 1_000_000]
        np.testing.assert_allclose(np.array(pieces)[:, 0, 1], error_urad * [1, -1], atol=1e-5)
        (label,) = rrd.static(review, f"{plane}/scale", "Points2D:labels")
        rms = "RMS alpha {alpha_rms_urad:.3g} µrad, beta {beta_rms_urad:.3g} µrad".format(**column)
        assert rms in label
    assert not any(entity.endswith("/path/desired") for entity in rrd.entities(review))


def test_what_the_runs_have_in_common_are_the_recordings_properties(review, table1):
    held = rrd.properties(review)
    assert held["seed"] == table1["seed"]
    assert held["detector_noise_m"] == table1["bench"]["detector_noise_m"]


def test_the_failed_struts_of_each_run_are_marked(review, table1):
    worn = {e.split("/")[1] for e in rrd.entities(review) if e.endswith("/failure_0/text")}
    locked = {f"run_{k}" for k, column in enumerate(table1["columns"]) if column["locked"]}
    assert worn == locked


def test_single_runs_of_several_folders(table1_folder, recover_folder, tmp_path):
    files = [table1_folder / "W_a.npz", recover_folder / "locked.npz", table1_folder / "W_e.npz"]
    out = tmp_path / "three.rrd"
    assert main(["review", *map(str, files), "--out", str(out)]) == 0
    told = rrd.notes(out)
    assert [told.index(f"| {file.stem} |") for file in files] == sorted(
        told.index(f"| {file.stem} |") for file in files
    )


@pytest.mark.long
def test_the_review_of_a_tracked_run_has_its_numbers_and_the_name_of_its_robot(made_once, tmp_path):
    """Digit by digit those of the table that `fjh track` prints, before and after the failure."""
    words = ("--major", "0,1", "--crossover", "0.7", "--duration", "0.4", "--turn", "1")
    arm, fails = str(HEXAPOD_MJCF.with_name("arm.xml")), ("--fail", "joint2:locked@0.3")
    folder = made_once("track_of_the_arm", fjh("track", arm, *words, *fails))
    out = tmp_path / "review.rrd"
    assert main(["review", str(folder), "--out", str(out)]) == 0
    [row] = [line for line in rrd.notes(out).splitlines() if "turn x" in line]
    assert row.startswith("| track | redundant serial arm, pointing | ")
    printed = (folder / "track.md").read_text().splitlines()
    for name in ("turn x", "turn y"):
        [(before, _, after)] = [line.split(" | ")[1:4] for line in printed if f"| {name} |" in line]
        assert f"{name} {before}" in row.split(";")[0] and f"{name} {after}" in row.split(";")[1]


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


@pytest.mark.parametrize("place", ["nowhere", "empty", "other.npz", "twice"])
def test_what_holds_no_run_is_one_sentence(capsys, tmp_path, table1_folder, place):
    (tmp_path / "empty").mkdir()
    np.savez(tmp_path / "other.npz", time_s=np.zeros(3))
    here = str(tmp_path / place)
    files = [str(table1_folder / "W_a.npz")] * 2 if place == "twice" else [here]
    assert main(["review", *files, "--out", str(tmp_path / "out" / "review.rrd")]) == 2
    said = capsys.readouterr().err
    assert said.startswith("fjh: ")
    assert said.count("\n") == 1
    assert ("W_a.npz" if place == "twice" else here) in said
    assert not (tmp_path / "out").exists()


def test_runs_of_another_machine_are_not_drawn_as_the_hexapod(capsys, tmp_path, table1_folder):
    """Told by the recording beside the data."""
    longer = tmp_path / "longer.xml"
    longer.write_text(HEXAPOD_MJCF.read_text().replace("</mujoco>", "</mujoco> "))
    run = [str(table1_folder / "W_a.npz"), "--model", str(longer)]
    assert main(["review", *run, "--out", str(tmp_path / "r.rrd")]) == 2
    assert "another machine" in capsys.readouterr().err
    assert not (tmp_path / "r.rrd").exists()


def test_data_without_a_recording_beside_it_is_a_run_that_says_nothing(tmp_path, table1_folder):
    shutil.copy(table1_folder / "W_a.npz", tmp_path / "bare.npz")
    out = tmp_path / "two.rrd"
    files = [str(tmp_path / "bare.npz"), str(table1_folder / "W_b.npz")]
    assert main(["review", *files, "--out", str(out)]) == 0
    assert "| bare |" in rrd.notes(out)
    (tmp_path / "bare.rrd").write_text("no recording")
    assert main(["review", *files, "--out", str(out)]) == 2


def test_what_runs_do_not_share_is_not_said_of_all(release, release_folder, tmp_path):
    """Strut 1 loses its spring in orbit only: gravity differs from run to run."""
    out = tmp_path / "release.rrd"
    assert main(["review", str(release_folder), "--out", str(out)]) == 0
    held = rrd.properties(out)
    assert "gravity_m_per_s2" not in held
    assert held["payload_mass_kg"] == release["bench"]["payload_mass_kg"]


def test_another_ending_is_refused(capsys, tmp_path, table1_folder):
    assert main(["review", str(table1_folder), "--out", str(tmp_path / "review.txt")]) == 2
    assert ".rrd" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
