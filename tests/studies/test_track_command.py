"""`fjh track` as a command: what it writes, and what it refuses in one sentence."""

import io
import json
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from experiments.app.cli import main
from fjh.rig.options import RobotOptions
from fjh.rig.paths import path_of
from fjh.study.errors import WrongInput
from tests.conftest import fjh
from tests.studies.test_track import ARM, panda

KEYS = {
    *("experiment", "seed", "versions", "model_sha256", "robot", "actuators", "bodies", "major"),
    *("units", "duration_s", "control_period_s", "path_size", "sensor_noise", "encoder_noise"),
    *("failures", "events", "diagnosis", "dither", "controller", "feedforward", "warnings"),
    *("rms_before", "rms_after", "rms_after_without_diagnosis", "predicted_rms_before"),
    *("predicted_rms_after", "predicted_rms_after_when_named", "prediction_off_before"),
    *("prediction_off_after", "measured_over_predicted_before", "measured_over_predicted_after"),
    *("possible_after", "diagnoses", "advice", "status", "task_lost", "lost", "limited_by"),
    *("left_out", "dry_friction", "met", "uncompared", "controller_failure"),
    *("closure_residual_max_m", "verdict", "settings", "rows", "checks", "files"),
}
IN_UNITS = {
    *("path_size", "sensor_noise", "encoder_noise", "rms_before", "rms_after"),
    *("predicted_rms_before", "predicted_rms_after", "predicted_rms_after_when_named"),
    "rms_after_without_diagnosis",
}
"""Which are there once more with each of their units in the name."""


@pytest.mark.long
def test_the_command_writes_what_the_interface_says(made_once):
    words = ("--major", "0,1", "--crossover", "0.7", "--duration", "0.4", "--turn", "1")
    folder = made_once(
        "track_of_the_arm", fjh("track", str(ARM), *words, "--fail", "joint2:locked@0.3")
    )
    summary = json.loads((folder / "track.json").read_text())
    named = {f"{key}_{unit}" for key in IN_UNITS for unit in ("rad", "m")} & set(summary)
    assert set(summary) - named == KEYS
    assert {key.rpartition("_")[0] for key in named} == IN_UNITS
    assert summary["experiment"] == "track" and summary["major"] == [0, 1]
    assert summary["actuators"] == [f"motor{k}" for k in range(1, 8)]
    assert summary["failures"] == [{"actuator": "motor2", "kind": "locked", "time_s": 0.3}]
    for key in ("rms_before", "rms_after", "predicted_rms_before", "predicted_rms_after"):
        assert summary[key] == [row[key] for row in summary["rows"]]
        assert len(summary[key]) == 2 and np.isfinite(summary[key]).all()
    for found in summary["diagnoses"]:
        assert {"actuator", "kind", "delay_s"} <= set(found)
    assert summary["closure_residual_max_m"] == 0.0
    assert summary["verdict"].endswith(".") and ". " not in summary["verdict"]
    assert {path.name for path in folder.iterdir()} == {"track.json", *summary["files"]}
    assert {"track.npz", "track.rrd", "track.png"} <= set(summary["files"])
    with np.load(folder / "track.npz") as arrays:
        error = (arrays["desired"] - arrays["true"])[arrays["time_s"] < 0.3 - 1e-9]
        assert arrays["displacement"].shape == (400, 7)
    np.testing.assert_allclose(np.sqrt((error**2).mean(axis=0)), summary["rms_before"], rtol=1e-12)


NOT_FAILURES = ("--fail joint2:tired@0.1", "--fail joint2:locked")
ASKED = {
    "--fail joint22:locked@0.1": 'did you mean "joint2"',
    NOT_FAILURES[0]: "KIND one of locked, free",
    NOT_FAILURES[1]: "NAME:KIND@SECONDS",
    "--fail joint2:locked@9": "--fail must be before the run ends at",
    "--fail joint2:locked@0.1 --fail joint2:free@0.2": "each actuator once",
    "--fail motor2:free@0.2 --event bump_then_lock:joint2@0.1": "--fail and --event must name each",
    "--major 0,6": "major must be different rows from 0 to 5",
    "--major 1,1": "major must be different rows",
    "--major=": "--major is empty",
    "--major x,w": "major must be different rows",
    "--major x,3": "major must be different rows",
    "--joint-weight 1,2": "joint_weight must be one number or 7",
    "--joint-weight heavy": "numbers with commas",
    "--secondary-weight -1": "must be from 0 to 1e+12",
    "--joint-weight nan": "must be from 0 to 1e+12",
    "--keyframe home": 'no keyframe "home"; it has none',
    "--path square": "spiral, circle, steps or FILE.npz",
    "--path absent.npz": "there is no file 'absent.npz'",
    "--duration 0": "duration must be a number from 1e-06 to 10000, got 0",
    "--size inf": "size must be a number from 1e-12 to 1000, got inf",
    "--period nan": "period must be a number from 1e-07 to 1, got nan",
    "--site tip": 'site: the model has no site or body "tip"',
    "--site payload\0x": 'site: the model has no site or body "payload',
    "--site \udcff": "site: the model has no site or body",
    "--dither often": "dither must be none, default",
    "--dither 0.1": "a frequency from 2 to 62.5 Hz, got 0.1",
    "--dither 10 --diagnosis off": "which is off",
    "--size 9": "the path is out of reach",
}


def refused(capfd: pytest.CaptureFixture[str], out: Path, *words: str) -> str:
    """The sentence with which the command refuses; it leaves nothing behind."""
    assert main(["track", *words, "--out", str(out)]) == 2
    said = capfd.readouterr().err
    assert said.startswith("fjh: ") and said.count("\n") == 1, said
    assert not out.exists()
    return said


@pytest.mark.parametrize("words", ASKED)
def test_what_cannot_be_done_is_refused_in_one_sentence(words, capfd, tmp_path):
    usual = (str(ARM), "--crossover", "0.7", "--duration", "0.4")
    assert ASKED[words] in refused(capfd, tmp_path / "out", *usual, *words.split())


@pytest.mark.parametrize("model", [[str(ARM)], []])
@pytest.mark.parametrize("words", NOT_FAILURES)
def test_a_text_that_is_no_failure_is_refused_before_a_file_is_read(
    words, model, monkeypatch, capfd
):
    def read(*_: Any) -> None:
        raise AssertionError("a model was read")

    monkeypatch.setattr(mujoco.MjSpec, "from_file", read)
    assert main(["track", *model, *words.split()]) == 2
    assert "--fail" in capfd.readouterr().err


OF_A_FILE = {
    **{"site": "stem1", "axes": "base", "major": "3,4", "noise": "1e-6", "crossover": "5"},
    **{"period": "0.002", "joint-weight": "2", "secondary-weight": "1", "pinned": "payload"},
    **{"limits": "none", "keyframe": "0", "servo": "20", "sense": "task"},
}


@pytest.mark.parametrize("name", OF_A_FILE)
def test_the_hexapod_refuses_an_option_that_would_do_nothing(name, capfd, tmp_path):
    said = refused(capfd, tmp_path / "out", f"--{name}", OF_A_FILE[name])
    assert said.startswith(f"fjh: --{name} needs a MODEL.xml")


def test_every_option_of_a_robot_is_the_hexapods_too_or_refused():
    refused_names = {name.replace("-", "_") for name in OF_A_FILE}
    assert {each.name for each in fields(RobotOptions)} == refused_names | {"size", "feedforward"}


def test_a_path_beyond_the_stated_ranges_names_the_actuators_at_their_limits(capfd, tmp_path):
    words = "--site hand --major 1,3,5 --crossover 0.5 --size 0.05 --turn 8"
    file = str(panda(tmp_path, "0.0002"))
    said = refused(capfd, tmp_path / "out", file, *words.split())
    assert "the path is out of reach at" in said and "smaller size" in said
    assert "with actuator2 at a limit" in said


def one_array() -> bytes:
    """A file of NumPy's that is no archive."""
    buffer = io.BytesIO()
    np.save(buffer, np.zeros(3))
    return buffer.getvalue()


BROKEN: dict[str, Callable[[Path], object]] = {
    "no desired": lambda file: np.savez(file, time_s=np.arange(3.0)),
    "another number of rows": lambda file: np.savez(
        file, time_s=np.arange(3.0), desired=np.zeros((3, 3))
    ),
    "descending": lambda file: np.savez(file, time_s=-np.arange(3.0), desired=np.zeros((3, 2))),
    "not finite": lambda file: np.savez(file, time_s=np.arange(3.0), desired=np.full((3, 2), 1j)),
    "empty": lambda file: np.savez(file, time_s=np.zeros(0), desired=np.zeros((0, 2))),
    "one array": lambda file: file.write_bytes(one_array()),
    "pickled": lambda file: np.savez(file, time_s=np.array([{}]), desired=np.zeros((1, 2))),
    "nothing at all": lambda file: file.write_bytes(b""),
    "cut off": lambda file: file.write_bytes(b"PK\x03\x04 and no more"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_file_that_holds_no_path_is_refused(name, tmp_path):
    file = tmp_path / "path.npz"
    BROKEN[name](file)
    with pytest.raises(WrongInput, match=r"path\.npz") as said:
        path_of(str(file), 2, 1.0, np.arange(5) * 0.1, 1.0, 0.1)
    assert "\n" not in str(said.value)
