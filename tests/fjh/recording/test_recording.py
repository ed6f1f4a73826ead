"""Recordings read back: entities, rows, values to the bit, notes, properties."""

import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rerun as rr
import rerun.blueprint as rrb
from rerun.chunk import RrdReader

from fjh.recording.file import (
    RecordingInfo,
    log_series,
    recording_file,
    screen,
    time_column,
)
from fjh.recording.read import read_run
from fjh.recording.view import Change
from fjh.rig.hexapod import paper
from fjh.study.errors import WrongInput
from fjh.study.files import published, write_arrays
from tests import rrd

SIGNALS = {
    "/task/desired": ("desired_rad", 1e6),
    "/task/true": ("true_rad", 1e6),
    "/task/measured": ("measured_rad", 1e6),
    "/actuators/input": ("strut_input_percent", 1.0),
    "/actuators/displacement": ("strut_displacement_m", 1e6),
    "/secondary/true": ("secondary", 1e6),
    "/secondary/estimated": ("secondary_estimated", 1e6),
}
EVERY = 5
"""Ticks a row: 200 Hz."""


@pytest.mark.parametrize("entity", SIGNALS)
def test_a_recording_holds_the_run_to_the_bit(table1_folder, runs, entity):
    field, factor = SIGNALS[entity]
    times, values = rrd.scalars(table1_folder / "W_e.rrd", entity)
    np.testing.assert_array_equal(values, factor * runs["W_e"][field][::EVERY])
    np.testing.assert_array_equal(times, np.arange(3200) * EVERY * 1_000_000)


def test_error_and_closure_residual_are_those_of_the_run(table1_folder, runs):
    run = runs["W_d"]
    _, error = rrd.scalars(table1_folder / "W_d.rrd", "/task/error")
    np.testing.assert_array_equal(error, 1e6 * (run["desired_rad"] - run["true_rad"])[::EVERY])
    _, closure = rrd.scalars(table1_folder / "W_d.rrd", "/closure/residual")
    np.testing.assert_array_equal(closure[:, 0], 1e9 * run["closure_residual_m"][::EVERY])


@pytest.mark.parametrize("entity", SIGNALS)
def test_every_line_has_a_name_with_its_unit(table1_folder, entity):
    names = rrd.static(table1_folder / "W_e.rrd", entity, "SeriesLines:names")
    assert all(name.endswith(("[urad]", "[um]", "[%]")) for name in names)
    _, values = rrd.scalars(table1_folder / "W_e.rrd", entity)
    assert values.shape[1] == len(names)


@pytest.mark.parametrize(
    ("entity", "field"),
    [("/plane/desired", "desired_rad"), ("/plane/reached", "true_rad")],
)
def test_the_spirals_grow_piece_by_piece(table1_folder, runs, entity, field):
    """A piece ends where the spot is at its time, and begins where the one before it ended."""
    times, pieces = rrd.rows(table1_folder / "W_e.rrd", entity, "LineStrips2D:strips")
    ends = np.array(pieces)[:, 0]
    assert ends.shape == (799, 2, 2)
    there = 1e6 * runs["W_e"][field][times // 1_000_000] * [1, -1]
    np.testing.assert_allclose(ends[:, 1], there, rtol=1e-6, atol=1e-5)
    np.testing.assert_array_equal(ends[1:, 0], ends[:-1, 1])


def test_every_column_has_a_small_recording_with_one_screen(table1, table1_folder):
    for column in table1["columns"]:
        path = table1_folder / column["recording"]
        assert path.stat().st_size < 3e6
        reader = RrdReader(path)
        own = rf"fjh-table1-{column['name']}-seed0-[0-9a-f]{{8}}"
        assert re.fullmatch(own, reader.recordings()[0].application_id)
        assert len(reader.blueprints()) == 1


def test_a_recording_says_what_was_run_what_came_out_and_what_the_paper_says(table1, table1_folder):
    for column in table1["columns"]:
        told = rrd.notes(table1_folder / column["recording"])
        alpha, beta = paper.TABLE_I_URAD[column["name"]]
        assert f"| paper | {alpha:.4f} | {beta:.4f} |" in told
        assert f"| here | {column['alpha_rms_urad']:.4f} | {column['beta_rms_urad']:.4f} |" in told
        assert f"seed {table1['seed']}, 16 s, analytic Jacobian" in told
        assert ("strut 1 locked" in told) == bool(column["locked"])
        peaks = ", ".join(f"{peak:.2f}" for peak in column["strut_input_peak_percent"])
        assert peaks in told


def test_a_recordings_properties_make_it_self_describing(table1, table1_folder):
    held = rrd.properties(table1_folder / "W_a.rrd")
    for name, value in table1["bench"].items():
        if value is None:
            assert name not in held
        else:
            assert np.all(np.equal(held[name], value)), name
    assert held["seed"] == table1["seed"]
    assert held["model_sha256"] == table1["model_sha256"]
    for name, version in table1["versions"].items():
        assert held[f"version_{name.replace('-', '_')}"] == version


def test_every_study_says_seed_versions_and_model_in_its_recordings(
    release_folder, recover_folder, systems_folder, jacobian_folder, goals_folder
):
    folders = (release_folder, recover_folder, systems_folder, jacobian_folder, goals_folder)
    for path in [path for folder in folders for path in folder.glob("*.rrd")]:
        held = rrd.properties(path)
        assert {"seed", "model_sha256", "version_mujoco", "version_rerun_sdk"} <= set(held), path
        assert "| parameter | value |" in rrd.notes(path)
        # Of a mechanism in up to ten conditions; the same flight scatters by 0.3 %.
        assert path.stat().st_size < (8e6 if path.parent == systems_folder else 3.1e6)


def test_the_viewers_own_check_finds_all_files_whole(
    table1_folder, release_folder, systems_folder, goals_folder
):
    rerun = shutil.which("rerun", path=str(Path(sys.executable).parent))
    folders = (table1_folder, release_folder, systems_folder, goals_folder)
    files = sorted(str(path) for folder in folders for path in folder.glob("*.rrd"))
    assert len(files) == 6 + 11 + 4 + 4
    done = subprocess.run([str(rerun), "rrd", "verify", *files], capture_output=True, check=False)
    assert done.returncode == 0, done.stderr


def test_a_run_comes_back_from_its_data_with_failures_and_parameters(
    table1, table1_folder, runs, recover_folder
):
    kept = read_run(table1_folder / "W_e.npz")
    np.testing.assert_array_equal(kept.view.arrays["true"], runs["W_e"]["true_rad"])
    assert kept.view.stated.incidents == [Change("strut1", "locked", 0.0)]
    assert (kept.view.stated.known, kept.view.stated.diagnoses) == ("corrected", [])
    assert kept.study == "table1"
    assert kept.parameters["detector_noise_m"] == table1["bench"]["detector_noise_m"]
    assert not read_run(table1_folder / "W_a.npz").view.failures
    found = read_run(recover_folder / "locked.npz").view
    (failure,) = found.failures
    diagnosis = found.diagnosis_of(failure)
    assert diagnosis is not None
    assert failure.time_s < diagnosis.time_s < failure.time_s + 0.3
    assert (diagnosis.actuator, diagnosis.kind) == ("strut1", "locked")
    rms_urad = 1e6 * np.sqrt((kept.view.error**2).mean(axis=0))
    assert f"| here | {rms_urad[0]:.4f}" in rrd.notes(table1_folder / "W_e.rrd")


def _spoil(path: Path, how: str, arrays: dict[str, np.ndarray]) -> None:
    """Write a run that is none, or not a whole one."""
    spoilt = dict(arrays)
    if how == "text":
        path.write_text("no data")
    elif how == "empty":
        path.write_bytes(b"")
    elif how == "pickled":
        np.savez(path, thing=np.array([{}], dtype=object))
    elif how == "flipped":
        write_arrays(path, spoilt)
        data = bytearray(path.read_bytes())
        data[len(data) // 2] ^= 0xFF
        path.write_bytes(bytes(data))
    else:
        if how == "short":
            spoilt["true_rad"] = spoilt["true_rad"][:-1]
        elif how == "nan":
            spoilt["true_rad"] = np.full_like(spoilt["true_rad"], np.nan)
        elif how == "one row":
            spoilt = {name: values[:1] for name, values in spoilt.items() if values.ndim}
        elif how == "other":
            spoilt = {"time_s": np.zeros(3)}
        write_arrays(path, spoilt)


@pytest.mark.parametrize(
    "how",
    ["nowhere", "text", "empty", "pickled", "flipped", "short", "nan", "one row", "other"],
)
def test_what_is_no_whole_run_is_refused_by_name(tmp_path, runs, how):
    path = tmp_path / "run.npz"
    if how != "nowhere":
        _spoil(path, how, runs["W_a"])
    with pytest.raises(WrongInput, match=r"run\.npz"):
        read_run(path)


def test_recordings_that_differ_are_two_to_the_viewer():
    """It merges those of one identity."""
    one = RecordingInfo("table1-W_a-seed0", "W_a", "notes", {"seed": 0})
    assert one.identity == replace(one).identity
    assert one.identity != replace(one, notes="others").identity
    assert one.identity != replace(one, properties={"seed": 1}).identity
    assert re.fullmatch(r"[\w-]+", replace(one, recording_id="a/b c.d").identity)


def _nothing() -> rrb.Blueprint:
    return screen(rrb.Horizontal(rrb.TextDocumentView(origin="notes")))


def test_what_the_writer_complains_of_is_an_error_and_leaves_nothing(tmp_path):
    """Strict mode: three times and two values would else be a warning, and no data."""
    about = RecordingInfo("x", "x", "notes", {"seed": 0})

    def write() -> None:
        with (
            published(tmp_path, index="x.rrd") as staging,
            recording_file(staging / "x.rrd", about, _nothing()) as recording,
        ):
            log_series(recording, time_column(np.arange(3.0)), "x", ["a [1]"], np.zeros((2, 1)))

    with pytest.raises(ValueError, match="length"):
        write()
    assert list(tmp_path.iterdir()) == []


def test_times_are_whole_nanoseconds():
    """Float seconds would be cut: 0.003 s is 2,999,999 ns then."""
    ticks = np.arange(16000)
    stamps = time_column(ticks * 1e-3).as_arrow_array().cast("int64").to_numpy()
    np.testing.assert_array_equal(stamps, ticks * 1_000_000)
    assert isinstance(time_column(ticks * 1e-3), rr.TimeColumn)
