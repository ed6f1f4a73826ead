"""Tests of `fjh track` against the linear model on small paths, also after failures."""

import re
from dataclasses import fields, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from experiments.app.cli import main
from fjh.rig import Rig, Run
from fjh.rig.hexapod.rig import hexapod_rig
from fjh.rig.mjcf import robot_rig
from fjh.rig.options import RobotOptions
from fjh.rig.paths import path_of
from fjh.rig.reach import limited_by, predictor, uncompared
from fjh.rig.run import DiagnosedFailure
from fjh.study.errors import WrongInput
from fjh.study.result import Result
from fjh.track import TrackedRuns, compare_prediction, rows_of, track
from ftc.reconfiguration import ErrorPrediction
from sim import HEXAPOD_MJCF, Array, Failure
from tests.arms import ARMS as SERIAL
from tests.fjh.rigs import shared_rig
from tests.robots import PANDA

ARM, PLATFORM, HAND, ARMS = (
    HEXAPOD_MJCF.with_name(f"{name}.xml") for name in ("arm", "platform", "hand", "arms")
)
MAJOR = {ARM: "0,1", PLATFORM: "3,4", HAND: "3,4", ARMS: "3,4,5", None: "0,1"}
FAILS = {ARM: "motor2", HAND: "motor2", ARMS: "motor2", PLATFORM: "motor1", None: "strut1"}


def tracked(model: Path | None, seed: int = 0, **options: Any) -> Result:
    """Return the result of `fjh track` without its files."""
    # A given crossover avoids the search, and no dither its design.
    arguments: dict[str, Any] = {"dither": "none", "turn": 2.0, "duration": 1.0, "model": model}
    arguments |= {"major": MAJOR.get(model, "0,1")} | ({} if model is None else {"crossover": 0.7})
    arguments |= options
    own = {
        option.name: arguments.pop(option.name)
        for option in fields(RobotOptions)
        if option.name in arguments
    }
    arguments = {"on_progress": lambda *_: None} | arguments
    return track(seed=seed, robot=RobotOptions(**own), **arguments)


def run_of(result: Result) -> dict[str, Array]:
    return dict(result.arrays["track.npz"])


NOISE = {ARM: 2e-6, PLATFORM: 2e-6, HAND: 5e-7, ARMS: 2e-6, None: None}


@pytest.mark.long
@pytest.mark.parametrize(("model", "noise"), NOISE.items())
def test_without_a_failure_the_error_is_that_of_the_linear_model(model, noise):
    """The path is deterministic; noise is small, since one second averages little."""
    result = tracked(model, turn=1.0, noise=noise)
    rows, results = result.tables["rows"], result.overall
    np.testing.assert_allclose(rows.rms_before[:2], rows.predicted_rms_before[:2], rtol=0.05)
    assert results["rms_after"] is None and results["predicted_rms_after"] is None
    assert result.settings["failures"] == results["possible_after"] == results["diagnoses"] == []
    assert results["closure_residual_max_m"] < 1e-8  # the demands decelerate at the end of the path


DESIGNED = {"dither": "designed", "crossover": None}
NIGHT = pytest.mark.night
LOCKS = [
    *((model, {"dither": "default"}, 0.2) for model in (ARM, PLATFORM, None)),
    *(pytest.param(each, {"dither": "default"}, 0.2, marks=NIGHT) for each in (HAND, ARMS)),
    pytest.param(PLATFORM, DESIGNED | {"sense": "task"}, 0.15, marks=NIGHT),
    (PLATFORM, DESIGNED | {"sense": "both"}, 0.15),
    (None, DESIGNED, 0.15),
]


@pytest.mark.long
@pytest.mark.parametrize(("model", "options", "within_s"), LOCKS)
def test_lock_is_identified_and_error_is_as_predicted_for_its_delay(model, options, within_s):
    """The dither isolates the lock for each robot; the prediction includes the delay."""
    failed = FAILS[model]
    result = tracked(model, duration=2.0, fail=[f"{failed}:locked@0.8"], **options)
    [identified] = result.overall["diagnoses"]
    assert (identified["actuator"], identified["kind"]) == (failed, "locked")
    assert 0 <= identified["delay_s"] < within_s
    assert result.overall["possible_after"] == [True] and not result.overall["task_lost"]
    assert result.overall["prediction_off_after"] < 0.1
    run, actuators = run_of(result), result.settings["actuators"]
    after = run["displacement"][run["time_s"] >= 0.802, actuators.index(failed)]
    assert np.ptp(after) < 1e-3 * result.settings["path_size"]
    isolable = result.settings["dither"]["isolable"]
    assert options["dither"] == "default" or len(isolable) >= 2 * len(actuators)


@pytest.mark.long
def test_the_error_at_rest_is_that_of_noise_and_dither():
    """Noise and dither alone cause the error; the run without a dither gives the part of noise."""
    at_rest = partial(tracked, ARM, noise=2e-6, turn=1e6, path="steps", duration=0.6)
    result, still = (at_rest(sense="both", dither=dither) for dither in ("10", "none"))
    cost = np.array(result.settings["dither"]["task_motion"]) / np.sqrt(2)
    of_noise = still.tables["rows"].predicted_rms_before
    for results in (result.tables["rows"].rms_before, result.tables["rows"].predicted_rms_before):
        np.testing.assert_allclose(results, np.hypot(cost, of_noise), rtol=0.15)
    assert (cost > 2 * of_noise).all()


@pytest.mark.long
def test_forward_kinematics_reads_the_task_as_well_as_the_encoders_allow():
    """The task noise is to first order the encoder noise mapped by the Jacobian."""
    options: dict[str, Any] = {"sense": "joints", "noise": 1e-6}
    run = run_of(tracked(ARM, duration=0.4, diagnosis="off", **options))
    rig = robot_rig(ARM, RobotOptions(crossover=0.7, **options))
    noise = run["measured"] - run["true"]
    np.testing.assert_allclose(noise.std(axis=0), rig.nominal.noise, rtol=0.1)
    np.testing.assert_allclose(noise.mean(axis=0), 0.0, atol=4e-6 / np.sqrt(len(noise)))
    hand = robot_rig(HAND, RobotOptions(major=(3, 4), sense="joints", crossover=0.7))
    gain = hand.mapping(hand.goal).major_gain()
    assert hand.encoder_noise == pytest.approx(hand.noise * np.abs(gain).max())


def test_paths_begin_at_the_start_and_keep_their_size(tmp_path):
    """A path of a file is linear between its samples, and at rest after the last one."""
    time_s, size = np.arange(4000) * 1e-3, 2e-3
    circle = path_of("circle", 3, size, time_s, 2.0, 1e-3)
    np.testing.assert_allclose(np.linalg.norm(circle[:, :2] - [0, size], axis=1), size, rtol=1e-12)
    assert not circle[0].any() and not circle[:, 2].any()
    assert np.abs(np.diff(circle[:, 0])).max() * 1e3 <= size * np.pi * 1.001  # never faster
    steps = path_of("steps", 2, 1.0, time_s, 4.0, 1e-3)
    for tick, at in ((400, (0, 0)), (1200, (1, 0)), (2400, (0, 0)), (3600, (0, 1))):
        np.testing.assert_array_equal(steps[tick], at)
    radius = np.linalg.norm(path_of("spiral", 2, size, time_s, 1.0, 1e-3), axis=1)
    assert radius[0] == 0.0 and (np.diff(radius) > 0).all()
    assert radius[-1] == pytest.approx(size, rel=0.01)
    times, desired = np.array([0.0, 0.1, 0.2]), np.array([[0, 0], [1e-4, 0], [1e-4, -2e-4]])
    np.savez(file := tmp_path / "path.npz", time_s=times, desired=desired)
    read = path_of(str(file), 2, 1.0, time_s, 1.0, 1e-3)
    np.testing.assert_allclose(read[50], [5e-5, 0.0], atol=1e-18)
    np.testing.assert_allclose(read[300], desired[-1], atol=1e-18)


@pytest.mark.long
def test_error_without_diagnosis_is_that_of_a_run_without_diagnosis():
    """Numbers with equal seed, failures, events and noise are equal to the bit."""
    track_arm = partial(tracked, ARM, fail=["motor2:locked@0.2"], event=["bump@0.3"], duration=0.5)
    done = list[tuple[int, int]]()
    both = track_arm(on_progress=lambda *ticks: done.append(ticks)).overall
    alone = track_arm(diagnosis="off").overall
    assert both["rms_after_without_diagnosis_rad"] == alone["rms_after_rad"]
    assert alone["rms_after_without_diagnosis"] is None
    assert done[-1] == (1000, 1000) and len(done) == len(set(done))
    # The hexapod's run without file, failure or diagnosis equals W_a to the bit.
    run = run_of(tracked(None, path="spiral", duration=0.3, diagnosis="off"))
    rig = hexapod_rig()
    reference = rig.fly(rig.controller(), run["desired"])
    np.testing.assert_array_equal(run["inputs"], reference.inputs)
    np.testing.assert_array_equal(run["measured"], reference.measured)


@pytest.mark.long
def test_failure_that_is_not_isolable_is_reported_before_and_after(capfd):
    """The advised option isolates the failure, for which half a second is enough."""
    unisolable: dict[str, Any] = {"sense": "task", "duration": 0.4, "fail": ["motor1:locked@0.3"]}
    result = tracked(PLATFORM, **unisolable)
    advised = (
        "motor1 locked may not be identified: by the linear model --dither default isolates it"
    )
    assert capfd.readouterr().err == f"fjh: {advised}\n"
    assert result.overall["advice"] == [
        advised.replace("may not be identified", "was not diagnosed")
    ]
    improved = tracked(PLATFORM, **unisolable, dither="default").settings["dither"]
    assert {"actuator": "motor1", "kind": "locked"} in improved["isolable"]
    with pytest.raises(WrongInput, match="the major rows leave no motion for it"):
        tracked(PLATFORM, major="2,3,4", dither="designed")


@pytest.mark.long
@pytest.mark.parametrize(
    ("identified", "why"),
    [
        (DiagnosedFailure("motor4", "locked", 0.2, None), None),
        (
            DiagnosedFailure("motor4", "weak", 0.2, None),
            "motor4 was identified as weak, not as locked",
        ),
        (
            DiagnosedFailure("motor2", "locked", 0.2, None),
            "motor2 was incorrectly identified as locked",
        ),
        (
            DiagnosedFailure("motor4", "locked", 0.2, 0.3),
            "motor4 was incorrectly identified as locked, or",
        ),
    ],
)
def test_run_with_a_false_diagnosis_is_not_compared(identified, why):
    """A run with a lock diagnosed as weak is not compared either; the reason is reported."""
    rig, failure = shared_rig("arm", crossover=0.7), Failure(3, "locked", 0.1)
    run = rig.fly(rig.controller(), rig.path("circle", duration_s=0.3, turn_s=1.0))
    run = replace(run, diagnoses=(identified,), failures=(failure,))
    predicted = rig.predict(run.desired, failures=[failure])
    message = uncompared(rig, run, predicted)
    assert message is None if why is None else message is not None and message.startswith(why)
    runs = TrackedRuns(rig, run, None, None, (), predicted, predicted)
    assert np.isfinite(compare_prediction(runs, rows_of(runs))["prediction_off_after"]) == (
        why is None
    )


def panda(folder: Path, upper: str = "1.7628") -> Path:
    """Write a Panda whose second joint has this upper limit."""
    file = folder / f"panda{upper}.xml"
    file.write_text(PANDA.replace("-1.7628 1.7628", f"-1.7628 {upper}"))
    return file


@pytest.mark.long
def test_commands_respect_an_active_limit_and_other_joints_do_the_task(tmp_path):
    """The error is within 1 % of the path; with commands clipped by the servo it is far larger."""
    quiet: dict[str, Any] = {"site": "hand", "major": "3,4,5", "crossover": 0.5, "size": 2e-3}
    quiet |= {"turn": 1.0, "noise": 1e-6, "duration": 0.6}
    wide, tight = panda(tmp_path), panda(tmp_path, "0.0002")
    clipping: dict[str, Any] = {"limits": "none", "diagnosis": "off"}
    results = [tracked(wide, **quiet), tracked(tight, **quiet), tracked(tight, **quiet, **clipping)]
    free, tight_run, clipped = map(run_of, results)
    assert free["inputs"][:, 1].max() > 3e-4
    assert tight_run["inputs"][:, 1].max() == pytest.approx(2e-4, abs=1e-9)
    error = [np.sqrt(((r["desired"] - r["true"]) ** 2).mean()) for r in (free, tight_run, clipped)]
    assert error[0] < error[1] < 0.01 * 2e-3
    assert error[2] > 10 * error[1]


def cause(rig: Rig, run: Run, informed: bool = True) -> str | None:
    return limited_by(rig, run, predictor(rig, run, None)(told=informed))


QUIET: dict[str, Any] = {"noise": 1e-6}
STEPS: dict[str, Any] = QUIET | {"path": "steps", "size": 0.1}
"""Steps of 0.1 m, which need more torque than the servos have."""


@pytest.mark.long
@pytest.mark.parametrize(
    ("joint", "torque", "options", "message"),
    [
        ("", 1.0, {"noise": 1e-3}, "Most of the error is from noise of the sensors, which the"),
        ("", 1.0, {"noise": 1e-12}, None),
        ("", 1.0, STEPS, r"The servo of servo\d saturates: it gives its largest force for \d+ %"),
        ("", 1e6, STEPS, None),
        ('frictionloss="2"', 1.0, QUIET, r"Most of the error is from dry friction in the joints"),
    ],
)
def test_dominant_cause_of_the_error_is_identified(tmp_path, joint, torque, options, message):
    """Run a Panda-like arm for a second, with its torque multiplied by a factor."""
    servos = [(kp, kv, torque * most) for kp, kv, most in SERIAL["panda"].servos]
    file = replace(SERIAL["panda"], servos=servos).write(tmp_path / "panda.xml", joint)
    settings = {"site": "tool", "major": [3, 4, 5], "crossover": 0.13} | options
    path = settings.pop("path", "circle")
    rig = Rig.of_mjcf(file, **settings)
    results = cause(rig, rig.fly(rig.controller(), rig.path(path, duration_s=1.0, turn_s=2.0)))
    assert (
        results is None if message is None else results is not None and re.match(message, results)
    )


@pytest.mark.long
def test_late_diagnosis_is_identified_as_cause_after_a_lock_in_motion(tmp_path, monkeypatch):
    monkeypatch.setattr(ErrorPrediction, "should_switch", lambda *_: True)
    rig = Rig.of_mjcf(SERIAL["panda"].write(tmp_path / "panda.xml"), site="tool", major=[3, 4, 5])
    path = rig.path("circle", duration_s=2.0, turn_s=2.0)
    stuck = [Failure("joint4", "locked", 1.0)]
    run = rig.fly(rig.supervisor("none"), path, failures=stuck)
    assert [each.actuator for each in run.diagnoses] == ["servo4"]
    late = "After the failure most of the error is from the time until it was diagnosed."
    assert cause(rig, run) == late
    undiagnosed = rig.fly(rig.controller(), path, failures=stuck)
    assert cause(rig, undiagnosed, informed=False) != late


@pytest.mark.long
def test_events_are_reported_and_not_compared_with_the_linear_model():
    events = ["hard_over:joint2@0.3", "bump@0.2", "late@0.35"]
    pushed = tracked(ARM, duration=0.4, event=events, diagnosis="off", fail=["motor4:locked@0.32"])
    results = pushed.overall
    message = "bump at 0.2 s, motor2 hard_over at 0.3 s, motor4 locked at 0.32 s, late at 0.35 s"
    assert f"after {message} the RMS error is" in results["verdict"]
    run = run_of(pushed)
    error_before = (run["desired"] - run["true"])[:200]
    np.testing.assert_allclose(results["rms_before"], np.sqrt((error_before**2).mean(axis=0)))
    assert results["prediction_off_before"] < 0.1
    assert results["predicted_rms_after"] is results["predicted_rms_after_when_named"] is None
    assert results["uncompared"].startswith("the linear model does not include bump")
    assert results["rms_after"][0] > 10 * results["rms_before"][0]


INVALID = {
    "--fail joint2:locked": "NAME:KIND@SECONDS",
    "--fail joint2:locked@9": "--fail must be before the run ends at",
    "--fail joint2:locked@0.1 --fail joint2:free@0.2": "each actuator at most once",
    "--fail motor2:free@0.2 --event bump_then_lock:joint2@0.1": "--fail and --event must name each",
    "--event hard_over@0.3": "actuator of hard_over must be given",
    "--dither 10 --diagnosis off": "needs --diagnosis on",
    "--size 9": "the path is out of reach",
    "--site hand --major 1,3,5 --size 0.05 --turn 8": "with actuator2 at a limit; choose a smaller",
}


@pytest.mark.parametrize("line", INVALID)
def test_impossible_requests_are_rejected_in_one_sentence(line, capfd, tmp_path):
    file, out = panda(tmp_path, "0.0002") if "hand" in line else ARM, tmp_path / "out"
    common = ("track", str(file), "--crossover", "0.5", "--duration", "0.4", "--out", str(out))
    assert main([*common, *line.split()]) == 2
    message = capfd.readouterr().err
    assert message.startswith("fjh: ") and INVALID[line] in message and message.count("\n") == 1
    assert not out.exists()
