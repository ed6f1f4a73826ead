"""`fjh track`: any robot in the loop does what the linear model says, and says what failed."""

import json

import numpy as np
import pytest

from experiments.app.cli import main
from experiments.rig.hexapod.rig import hexapod_rig
from experiments.rig.paths import path_of
from sim import HEXAPOD_MJCF
from tests.robots import PANDA

ROBOTS = {
    "arm": (["--major", "0,1"], "motor4"),
    "hand": (["--major", "3,4"], "motor2"),
    "platform": (["--major", "3,4"], "motor1"),
    "arms": (["--major", "3,4,5"], "motor2"),
    "fjh": ([], "strut1"),
}
DURATION_S = 4.0


def words(name: str, *further: str, fail: bool) -> list[str]:
    rows, actuator = ROBOTS[name]
    file = [] if name == "fjh" else [str(HEXAPOD_MJCF.with_name(f"{name}.xml"))]
    failure = ["--fail", f"{actuator}:locked@{DURATION_S / 2:g}"] if fail else []
    return ["track", *file, *rows, *failure, "--quiet", *further]


def read(folder) -> dict:
    return json.loads((folder / "track.json").read_text())


@pytest.mark.long
@pytest.mark.parametrize("name", ROBOTS)
def test_without_a_failure_the_error_is_that_of_the_linear_model(name, tmp_path):
    """The path is so small that inertia and curvature hardly change along it; 20 % at the most."""
    options = ["--duration", "3", "--diagnosis", "off", "--out", str(tmp_path)]
    assert main([*words(name, fail=False), *options]) == 0
    found = read(tmp_path)
    assert found["rms_after"] is None and found["diagnoses"] == []
    np.testing.assert_allclose(found["rms_before"], found["predicted_rms_before"], rtol=0.2)
    assert found["closure_residual_max_m"] < 1e-7


@pytest.mark.long
@pytest.mark.parametrize("name", ROBOTS)
def test_a_lock_in_flight_is_survived_and_told_as_the_interface_has_it(name, tmp_path):
    options = ["--duration", f"{DURATION_S:g}", "--out", str(tmp_path)]
    assert main([*words(name, fail=True), *options]) == 0
    found = read(tmp_path)
    actuator = ROBOTS[name][1]
    assert found["experiment"] == "track"
    assert found["failures"] == [{"actuator": actuator, "kind": "locked", "time_s": 2.0}]
    assert actuator in found["actuators"]
    for key in ("rms_before", "rms_after", "predicted_rms_before", "predicted_rms_after"):
        assert len(found[key]) == len(found["major"])
    assert actuator in found["verdict"] and found["possible_after"] == [True]
    if name in ("arm", "hand"):  # the others share their load: docs/track.md
        right = [one for one in found["diagnoses"] if one["actuator"] == actuator]
        assert right[0]["kind"] in ("locked", "weak") and 0 <= right[0]["delay_s"] < 0.2
        assert max(found["rms_after"]) < 10 * max(found["predicted_rms_after"])
    for file in ("track.npz", "track.rrd", "track.png", "track.md"):
        assert (tmp_path / file).stat().st_size > 0
    with np.load(tmp_path / "track.npz") as run:
        stuck = run["displacement"][2010:, found["actuators"].index(actuator)]
        assert np.ptp(stuck) < 1e-6
        assert np.isfinite(run["true"]).all()


@pytest.mark.long
def test_a_short_run_of_the_hexapod_is_the_testbeds_own(tmp_path):
    """Without a file, a failure or a diagnosis it is that of W_a, to the bit."""
    options = ["--path", "spiral", "--duration", "0.3", "--diagnosis", "off"]
    assert main(["track", "--quiet", *options, "--out", str(tmp_path)]) == 0
    rig = hexapod_rig()
    with np.load(tmp_path / "track.npz") as run:
        ours = rig.fly(rig.controller(), run["desired"])
        assert np.array_equal(run["inputs"], ours.inputs)
        assert np.array_equal(run["measured"], ours.measured)


@pytest.mark.long
def test_a_published_robot_moves_by_encoders_alone(tmp_path):
    """Held against gravity; forward kinematics through the gear of its fingers."""
    file = tmp_path / "panda.xml"
    file.write_text(PANDA)
    options = ["--site", "hand", "--major", "3,4,5", "--sense", "joints", "--duration", "1"]
    options += ["--diagnosis", "off", "--quiet", "--out", str(tmp_path / "out")]
    assert main(["track", str(file), *options]) == 0
    found = read(tmp_path / "out")
    np.testing.assert_allclose(found["rms_before"], found["predicted_rms_before"], rtol=0.2)


FALLING = """
<mujoco>
  <worldbody>
    <body name="trunk" pos="0 0 1">
      <freejoint name="root"/><geom size="0.1" mass="5"/>
      <body name="link"><joint name="hip" axis="0 1 0"/><geom size="0.05" pos="0 0 -0.2" mass="1"/>
        <site name="tool" pos="0 0 -0.3"/></body>
    </body>
  </worldbody>
  <actuator><position joint="hip" kp="100" kv="5"/></actuator>
</mujoco>
"""


@pytest.mark.parametrize(
    ("further", "said"),
    [
        (["--fail", "joint44:locked@0.1"], 'did you mean "joint4"'),
        (["--fail", "joint4:melted@1"], "--fail must be NAME:KIND@SECONDS"),
        (["--fail", "joint4:locked@99"], "--fail must be before the run ends at 1 s"),
        (["--major", "0,7"], "different rows from 0 to 5"),
        (["--path", "zigzag"], "spiral, circle, steps or FILE.npz"),
        (["--path", "none.npz"], "there is no file"),
        (["--joint-weight", "1,2"], "joint_weight must be one number or 7"),
        (["--keyframe", "home"], 'no keyframe "home"; it has none'),
        (["--size", "-1"], "--size must be from"),
        (["--site", "tip"], "tip"),
    ],
)
def test_wrong_input_is_one_sentence_and_leaves_nothing(further, said, tmp_path, capsys):
    folder = tmp_path / "out"
    assert main([*words("arm", *further, fail=False), "--duration", "1", "--out", str(folder)]) == 2
    error = capsys.readouterr().err
    assert said in " ".join(error.split()) and "Traceback" not in error
    assert not (folder / "track.json").exists()


def test_what_falls_is_refused_by_name(tmp_path, capsys):
    file = tmp_path / "falling.xml"
    file.write_text(FALLING)
    words = ["track", str(file), "--site", "tool", "--major", "3", "--out", str(tmp_path / "out")]
    assert main(words) == 2
    assert 'gravity moves the free joint "root"' in " ".join(capsys.readouterr().err.split())


def test_a_path_out_of_reach_is_refused_with_what_is_at_a_limit(tmp_path, capsys):
    file = tmp_path / "panda.xml"
    file.write_text(PANDA)
    options = ["--site", "hand", "--major", "3,4,5", "--size", "0.6", "--duration", "4"]
    assert main(["track", str(file), *options, "--out", str(tmp_path / "out")]) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert "out of reach" in said and "smaller size" in said


def test_paths_begin_at_the_start_and_keep_their_size():
    time_s = np.arange(4000) * 1e-3
    circle = path_of("circle", 3, 2e-3, time_s, 2.0, 1e-3)
    radius = np.linalg.norm(circle[:, :2] - [0, 2e-3], axis=1)
    np.testing.assert_allclose(radius, 2e-3, rtol=1e-12)
    assert not circle[0].any() and not circle[:, 2].any()
    assert np.abs(np.diff(circle[:, 0])).max() * 1e3 <= 2e-3 * np.pi * 1.001  # never faster
    steps = path_of("steps", 2, 1.0, time_s, 2.0, 1e-3)
    assert set(np.unique(steps)) == {0.0, 1.0} and (steps.sum(axis=1) <= 1).all()
    assert not path_of("spiral", 1, 1.0, time_s, 2.0, 1e-3)[0].any()
