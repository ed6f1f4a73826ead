"""The examples are short, run in an empty folder, and print what independent laws say."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest
from PIL import Image
from scipy.optimize import linprog
from sphinx_gallery.notebook import python_to_jupyter_cli

from sim import MODELS
from tests.published.faces import LARGEST, WEIGHT, distances, effectiveness
from tests.rrd import scalars

ROOT = Path(__file__).parents[2]
pytestmark = pytest.mark.long
FIRST = {"Matplotlib is building the font cache; this may take a moment."}
"""Said by the first process on a computer that looks for fonts for over 5 s."""


def test_the_notebook_is_what_sphinx_gallery_makes_of_its_script(tmp_path):
    (notebook,) = (ROOT / "examples").glob("*.ipynb")
    script = tmp_path / f"{notebook.stem}.py"
    script.write_text((ROOT / "examples" / script.name).read_text())
    python_to_jupyter_cli([str(script)])
    made, kept = (json.loads(file.read_text()) for file in (script.with_suffix(".ipynb"), notebook))
    assert kept["cells"] == made["cells"]  # beside them is the version of Python


def printed(name: str, folder: Path) -> list[str]:
    """What an example prints in an empty folder, where it leaves its picture, line by line."""
    done = subprocess.run(
        [sys.executable, ROOT / "examples" / f"{name}.py"],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(ROOT), "MPLBACKEND": "Agg", "PYTHONUTF8": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert set(done.stderr.splitlines()) <= FIRST
    picture = folder / f"{name}.png"
    with Image.open(picture) as image:
        assert image.width == 640
        assert np.asarray(image.convert("L"))[:, [0, -1]].min() == 255  # no title is cut off
    lines = done.stdout.splitlines()
    assert 2 <= len(lines) <= 5
    return lines


def numbers(lines: list[str], pattern: str) -> list[float]:
    """The number of each line that follows or precedes other text, as of a pattern."""
    return [float(found[1]) for line in lines if (found := re.search(pattern, line))]


def arm_jacobians() -> tuple[np.ndarray, np.ndarray]:
    """Rows [angular; linear] of the camera and of the elbow in the axes `base`, by MuJoCo alone."""
    model = mujoco.MjModel.from_xml_path(str(MODELS / "arm.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    camera, elbow = np.zeros((2, 2, 3, model.nv))
    mujoco.mj_jacSite(model, data, camera[1], camera[0], model.site("payload").id)
    mujoco.mj_jacBody(model, data, elbow[1], elbow[0], model.body("link4").id)
    R = data.site("base").xmat.reshape(3, 3)
    return (R.T @ camera).reshape(6, -1), (R.T @ elbow).reshape(6, -1)


def test_without_strut_1_a_third_of_the_pointing_is_missing(tmp_path):
    """Six struts that symmetry makes equal share two motions: a projector's diagonal is 2 / 6."""
    lines = printed("hexapod_lock", tmp_path)
    assert "reach every major velocity" in lines[0]
    assert numbers(lines, r"off by ([\d.]+) mrad") == [0.333, 0.0]


def test_legs_a_quarter_turn_apart_hold_twice_one_leg_and_without_one_of_them_once(tmp_path):
    """No moment: their forces add to zero, so that opposite legs share each direction."""
    assert numbers(printed("force", tmp_path), r": (\d+) N in") == [200, 100]


def test_the_arm_turns_its_camera_as_fast_as_a_linear_program_says(tmp_path):
    J, d = arm_jacobians()[0][:2], np.array([0.6, 0.8])
    fastest = linprog(
        [*np.zeros(7), -1],
        A_eq=np.column_stack([J, -d]),
        b_eq=[0, 0],
        bounds=[(-1, 1)] * 7 + [(0, None)],
    ).x[-1]
    at_limit = 1 / np.abs(np.linalg.pinv(J) @ d).max()
    found = numbers(printed("limits", tmp_path), r"up to ([\d.]+) rad/s")
    np.testing.assert_allclose(found, [at_limit, at_limit, fastest], atol=0.011)


def test_a_goal_is_exact_as_long_as_its_rows_and_those_above_have_a_solution(tmp_path):
    camera, elbow = arm_jacobians()
    rows = np.vstack([camera[[0, 1, 3, 4, 5]], elbow[3:4]])
    target, order = np.array([0.3, 0.2, 0.1, 0.0, 0.1, -0.1]), np.array([7, 5, 3, 1, 2, 4, 6]) - 1
    expected = []
    for last in (2, 5, 6):
        left = [
            np.linalg.norm(A @ np.linalg.pinv(A) @ target[:last] - target[:last])
            for A in (rows[:last, order[count:]] for count in range(7))
        ]
        expected.append(sum(one < 1e-9 for one in left) - 1)
    assert numbers(printed("hierarchy", tmp_path), r"up to (\d) joints") == expected


def test_a_hexarotor_is_controllable_where_hover_lies_inside_every_face(tmp_path):
    lines = printed("multirotor", tmp_path)
    for line in lines:
        upper = np.full(6, LARGEST)
        upper[0] *= "1 of 6" not in line
        B, hover = effectiveness(line.split(",")[0]), np.array([WEIGHT, 0, 0, 0])
        room = distances(B, hover, np.zeros(6), upper).min()
        assert ("cannot" in line) == (room < 1e-9), line


def test_the_lock_of_the_arm_is_found_and_costs_a_tenth_of_what_it_costs_unnoticed(tmp_path):
    lines = printed("own_arm", tmp_path)
    assert 0.8 < numbers(lines, r"motor4 was named locked at ([\d.]+) s")[0] < 1.3
    unaware, supervised = numbers(lines, r"RMS error ([\d.]+) mrad")
    assert supervised < 0.1 * unaware


def test_both_controllers_fly_and_the_supervisor_names_the_strut(tmp_path):
    lines = printed("other_controller", tmp_path)
    mine, supervisor = numbers(lines, r"([\d.]+) µrad RMS")
    assert supervisor < mine < 100 and "strut1 was named locked at 1.0" in lines[1]


def test_the_recording_holds_the_errors_of_the_arrays_and_only_the_locked_motor_stands(tmp_path):
    printed("recording", tmp_path)
    with np.load(tmp_path / "recording.npz") as run:
        error_urad = 1e6 * (run["desired"] - run["true"])
        moved = run["displacement"]
    _, shown = scalars(tmp_path / "recording.rrd", "/task/error")
    np.testing.assert_array_equal(shown, error_urad[::5])  # 200 Hz
    stands = np.abs(moved[1050:] - moved[1050]).max(axis=0) < 1e-4  # [rad], after the lock
    assert stands.tolist() == [False, True, *[False] * 5]


IK = {
    "ik_arm": ("joint3", r"within ([\d.]+) mm"),
    "ik_mobile": ("drive_y", r"within ([\d.]+) mm"),
    "ik_humanoid": ("left_knee", r"within ([\d.]+) mm"),
    "ik_quadruped": ("rear_right_hip", r"within ([\d.]+) mm"),
}


@pytest.mark.parametrize("name", IK)
def test_who_is_told_of_a_lock_misses_no_more_than_without_one_and_who_is_not_a_hundred_times(
    name, tmp_path
):
    joint, pattern = IK[name]
    sound, told, unaware = numbers(printed(name, tmp_path), pattern)
    assert told < 2 * sound < 0.2 and unaware > 100 * told
    assert f'"{joint}"' in (ROOT / "examples" / f"{name}.py").read_text()


def test_of_five_motions_left_in_a_loop_the_place_is_exact_and_the_load_tilts(tmp_path):
    lines = printed("ik_two_arms", tmp_path)
    off = numbers(lines, r"lock: ([\d.]+) mm off")
    tilted = numbers(lines, r"circle, ([\d.]+)° tilted")
    assert max(off) < 0.01 and tilted[0] == 0.0 and min(tilted[1:]) > 1.0


def test_the_speed_left_after_a_lock_is_the_distance_of_the_nearest_face(tmp_path):
    """The reachable velocities are a polytope about zero; a locked joint takes its column away."""
    J = arm_jacobians()[0][3:]
    one = np.ones(7)
    left = [distances(J * (np.arange(7) != k), np.zeros(3), -one, one).min() for k in range(7)]
    part = np.array(left) / distances(J, np.zeros(3), -one, one).min()
    lines = printed("survey", tmp_path)
    assert numbers(lines, r"any of (\d) joints") == [np.count_nonzero(part > 1e-9), 1]
    assert lines[-1].endswith(f"motor{part.argmin() + 1} locked: {100 * part.min():.0f} %")
