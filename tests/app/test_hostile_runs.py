"""What `fjh review` reads was written by anybody: it is a run, or one sentence says why not."""

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from experiments.app.cli import main
from fjh.recording import read as read_module
from fjh.recording.read import read_run
from fjh.recording.review import check_stated
from fjh.rig.hexapod.columns import hexapod_arrays
from fjh.study.errors import WrongInput
from fjh.study.files import write_arrays
from tests.made import keep_made, made_run, made_view


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    folder = tmp_path_factory.mktemp("kept")
    keep_made(folder)
    return folder


@pytest.fixture
def folder(kept, tmp_path):
    """A folder with one sound run, to be spoilt."""
    return Path(shutil.copytree(kept, tmp_path / "runs"))


def spoil(folder: Path, **changed: np.ndarray) -> None:
    with np.load(folder / "made.npz") as arrays:
        write_arrays(folder / "made.npz", dict(arrays) | changed)


def refused(capfd, folder: Path) -> str:
    """The sentence with which review refuses a folder."""
    out = folder.with_name("new") / "review.rrd"
    assert main(["review", str(folder), "--out", str(out)]) == 2
    said = capfd.readouterr().err
    assert said.startswith("fjh: ")
    assert said.count("\n") == 1
    assert not out.parent.exists()
    return said


RUN = made_run()
ARRAYS = hexapod_arrays(RUN)


@pytest.mark.parametrize("signal", ARRAYS)
def test_every_signal_of_a_run_is_checked(tmp_path, signal):
    write_arrays(tmp_path / "run.npz", ARRAYS | {signal: ARRAYS[signal][:-1]})
    with pytest.raises(WrongInput, match=r"run\.npz is not a complete run: "):
        read_run(tmp_path / "run.npz")


@pytest.mark.parametrize(
    ("signal", "values", "said"),
    [
        ("strut_input_percent", RUN.inputs[:, :4], "shape (400, 6), got float64 of shape (400, 4)"),
        ("true_rad", RUN.true.T.copy(), "shape (400, 2), got float64 of shape (2, 400)"),
        ("secondary", np.full((400, 4), 1e300), "secondary must be at most 1e+06"),
        ("measured_rad", -1e7 * np.ones((400, 2)), "measured_rad must be at most 1e+06"),
        (
            "desired_rad",
            RUN.desired.astype(np.float32),
            "of shape (400, 2), got float32",
        ),
        (
            "desired_rad",
            RUN.desired.astype(complex),
            "of shape (400, 2), got complex128",
        ),
        ("closure_residual_m", np.full(400, np.inf), "must be at most 1e+06 everywhere"),
        ("time_s", RUN.time_s[::-1].copy(), "time_s must increase"),
        ("time_s", np.zeros(400), "time_s must increase"),
        ("time_s", RUN.time_s**2, "time_s must increase in equal steps"),
        ("time_s", np.array(0.0), "time_s must be float64"),
    ],
)
def test_arrays_that_are_no_run_are_refused(tmp_path, signal, values, said):
    write_arrays(path := tmp_path / "run.npz", ARRAYS | {signal: values})
    with pytest.raises(WrongInput, match=re.escape(said)) as refused:
        read_run(path)
    assert str(refused.value).startswith(f"{path} is not a complete run: ")


def test_review_refuses_arrays_that_are_no_run(capfd, folder):
    spoil(folder, strut_input_percent=RUN.inputs[:, :4])
    assert f"{folder / 'made.npz'} is not a complete run: strut_input" in refused(capfd, folder)


def test_a_broken_run_of_a_folder_is_not_passed_over(capfd, folder):
    shutil.copy(folder / "made.npz", folder / "other.npz")
    (folder / "made.npz").write_bytes(b"PK")
    assert "made.npz is not a readable .npz file" in refused(capfd, folder)


def test_a_recording_of_another_run_is_noticed(capfd, folder):
    """Its marks and parameters would be told of this one."""
    spoil(folder, true_rad=RUN.true + 1e-12)
    assert "made.rrd is not the recording of made.npz" in refused(capfd, folder)


@pytest.mark.parametrize("stated", ["", "[]", "3", '{"robot": "arm"}'])
def test_a_recording_of_an_earlier_version_is_one_sentence(folder, monkeypatch, stated):
    found = [{"flight": stated, "marks": "[]"}, {}]
    monkeypatch.setattr(read_module, "groups_of", lambda path: found)
    with pytest.raises(WrongInput, match=r"made\.rrd was recorded by an earlier version"):
        read_run(folder / "made.npz")


def index(folder: Path, **told: object) -> None:
    """An index beside the run that tells this of it."""
    entry = {"name": "made", "data": "made.npz", **told}
    (folder / "made.json").write_text(json.dumps({"columns": [{"data": "other.npz"}, entry]}))


def test_json_that_agrees_with_the_data_is_accepted(folder):
    alpha, beta = 1e6 * RUN.rms()
    index(folder, alpha_rms_urad=alpha, beta_rms_urad=beta, paper_alpha_rms_urad=2.4)
    assert main(["review", str(folder), "--out", str(folder.parent / "review.rrd")]) == 0


@pytest.mark.parametrize("alpha", [0.0, 1e300, -1.0, float("nan"), None, "1", [1.0]])
def test_json_that_contradicts_the_data_is_noticed(alpha):
    told = {"made.json": {"runs": [{"data": "made.npz", "alpha_rms_urad": alpha}]}}
    ours = f"{1e6 * RUN.rms()[0]:.10g}"
    said = re.escape(f"made.json says alpha_rms_urad = {alpha} of made.npz, whose data give {ours}")
    with pytest.raises(WrongInput, match=said):
        check_stated("made.npz", made_view(), told)


@pytest.mark.parametrize("place", [".", "made.npz"])
def test_review_notices_json_that_contradicts_the_data(capfd, folder, place):
    index(folder, closure_residual_max_m=1e-12)
    assert "made.json says closure_residual_max_m = 1e-12" in refused(capfd, folder / place)


def test_json_that_is_none_is_refused_by_name(capfd, folder):
    (folder / "made.json").write_text('{"columns": ')
    assert f"{folder / 'made.json'} is not readable JSON" in refused(capfd, folder)


@pytest.mark.parametrize("machine", ["nowhere.xml", "empty.xml"])
def test_a_machine_that_cannot_be_drawn_is_one_sentence(capfd, folder, machine):
    (folder / "empty.xml").write_text("<mujoco/>")
    out = folder.parent / "review.rrd"
    words = ["review", str(folder), "--model", str(folder / machine), "--out", str(out)]
    assert main(words) == 2
    said = capfd.readouterr().err
    assert said.startswith("fjh: ")
    assert said.count("\n") == 1
