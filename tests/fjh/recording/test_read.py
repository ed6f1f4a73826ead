"""A run read back is valid or rejected in one sentence; missing files: test_broken_files.py."""

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from fjh.recording import read as reading
from fjh.recording.read import read_run
from fjh.recording.view import PUBLISHED, view_of
from fjh.rig.hexapod.columns import hexapod_arrays
from fjh.study.errors import WrongInput
from fjh.study.files import write_arrays
from tests.synthetic import synthetic_run


def test_run_read_back_has_the_same_view(recorded):
    file, rig, run = recorded
    read, view = read_run(file.with_suffix(".npz")).view, view_of(rig, run)
    assert (read.stated, read.factor) == (view.stated, view.factor)
    for name, values in view.arrays.items():
        np.testing.assert_array_equal(read.arrays[name], values)
    displacements, qpos = (run.arrays[name][[0, 299]] for name in ("task", "qpos"))
    restored, other = (each.motion(displacements, qpos, 3.0) for each in (read, view))
    np.testing.assert_array_equal(restored.position_m, other.position_m)


SHAPE = "must be float64 of shape"


@pytest.mark.parametrize(
    ("signal", "spoil", "message"),
    [
        *((signal, lambda values: values[:-1], SHAPE) for signal in PUBLISHED.values()),
        ("strut_input_percent", lambda values: values[:, :4], "(400, 6), got float64"),
        ("true_rad", lambda values: values * np.nan, "true_rad must be at most 1e+06"),
        ("secondary", lambda values: values + 1e300, "secondary must be at most 1e+06"),
        ("desired_rad", lambda values: values.astype(complex), "(400, 2), got complex128"),
        ("time_s", lambda values: 0 * values, "time_s must increase"),
        ("time_s", lambda values: values**2, "time_s must increase in equal steps"),
        ("time_s", lambda values: values[3], "time_s must be float64"),
        ("", lambda values: values[:1], "two ticks at least"),
    ],
)
def test_invalid_arrays_are_rejected(tmp_path, signal, spoil, message):
    arrays = hexapod_arrays(synthetic_run())
    wrong = {name: spoil(values) for name, values in arrays.items() if signal in ("", name)}
    write_arrays(path := tmp_path / "run.npz", arrays | wrong)
    with pytest.raises(WrongInput, match=re.escape(message)) as error:
        read_run(path)
    assert str(error.value).startswith(f"{path} is not a complete run: ")


@pytest.mark.parametrize(
    "wrong",
    [
        {"actuators": None},
        {"actuators": ["motor1", "motor2"]},
        {"hexapod": True},
        {"bodies": [["elsewhere"]] * 7},
        {"rows": ["x"]},
        {"major": [3, 9]},
        {"row_units": ["m"]},
        {"limits": [[None], [None]]},
        {"input_units": []},
        {"incidents": [{"actuator": "z", "kind": "locked", "time_s": 0.1}]},
        {"incidents": [{"actuator": "motor1", "kind": "locked", "time_s": -1.0}]},
        {"diagnoses": [{"actuator": "motor1", "kind": "locked", "time_s": float("nan")}]},
    ],
)
def test_statement_of_a_recording_is_checked(recorded, monkeypatch, wrong):
    properties, results = reading.groups_of(recorded.file)
    stated = json.dumps(json.loads(properties["flight"]) | wrong)
    monkeypatch.setattr(reading, "groups_of", lambda _: [{"flight": stated}, results])
    with pytest.raises(WrongInput, match=r"run\.npz and run\.rrd are not a run: [^\n]*$"):
        read_run(recorded.file.with_suffix(".npz"))


@pytest.mark.parametrize("stated", ["", "[]", "3", '{"robot": "arm"}'])
def test_recording_of_an_earlier_version_is_rejected_in_one_sentence(made, monkeypatch, stated):
    properties = [{"flight": stated, "marks": "[]"}, {}]
    monkeypatch.setattr(reading, "groups_of", lambda path: properties)
    with pytest.raises(WrongInput, match=r"made\.rrd is of another version"):
        read_run(made / "made.npz")


def test_run_of_a_robot_without_recording_is_rejected_in_one_sentence(recorded, tmp_path):
    shutil.copy(recorded.file.with_suffix(".npz"), tmp_path)
    with pytest.raises(WrongInput, match=r"run\.npz cannot be read without run\.rrd[^\n]*$"):
        read_run(tmp_path / "run.npz")


@pytest.mark.parametrize("robot", ["hexapod", "arm"])
def test_recording_of_another_run_is_rejected(recorded, made, tmp_path, robot):
    """The marks and parameters of the recording would not belong to the data."""
    file, name = (made / "made.rrd", "true_rad") if robot == "hexapod" else (recorded.file, "true")
    with np.load(file.with_suffix(".npz")) as arrays:
        changed = dict(arrays) | {name: arrays[name] + 1e-12}
    write_arrays(tmp_path / f"{file.stem}.npz", changed)
    shutil.copy(file, tmp_path)
    with pytest.raises(WrongInput, match=f"{file.name} is not the recording of {file.stem}.npz"):
        read_run(tmp_path / f"{file.stem}.npz")


def test_machine_file_can_be_moved(recorded, tmp_path):
    for suffix in (".npz", ".rrd"):
        shutil.copy(recorded.file.with_suffix(suffix), tmp_path)
    assert recorded.rig.file is not None
    machine = Path(recorded.rig.file)
    moved = machine.rename(tmp_path / "elsewhere.xml")
    try:
        other = machine.parent / "other.xml"
        other.write_text(moved.read_text() + "\n")
        for model in (None, other):
            with pytest.raises(WrongInput, match=r"run of another machine.* --model FILE"):
                read_run(tmp_path / "run.npz", model)
        assert len(read_run(tmp_path / "run.npz", moved).view.time_s) == 300
    finally:
        moved.rename(machine)
