"""`fjh track`: the loop on any mechanism goes as its linear model predicts, failures included.

Paths here are a thousandth of the mechanism, so that the linear model holds.
"""

from dataclasses import fields, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fjh.rig import Rig, Run
from fjh.rig.hexapod.rig import hexapod_rig
from fjh.rig.mjcf import robot_rig
from fjh.rig.options import RobotOptions
from fjh.rig.paths import path_of
from fjh.rig.reach import learnt_s, uncompared
from fjh.rig.run import Diagnosed
from fjh.study.errors import WrongInput
from fjh.study.result import Result
from fjh.track import Flown, agreement, checks, rows_of, track
from ftc import deciding_sentence, is_possible
from ftc.fdi import Fault
from sim import HEXAPOD_MJCF, Array, Failure
from tests.robots import PANDA

ARM, PLATFORM, HAND, ARMS = (
    HEXAPOD_MJCF.with_name(f"{name}.xml") for name in ("arm", "platform", "hand", "arms")
)
MAJOR = {ARM: "0,1", PLATFORM: "3,4", HAND: "3,4", ARMS: "3,4,5", None: "0,1"}
FAILS = {ARM: "motor2", HAND: "motor2", ARMS: "motor2", PLATFORM: "motor1", None: "strut1"}


def tracked(model: Path | None, seed: int = 0, **options: Any) -> Result:
    """A run as the command makes it, without its files."""
    # A given crossover spares the search, as no dither does its design.
    given: dict[str, Any] = {"dither": "none", "turn": 2.0, "duration": 1.0, "model": model}
    given |= {"major": MAJOR.get(model, "0,1")} | ({} if model is None else {"crossover": 0.7})
    given |= options
    own = {each.name: given.pop(each.name) for each in fields(RobotOptions) if each.name in given}
    given = {"on_progress": lambda *_: None} | given
    return track(seed=seed, robot=RobotOptions(**own), **given)


def run_of(result: Result) -> dict[str, Array]:
    return dict(result.arrays["track.npz"])


@cache
def tracking_rig(model: Path) -> Rig:
    return robot_rig(model, RobotOptions(crossover=0.7))


@cache
def flown() -> tuple[Rig, Run]:
    """The arm on a part of a circle, without a failure."""
    rig = tracking_rig(ARM)
    return rig, rig.fly(rig.controller(), rig.path("circle", duration_s=0.3, turn_s=1.0))


@pytest.fixture(scope="module")
def sound() -> Result:
    return tracked(ARM, duration=0.4)


NOISE = {ARM: 2e-6, PLATFORM: 2e-6, HAND: 5e-7, ARMS: 2e-6, None: None}


@pytest.mark.long
@pytest.mark.parametrize(("model", "noise"), NOISE.items())
def test_without_a_failure_the_error_is_that_of_the_linear_model(model, noise):
    """A known path through a linear loop; noise is small, as one second averages little."""
    one = tracked(model, turn=1.0, noise=noise)
    rows, found = one.tables["rows"], one.found
    np.testing.assert_allclose(rows.rms_before[:2], rows.predicted_rms_before[:2], rtol=0.05)
    assert found["rms_after"] is None and found["predicted_rms_after"] is None
    assert one.settings["failures"] == found["possible_after"] == found["diagnoses"] == []
    assert found["closure_residual_max_m"] < 1e-8  # the demands brake for the end of the path


DESIGNED = {"dither": "designed", "crossover": None}
LOCKS = [
    *((model, {"dither": "default"}, 0.2) for model in FAILS),
    *((PLATFORM, DESIGNED | {"sense": sense}, 0.15) for sense in ("task", "both")),
    (None, DESIGNED, 0.15),
]


@pytest.mark.long
@pytest.mark.parametrize(("model", "how", "within_s"), LOCKS)
def test_a_lock_is_named_and_the_error_is_that_of_a_controller_that_learns_of_it_then(
    model, how, within_s
):
    """By the dither, of any robot; the delay costs what the lock does meanwhile."""
    failed = FAILS[model]
    one = tracked(model, duration=2.0, fail=[f"{failed}:locked@0.8"], **how)
    [named] = one.found["diagnoses"]
    assert (named["actuator"], named["kind"]) == (failed, "locked")
    assert 0 <= named["delay_s"] < within_s
    assert one.found["possible_after"] == [True] and not one.found["task_lost"]
    assert one.found["prediction_off_after"] < 0.1
    run, actuators = run_of(one), one.settings["actuators"]
    after = run["displacement"][run["time_s"] >= 0.802, actuators.index(failed)]
    assert np.ptp(after) < 1e-3 * one.settings["path_size"]
    assert how["dither"] == "default" or len(one.settings["dither"]["isolable"]) >= 2 * len(
        actuators
    )


def test_a_dither_for_which_the_task_leaves_no_motion_is_refused():
    with pytest.raises(WrongInput, match="the major task leaves no motion for a dither"):
        tracked(PLATFORM, major="2,3,4", dither="designed")


@pytest.mark.long
def test_the_error_at_rest_is_that_of_noise_and_dither():
    """Nothing else moves; the model without a dither says what noise alone costs."""
    at_rest = partial(tracked, ARM, noise=2e-6, turn=1e6, path="steps", duration=0.6)
    one, still = (at_rest(sense="both", dither=dither) for dither in ("10", "none"))
    cost = np.array(one.settings["dither"]["task_motion"]) / np.sqrt(2)
    of_noise = still.tables["rows"].predicted_rms_before
    for found in (one.tables["rows"].rms_before, one.tables["rows"].predicted_rms_before):
        np.testing.assert_allclose(found, np.hypot(cost, of_noise), rtol=0.15)
    assert (cost > 2 * of_noise).all()


@pytest.mark.long
def test_a_seed_is_its_noise_and_nothing_else(sound):
    again, other = (run_of(tracked(ARM, duration=0.4, seed=seed)) for seed in (0, 1))
    for name, values in run_of(sound).items():
        np.testing.assert_array_equal(values, again[name])
    np.testing.assert_array_equal(again["desired"], other["desired"])
    noise = [each["measured"] - each["true"] for each in (again, other)]
    assert np.abs(noise[0] - noise[1]).max() > 0
    stated = sound.settings["sensor_noise"]
    np.testing.assert_allclose([each.std() for each in noise], stated, rtol=0.1)


def test_forward_kinematics_reads_the_task_as_well_as_the_encoders_allow():
    """To first order the noise of the task is that of the encoders through the Jacobian."""
    options: dict[str, Any] = {"sense": "joints", "noise": 1e-6}
    run = run_of(tracked(ARM, duration=0.4, diagnosis="off", **options))
    rig = robot_rig(ARM, RobotOptions(crossover=0.7, **options))
    noise = run["measured"] - run["true"]
    np.testing.assert_allclose(noise.std(axis=0), rig.nominal.noise, rtol=0.1)
    np.testing.assert_allclose(noise.mean(axis=0), 0.0, atol=4e-6 / np.sqrt(len(noise)))


def test_paths_begin_at_the_start_and_keep_their_size(tmp_path):
    """That of a file is linear between its samples, and at rest after the last one."""
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
    np.savez(tmp_path / "path.npz", time_s=times, desired=desired)
    read = path_of(str(tmp_path / "path.npz"), 2, 1.0, time_s, 1.0, 1e-3)
    np.testing.assert_allclose(read[50], [5e-5, 0.0], atol=1e-18)
    np.testing.assert_allclose(read[300], desired[-1], atol=1e-18)


@pytest.mark.long
def test_what_the_run_costs_without_diagnosis_is_what_a_run_without_one_costs():
    """Seed, failures, events and noise are the same: the same numbers to the bit."""
    fly = partial(tracked, ARM, fail=["motor2:locked@0.2"], event=["bump@0.3"], duration=0.5)
    done = list[tuple[int, int]]()
    both = fly(on_progress=lambda *ticks: done.append(ticks)).found
    alone = fly(diagnosis="off").found
    assert both["rms_after_without_diagnosis_rad"] == alone["rms_after_rad"]
    assert alone["rms_after_without_diagnosis"] is None
    assert done[-1] == (1000, 1000) and len(done) == len(set(done))


@pytest.mark.long
def test_a_short_run_of_the_hexapod_is_the_testbeds_own():
    """Without a file, a failure or a diagnosis it is that of W_a, to the bit."""
    run, rig = run_of(tracked(None, path="spiral", duration=0.3, diagnosis="off")), hexapod_rig()
    ours = rig.fly(rig.controller(), run["desired"])
    np.testing.assert_array_equal(run["inputs"], ours.inputs)
    np.testing.assert_array_equal(run["measured"], ours.measured)


@pytest.mark.long
def test_what_the_diagnosis_cannot_tell_apart_is_said_before_the_flight_and_after_it(
    capfd, monkeypatch
):
    """With the option that would, which then does: half a second is enough for it."""
    unseen: dict[str, Any] = {"sense": "task", "duration": 0.4, "fail": ["motor1:locked@0.3"]}
    with monkeypatch.context() as changed:
        changed.setattr(Rig, "fly", lambda *_, **__: pytest.fail("it flew"))
        with pytest.raises(pytest.fail.Exception, match="it flew"):
            tracked(PLATFORM, **unseen)
    advised = "motor1 locked may not be found: by the linear model --dither default tells it apart"
    assert capfd.readouterr().err == f"fjh: {advised}\n"
    one = tracked(PLATFORM, **unseen)
    assert one.found["advice"] == [advised.replace("may not be found", "was not diagnosed")]
    assert one.found["advice"][0] in one.notes
    unseen["dither"] = "default"
    with_it = tracked(PLATFORM, **unseen).settings["dither"]
    assert {"actuator": "motor1", "kind": "locked"} in with_it["isolable"]


def test_an_arm_with_a_limp_joint_reaches_every_velocity_and_cannot_keep_still():
    report = tracking_rig(ARM).classified([Fault(3, "free")])
    assert not is_possible(report) and not report.unmanipulable
    assert deciding_sentence(report).startswith("Self-motion moves the major task")


def test_a_run_that_named_what_had_not_failed_is_not_compared():
    """Nor one that took a lock for a weakness; each says so."""
    (rig, sound), failure = flown(), Failure(3, "locked", 0.1)
    predicted = rig.predict(sound.desired, failures=[failure])
    for named, why in (
        (Diagnosed("motor4", "locked", 0.2, None), None),
        (Diagnosed("motor4", "weak", 0.2, None), "motor4 was taken for weak"),
        (Diagnosed("motor2", "locked", 0.2, None), "motor2 was diagnosed locked wrongly"),
        (Diagnosed("motor4", "locked", 0.2, 0.3), "motor4 was diagnosed locked wrongly, or"),
    ):
        run = replace(sound, diagnoses=(named,), failures=(failure,))
        said = uncompared(rig, run, predicted)
        assert said is None if why is None else said is not None and said.startswith(why)
        ours = Flown(rig, run, None, None, (), predicted, predicted)
        assert np.isfinite(agreement(ours, rows_of(ours))["prediction_off_after"]) == (why is None)
    assert learnt_s(rig, run, [failure]) == [0.2]
    leaves = uncompared(rig, sound, replace(predicted, leaves="motor1"))
    assert leaves == "in the linear model motor1 leaves its range"


def test_a_number_that_is_off_fails_the_command(sound):
    """Errors 1.3 times as large, a gap of a loop, another controller that fails."""
    found, (rig, run) = {**sound.settings, **sound.found}, flown()
    assert all(check.passed for check in checks(found)) and len(checks(found)) == 2
    for spoilt in (
        {"prediction_off_before": 0.21},
        {"prediction_off_after": 0.21},
        {"closure_residual_max_m": 0.002},
        {"controller": "a:b", "controller_failure": "it raised"},
    ):
        assert [check.passed for check in checks(found | spoilt)].count(False) == 1
    predicted = rig.predict(run.desired, noise=run.measured - run.true)
    ours = Flown(rig, run, None, None, ("a stone fell",), predicted, predicted)
    rows = rows_of(ours)
    worse = agreement(ours, rows.assign(rms_before=1.3 * rows.rms_before))
    factor = agreement(ours, rows)["measured_over_predicted_before"]
    assert abs(factor - 1) < 0.1 and worse["met"] == ["a stone fell"]
    assert worse["measured_over_predicted_before"] == pytest.approx(1.3 * factor)
    assert worse["prediction_off_before"] == pytest.approx(1.3 * factor - 1)


TO_THE_HAND: dict[str, Any] = {"site": "hand", "major": "3,4,5", "crossover": 0.5}


def panda(folder: Path, upper: str = "1.7628") -> Path:
    """A Panda whose second joint has this upper end of its stated range."""
    file = folder / f"panda{upper}.xml"
    file.write_text(PANDA.replace("-1.7628 1.7628", f"-1.7628 {upper}"))
    return file


@pytest.mark.long
def test_no_command_leaves_a_limit_that_binds_and_six_other_joints_do_the_task(tmp_path):
    """Within 1 % of the path; commands beyond the range, which the servo clips, do far worse."""
    quiet: dict[str, Any] = TO_THE_HAND | {
        "size": 2e-3,
        "turn": 1.0,
        "noise": 1e-6,
        "duration": 0.6,
    }
    wide, tight = panda(tmp_path), panda(tmp_path, "0.0002")
    clipping: dict[str, Any] = {"limits": "none", "diagnosis": "off"}
    found = [tracked(wide, **quiet), tracked(tight, **quiet), tracked(tight, **quiet, **clipping)]
    free, held, clipped = map(run_of, found)
    assert free["inputs"][:, 1].max() > 3e-4
    assert held["inputs"][:, 1].max() == pytest.approx(2e-4, abs=1e-9)
    error = [np.sqrt(((r["desired"] - r["true"]) ** 2).mean()) for r in (free, held, clipped)]
    assert error[0] < error[1] < 0.01 * 2e-3
    assert error[2] > 10 * error[1]


@pytest.mark.long
def test_a_published_robot_moves_by_encoders_alone(tmp_path):
    """Held against gravity; forward kinematics through the gear of its fingers."""
    one = tracked(panda(tmp_path), **TO_THE_HAND, sense="joints", diagnosis="off")
    rows = one.tables["rows"]
    np.testing.assert_allclose(rows.rms_before, rows.predicted_rms_before, rtol=0.2)
