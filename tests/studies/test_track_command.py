"""`fjh track`: the loop on any mechanism goes as its linear model predicts, or is refused.

Paths here are a thousandth of the mechanism, so that the linear model holds.
"""

import io
import json
from collections.abc import Callable
from dataclasses import fields, replace
from functools import cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from experiments.app.cli import main
from experiments.rig import Rig
from experiments.rig.mjcf import robot_rig
from experiments.rig.options import RobotOptions
from experiments.rig.reach import learnt_s, uncompared
from experiments.rig.run import Diagnosed
from experiments.study.study import WrongInput
from experiments.track import STUDY
from experiments.track.results import AGREES, checks, notes, summarize
from experiments.track.runs import Tracked, run_track
from ftc.fdi.fault_model import Fault
from ftc.tracking import deciding_sentence, is_possible
from sim import HEXAPOD_MJCF, Failure
from tests.conftest import fjh
from tests.robots import PANDA

ARM, PLATFORM, HAND, ARMS = (
    HEXAPOD_MJCF.with_name(f"{name}.xml") for name in ("arm", "platform", "hand", "arms")
)
MAJOR = {ARM: "0,1", PLATFORM: "3,4", HAND: "3,4", ARMS: "3,4,5", None: "0,1"}
LOCKED = {ARM: "motor2", ARMS: "motor2", None: "strut1"}
KEYS = {
    *("experiment", "seed", "versions", "model_sha256", "robot", "actuators", "major", "units"),
    *(
        "duration_s",
        "control_period_s",
        "path_size",
        "sensor_noise",
        "encoder_noise",
        "loops",
        "failures",
    ),
    *("rms_before", "rms_after", "predicted_rms_before", "predicted_rms_after", "possible_after"),
    *("diagnoses", "dither", "task_lost", "closure_residual_max_m", "verdict", "files"),
    *("prediction_off_before", "prediction_off_after", "status", "warnings", "feedforward"),
    *("predicted_rms_after_when_named", "advice", "left_out"),
    *("measured_over_predicted_before", "measured_over_predicted_after", "dry_friction", "met"),
    *("limited_by", "bodies", "events", "rms_after_without_diagnosis", "lost"),
}
IN_UNITS = {
    *("path_size", "sensor_noise", "encoder_noise", "rms_before", "rms_after"),
    *("predicted_rms_before", "predicted_rms_after", "predicted_rms_after_when_named"),
    "rms_after_without_diagnosis",
}
"""Which are there once more with each of their units in the name."""


def tracked(model: Path | None, seed: int = 0, **options: Any) -> Tracked:
    """A run as the command makes it, without its files."""
    usual: dict[str, Any] = {option.name: option.default for option in STUDY.options}
    # A given crossover spares the search, as no dither does its design; little noise leaves what
    # the path itself costs.
    usual |= {"dither": "none", "turn": 2.0, "duration": 1.0, "major": MAJOR.get(model, "0,1")}
    usual |= {"model": model} | ({} if model is None else {"crossover": 0.7}) | options
    made = {each.name: usual.pop(each.name) for each in STUDY.options}
    for option in STUDY.options:
        value = made[option.name]
        if isinstance(value, list | tuple):
            made[option.name] = [option.checked(each, option.flag) for each in value]
        else:
            made[option.name] = option.checked(value, option.flag)
    return run_track(
        **{"seed": seed, "quick": False, "on_progress": lambda *_: None} | made | usual
    )


@cache
def tracking_rig(model: Path) -> Rig:
    return robot_rig(model, RobotOptions(crossover=0.7))


def ratios(summary: dict, part: str) -> np.ndarray:
    """RMS by that of the linear model, of the rows that the path moves."""
    measured, predicted = summary[f"rms_{part}"], summary[f"predicted_rms_{part}"]
    return np.array(measured[:2]) / predicted[:2]


MECHANISMS = [
    pytest.param(ARM, 2e-6, id="arm", marks=pytest.mark.long),
    pytest.param(PLATFORM, 2e-6, id="platform", marks=pytest.mark.long),
    pytest.param(HAND, 5e-7, id="hand", marks=pytest.mark.long),
    pytest.param(ARMS, 2e-6, id="arms", marks=pytest.mark.long),
    pytest.param(None, None, id="hexapod", marks=pytest.mark.long),
]


@pytest.mark.parametrize(("model", "noise"), MECHANISMS)
def test_without_a_failure_the_error_is_that_of_the_linear_model(model, noise):
    """A known path through a linear loop; noise is small, as one second averages little."""
    one = tracked(model, turn=1.0, noise=noise)
    summary = summarize(one)
    np.testing.assert_allclose(ratios(summary, "before"), 1.0, rtol=0.05)
    assert summary["rms_after"] is None
    assert summary["predicted_rms_after"] is None
    assert summary["failures"] == summary["possible_after"] == []
    assert one.run.closure_m.max() < 1e-8  # the demands brake for the end of the path


def test_a_failure_is_given_by_the_name_of_the_joint_or_of_its_actuator(sound):
    names = ("joint4", "motor4")
    assert [sound.rig.number(name) for name in names] == [3, 3]
    assert sound.rig.actuators[3] == "motor4"


FAILING = [
    pytest.param(ARM, id="arm", marks=pytest.mark.long),
    pytest.param(ARMS, id="arms", marks=(pytest.mark.long, pytest.mark.night)),
    pytest.param(None, id="hexapod", marks=pytest.mark.long),
]


@pytest.mark.parametrize("model", FAILING)
def test_a_lock_is_named_and_the_error_is_that_of_a_controller_that_learns_of_it_then(model):
    """By the dither within 0.2 s of any robot; the delay costs what the lock does meanwhile."""
    strut = LOCKED[model]
    one = tracked(model, dither="default", duration=2.0, fail=[f"{strut}:locked@0.8"])
    summary = summarize(one)
    named = [(each["actuator"], each["kind"]) for each in summary["diagnoses"]]
    assert named == [(strut, "locked")]
    assert 0 <= summary["diagnoses"][0]["delay_s"] < 0.2
    assert summary["possible_after"] == [True]
    assert not summary["task_lost"]
    assert summary["prediction_off_after"] < 0.1
    broken = one.rig.actuators.index(strut)
    after = one.run.displacement[one.run.time_s >= 0.802, broken]
    assert np.ptp(after) < 1e-3 * one.rig.size


@pytest.mark.long
@pytest.mark.parametrize(
    ("model", "sense"), [(PLATFORM, "task"), (PLATFORM, "both"), (None, "both")]
)
def test_with_a_designed_dither_a_lock_is_named_at_once(model, sense):
    """Without one the platform's was never named, and the hexapod's after 0.9 s."""
    actuator = "motor1" if model else "strut1"
    how = {"dither": "designed", "sense": sense, "duration": 2.0, "crossover": None}
    summary = summarize(tracked(model, fail=[f"{actuator}:locked@1"], **how))
    named = [(each["actuator"], each["kind"]) for each in summary["diagnoses"]]
    assert named == [(actuator, "locked")]
    assert 0 <= summary["diagnoses"][0]["delay_s"] < 0.15
    assert len(summary["dither"]["isolable"]) >= 2 * len(summary["actuators"])


def test_a_dither_for_which_the_task_leaves_no_motion_is_refused():
    with pytest.raises(WrongInput, match="the major task leaves no motion for a dither"):
        tracked(PLATFORM, major="2,3,4", dither="designed")


@pytest.mark.long
def test_both_sensors_and_a_dither_are_published_with_what_they_cost():
    """The error before is that of the linear model and of the dither, which nothing else moves."""
    one = tracked(ARM, sense="both", dither="10", noise=2e-6, turn=1e6, path="steps", duration=0.6)
    summary = summarize(one)
    dither = summary["dither"]
    assert dither["frequency_hz"] == 10.0
    assert one.rig.watched.noise.shape == (9,)
    cost = np.array(dither["task_motion"]) / np.sqrt(2)
    still = one.rig.predict(one.run.desired).rms_before
    for found in (summary["rms_before"], summary["predicted_rms_before"]):
        np.testing.assert_allclose(found, np.hypot(cost, still), rtol=0.15)
    assert (cost > 2 * still).all()
    assert "Dither of 10 Hz" in " ".join(notes(one, summary))


@pytest.fixture(scope="module")
def sound() -> Tracked:
    return tracked(ARM, duration=0.4)


@pytest.mark.long
def test_the_same_seed_is_the_same_run(sound):
    again = tracked(ARM, duration=0.4, seed=0)
    for name, values in sound.run.arrays.items():
        np.testing.assert_array_equal(values, again.run.arrays[name])


@pytest.mark.long
def test_another_seed_is_other_noise_and_nothing_else(sound):
    other = tracked(ARM, duration=0.4, seed=1)
    np.testing.assert_array_equal(sound.run.desired, other.run.desired)
    one, two = (each.rig.predict(each.run.desired).rms_before for each in (sound, other))
    np.testing.assert_array_equal(one, two)
    noise = [each.run.measured - each.run.true for each in (sound, other)]
    assert np.abs(noise[0] - noise[1]).max() > 0
    np.testing.assert_allclose([each.std() for each in noise], sound.rig.noise, rtol=0.1)


def test_forward_kinematics_reads_the_task_as_well_as_the_encoders_allow():
    """To first order the noise of the task is that of the encoders through the Jacobian."""
    one = tracked(ARM, duration=0.4, sense="joints", noise=1e-6, diagnosis="off")
    noise = one.run.measured - one.run.true
    np.testing.assert_allclose(noise.std(axis=0), one.rig.nominal.noise, rtol=0.1)
    np.testing.assert_allclose(noise.mean(axis=0), 0.0, atol=4e-6 / np.sqrt(len(noise)))


def test_a_path_from_a_file_is_followed_as_it_stands(tmp_path):
    """Between its samples linear, after the last one at rest."""
    file = tmp_path / "path.npz"
    times, desired = np.array([0.0, 0.1, 0.2]), np.array([[0, 0], [1e-4, 0], [1e-4, -2e-4]])
    np.savez(file, time_s=times, desired=desired)
    run = tracked(ARM, duration=0.4, path=str(file), diagnosis="off").run
    np.testing.assert_allclose(run.desired[50], [5e-5, 0.0], atol=1e-18)
    np.testing.assert_allclose(run.desired[300], desired[-1], atol=1e-18)


def test_steps_go_out_and_back_along_one_row_after_the_other():
    run = tracked(ARM, duration=0.4, turn=0.4, path="steps", diagnosis="off").run
    size = run.desired.max()
    for tick, at in ((40, (0, 0)), (120, (1, 0)), (240, (0, 0)), (360, (0, 1))):
        np.testing.assert_array_equal(run.desired[tick], size * np.array(at))


def test_a_spiral_grows_to_its_size_at_the_end(sound):
    run = tracked(ARM, duration=0.4, turn=0.1, path="spiral", diagnosis="off").run
    radius = np.linalg.norm(run.desired, axis=1)
    assert radius[0] == 0.0
    assert (np.diff(radius) > 0).all()
    assert radius[-1] == pytest.approx(sound.rig.size, rel=0.01)


@pytest.mark.long
def test_the_command_writes_what_the_interface_says(made_once):
    words = ("--major", "0,1", "--crossover", "0.7", "--duration", "0.4", "--turn", "1")
    folder = made_once(
        "track_of_the_arm", fjh("track", str(ARM), *words, "--fail", "joint2:locked@0.3")
    )
    summary = json.loads((folder / "track.json").read_text())
    assert summary["experiment"] == "track"
    named = {f"{key}_{unit}" for key in IN_UNITS for unit in ("rad", "m")} & set(summary)
    assert set(summary) - named == KEYS
    assert {key.rpartition("_")[0] for key in named} == IN_UNITS
    assert summary["actuators"] == [f"motor{k}" for k in range(1, 8)]
    assert summary["major"] == [0, 1]
    assert summary["failures"] == [{"actuator": "motor2", "kind": "locked", "time_s": 0.3}]
    for key in ("rms_before", "rms_after", "predicted_rms_before", "predicted_rms_after"):
        assert len(summary[key]) == 2
        assert np.isfinite(summary[key]).all()
    for found in summary["diagnoses"]:
        assert {"actuator", "kind", "delay_s"} <= set(found)
    assert summary["closure_residual_max_m"] == 0.0
    assert isinstance(summary["verdict"], str)
    assert "\n" not in summary["verdict"]
    assert {path.name for path in folder.iterdir()} == {"track.json", *summary["files"]}
    assert {"track.npz", "track.rrd", "track.png"} <= set(summary["files"])
    with np.load(folder / "track.npz") as arrays:
        error = (arrays["desired"] - arrays["true"])[arrays["time_s"] < 0.3 - 1e-9]
        assert arrays["displacement"].shape == (400, 7)
    np.testing.assert_allclose(np.sqrt((error**2).mean(axis=0)), summary["rms_before"], rtol=1e-12)


@pytest.mark.long
def test_what_the_run_costs_without_diagnosis_is_what_a_run_without_one_costs():
    """Seed, failures, events and noise are the same: the same numbers to the bit, and said."""
    happens = {"fail": ["motor2:locked@0.2"], "event": ["bump@0.3"], "duration": 0.5}
    done = list[tuple[int, int]]()
    both = tracked(ARM, **happens, on_progress=lambda *ticks: done.append(ticks))
    summary, alone = summarize(both), summarize(tracked(ARM, diagnosis="off", **happens))
    assert summary["rms_after_without_diagnosis_rad"] == alone["rms_after_rad"]
    assert alone["rms_after_without_diagnosis"] is None
    assert done[-1] == (1000, 1000) and len(done) == len(set(done))


def test_loops_that_are_alike_are_said_once(sound):
    summary = summarize(sound)
    said = [each for each in notes(sound, summary) if each.startswith("Loop")]
    rows = [row for each in said for row in each.split(" of ", 1)[1].split(": ")[0].split(", ")]
    assert len(said) == len({str(each) for each in sound.rig.margins})
    assert rows == ["turn x", "turn y"]


UNSEEN: dict[str, Any] = {
    "sense": "task",
    "duration": 0.4,
    "fail": ["motor1:locked@0.3"],
}


@pytest.mark.long
def test_what_the_diagnosis_cannot_tell_apart_is_said_before_the_flight_and_after_it(
    capfd, monkeypatch
):
    """With the option that would, which then does: half a second is enough for it."""
    with monkeypatch.context() as changed:
        changed.setattr(Rig, "fly", lambda *_, **__: pytest.fail("it flew"))
        with pytest.raises(pytest.fail.Exception, match="it flew"):
            tracked(PLATFORM, **UNSEEN)
    advised = "motor1 locked may not be found: by the linear model --dither default tells it apart"
    assert capfd.readouterr().err == f"fjh: {advised}\n"
    one = tracked(PLATFORM, **UNSEEN)
    assert one.advice == (advised.replace("may not be found", "was not diagnosed"),)
    assert one.advice[0] in notes(one, summarize(one))
    seen: dict[str, Any] = UNSEEN | {"dither": "default"}
    with_it = tracked(PLATFORM, **seen)
    isolable = [(each.actuator, each.kind) for each in with_it.dither.separations.isolable()]  # type: ignore[union-attr]
    assert (0, "locked") in isolable
    assert "fjh" not in capfd.readouterr().err.replace(f"fjh: {advised}", "")


def test_why_the_task_is_lost_is_one_sentence_that_agrees_with_the_verdict():
    """An arm with a limp joint reaches every velocity, but cannot keep still."""
    report = tracking_rig(ARM).classified([Fault(3, "free")])
    assert not is_possible(report) and not report.unmanipulable
    assert deciding_sentence(report).startswith("Self-motion moves the major task")
    assert deciding_sentence(tracking_rig(ARM).classified([])).startswith("The actuators reach")


def test_a_run_that_named_what_had_not_failed_is_not_compared(sound):
    """Nor one that took a lock for a weakness; each says so."""
    rig, failure = sound.rig, Failure(3, "locked", 0.1)
    for named, why in (
        (Diagnosed("motor4", "locked", 0.2, None), None),
        (Diagnosed("motor4", "weak", 0.2, None), "motor4 was taken for weak"),
        (Diagnosed("motor2", "locked", 0.2, None), "motor2 was diagnosed locked wrongly"),
        (Diagnosed("motor4", "locked", 0.2, 0.3), "motor4 was diagnosed locked wrongly, or"),
    ):
        run = replace(sound.run, diagnoses=(named,))
        said = uncompared(rig, run, [failure])
        assert said is None if why is None else said is not None and said.startswith(why)
    assert learnt_s(rig, run, [failure]) == [0.2]
    failed = replace(sound.run, failures=(failure,))
    reports = sound.reports * 2
    one = replace(sound, run=failed, uncompared="it was wrong", reports=reports)
    assert summarize(one)["prediction_off_after"] is None
    assert "The linear model is not compared after it, as it was wrong." in notes(
        one, summarize(one)
    )


def test_a_prediction_that_does_not_hold_fails_the_command(sound):
    """Exit code 1; a pilot that learnt of the failure after some time is not compared."""
    summary = summarize(sound)
    assert all(check.passed for check in checks(summary))
    assert summary["prediction_off_before"] < 0.5 * AGREES
    off = [check for check in checks(summary | {"prediction_off_after": 0.21}) if not check.passed]
    assert len(off) == 1 and "after the first failure" in str(off[0])
    error = 1.3 * (sound.run.desired - sound.run.true)
    worse = replace(sound, run=replace(sound.run, true=sound.run.desired - error))
    assert not all(check.passed for check in checks(summarize(worse)))
    assert summary["prediction_off_after"] is None
    assert "times the predicted" not in " ".join(notes(sound, summary))
    factor = summarize(worse)["measured_over_predicted_before"]
    assert factor == pytest.approx(1.3 * summary["measured_over_predicted_before"])
    met = replace(worse, met=("a stone fell",))
    said = notes(met, summarize(met))
    assert f"{factor:.3g} times the predicted one before the first failure" in " ".join(said)
    assert "A stone fell." in said


def test_the_model_is_called_exact_where_nothing_is_left_out(sound):
    """What a file or a run has besides is said instead."""
    assert "have the exact model" in notes(sound, summarize(sound))[-1]
    rubs = replace(sound, rig=replace(sound.rig, warnings=("dry friction of a",)))
    for other in (rubs, replace(sound, met=("dry friction of a",))):
        said = " ".join(notes(other, summarize(other)))
        assert "Dry friction of a." in said
        assert "exact model" not in said


@pytest.fixture(scope="module")
def panda(tmp_path_factory) -> Path:
    file = tmp_path_factory.mktemp("panda") / "panda.xml"
    file.write_text(PANDA)
    return file


@pytest.fixture(scope="module")
def tight(panda) -> Path:
    """The same, and the second joint stands just below the upper end of its stated range."""
    file = panda.with_name("tight.xml")
    file.write_text(PANDA.replace("-1.7628 1.7628", "-1.7628 0.0002"))
    return file


TO_THE_HAND = {"site": "hand", "major": "3,4,5", "crossover": 0.5, "duration": 0.6}


@pytest.mark.long
def test_no_command_leaves_a_limit_that_binds_and_six_other_joints_do_the_task(panda, tight):
    """Within 1 % of the path; commands beyond the range, which the servo clips, do far worse."""
    quiet: dict[str, Any] = TO_THE_HAND | {"size": 2e-3, "turn": 1.0, "noise": 1e-6}
    free, held = tracked(panda, **quiet), tracked(tight, **quiet)
    clipped = tracked(tight, **quiet, limits="none", diagnosis="off")
    assert free.run.inputs[:, 1].max() > 3e-4
    assert held.run.inputs[:, 1].max() == pytest.approx(2e-4, abs=1e-9)
    error = [
        np.sqrt(((each.run.desired - each.run.true) ** 2).mean()) for each in (free, held, clipped)
    ]
    assert error[0] < error[1] < 0.01 * held.rig.size
    assert error[2] > 10 * error[1]


FLOATING = """
<mujoco><option gravity="0 0 -9.81"/><worldbody><body name="trunk" pos="0 0 1"><freejoint/>
  <geom type="box" size=".2 .1 .1" mass="5"/>
  <body name="leg" pos="0 0 -.1"><joint name="knee" axis="0 1 0"/>
    <geom type="capsule" fromto="0 0 0 0 0 -.3" size=".03" mass="1"/>
    <site name="payload" pos="0 0 -.3"/>
  </body></body></worldbody>
  <actuator><position name="knee" joint="knee" kp="200" kv="10"/></actuator></mujoco>
"""

Refusal = tuple[list[str], str]
NO_FAILURES = "a failure that is none", "a failure without a time", "a failure after the end"
ASKED: dict[str, Refusal] = {
    "an unknown actuator, the nearest named": (
        ["--fail", "joint22:locked@0.1"],
        'did you mean "joint2"',
    ),
    "a failure that is none": (["--fail", "joint2:tired@0.1"], "KIND one of locked, free"),
    "a failure without a time": (["--fail", "joint2:locked"], "NAME:KIND@SECONDS"),
    "a failure after the end": (
        ["--fail", "joint2:locked@9"],
        "--fail must be before the run ends at",
    ),
    "an actuator that fails twice": (
        ["--fail", "joint2:locked@0.1", "--fail", "joint2:free@0.2"],
        "each actuator once",
    ),
    "rows beyond the twist": (["--major", "0,6"], "--major must be different rows from 0 to 5"),
    "the same row twice": (["--major", "1,1"], "--major must be different rows"),
    "no row": (["--major", ""], "--major is empty"),
    "rows that are none": (["--major", "x,w"], "--major must be different rows"),
    "a row by name and by number": (["--major", "x,3"], "--major must be different rows"),
    "weights of another number": (
        ["--joint-weight", "1,2"],
        "joint_weight must be one number or 7",
    ),
    "a weight that is no number": (["--joint-weight", "heavy"], "numbers with commas"),
    "a negative weight": (["--secondary-weight", "-1"], "must be from 0 to 1e+12"),
    "a weight that is not finite": (["--joint-weight", "nan"], "must be from 0 to 1e+12"),
    "a keyframe there is not": (["--keyframe", "home"], 'no keyframe "home"; it has none'),
    "a path there is not": (["--path", "square"], "spiral, circle, steps or FILE.npz"),
    "a file there is not": (["--path", "absent.npz"], "there is no file 'absent.npz'"),
    "no duration": (["--duration", "0"], "--duration must be from 1e-06 to 10000, got 0"),
    "a size that is not finite": (["--size", "inf"], "--size must be from 1e-12 to 1000, got inf"),
    "a period that is none": (["--period", "nan"], "--period must be from 1e-07 to 1, got nan"),
    "a site there is not": (["--site", "tip"], 'site: the model has no site or body "tip"'),
    "a dither that is none": (["--dither", "often"], "dither must be none, default"),
    "a dither too slow": (["--dither", "0.1"], "a frequency from 2 to 62.5 Hz, got 0.1"),
    "a dither without a diagnosis": (["--dither", "10", "--diagnosis", "off"], "which is off"),
    "a path far out of reach": (["--size", "9"], "the path is out of reach"),
}


WRONG_FAILURES = [words for why, (words, _) in ASKED.items() if why in NO_FAILURES]


@pytest.mark.parametrize("model", [[str(ARM)], []])
@pytest.mark.parametrize("words", WRONG_FAILURES)
def test_a_text_that_is_no_failure_is_refused_before_a_file_is_read(
    words, model, monkeypatch, capfd
):
    def read(*_: Any) -> None:
        raise AssertionError("a model was read")

    monkeypatch.setattr(mujoco.MjSpec, "from_file", read)
    assert main(["track", *model, *words]) == 2
    assert "--fail" in capfd.readouterr().err


def refused(capfd: pytest.CaptureFixture[str], out: Path, *words: str) -> str:
    """The sentence with which the command refuses; it leaves nothing behind."""
    assert main(["track", *words, "--out", str(out)]) == 2
    said = capfd.readouterr().err
    assert said.startswith("fjh: ")
    assert said.count("\n") == 1, said
    assert not out.exists()
    return said


@pytest.mark.parametrize("name", ASKED)
def test_what_cannot_be_done_is_refused_in_one_sentence(name, capfd, tmp_path):
    words, expected = ASKED[name]
    usual = ("--crossover", "0.7", "--duration", "0.4")
    assert expected in refused(capfd, tmp_path / "out", str(ARM), *usual, *words)


OF_A_FILE = {
    "site": "stem1",
    "axes": "base",
    "major": "3,4",
    "noise": "1e-6",
    "crossover": "5",
    "period": "0.002",
    "joint-weight": "2",
    "secondary-weight": "1",
    "pinned": "payload",
    "limits": "none",
    "keyframe": "0",
    "servo": "20",
    "sense": "task",
}


@pytest.mark.parametrize("name", OF_A_FILE)
def test_the_hexapod_refuses_an_option_that_would_do_nothing(name, capfd, tmp_path):
    said = refused(capfd, tmp_path / "out", f"--{name}", OF_A_FILE[name])
    assert said.startswith(f"fjh: --{name} needs a MODEL.xml")


def test_every_option_of_a_robot_is_the_hexapods_too_or_refused():
    refused_names = {name.replace("-", "_") for name in OF_A_FILE}
    assert {each.name for each in fields(RobotOptions)} == refused_names | {"size", "feedforward"}


def test_a_row_that_nothing_moves_is_refused(capfd, tmp_path):
    """The platform moves in its plane only."""
    said = refused(capfd, tmp_path / "out", str(PLATFORM), "--major", "3,5")
    assert "cannot do the major task" in said


def test_a_floating_base_that_falls_is_refused(capfd, tmp_path):
    file = tmp_path / "floating.xml"
    file.write_text(FLOATING)
    said = refused(capfd, tmp_path / "out", str(file), "--major", "3")
    assert 'gravity moves the free joint of body "trunk"' in said


def test_a_path_beyond_the_stated_ranges_names_the_actuators_at_their_limits(
    capfd, tmp_path, tight
):
    words = [
        "--site",
        "hand",
        "--major",
        "1,3,5",
        "--crossover",
        "0.5",
        "--size",
        "0.05",
        "--turn",
        "8",
    ]
    said = refused(capfd, tmp_path / "out", str(tight), *words)
    assert "the path is out of reach at" in said
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
    from experiments.rig.paths import path_of

    file = tmp_path / "path.npz"
    BROKEN[name](file)
    with pytest.raises(WrongInput, match=r"path\.npz") as said:
        path_of(str(file), 2, 1.0, np.arange(5) * 0.1, 1.0, 0.1)
    assert "\n" not in str(said.value)


def test_the_floating_model_is_one_that_mujoco_takes():
    assert mujoco.MjModel.from_xml_string(FLOATING).nv == 7
