"""Tests that the examples run in an empty folder and print what independent laws give."""

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
from tests.published.faces import distances

ROOT = Path(__file__).parents[2]
pytestmark = pytest.mark.long
FIRST = {"Matplotlib is building the font cache; this may take a moment."}
"""Message of the first process on a computer, if its search for fonts takes over 5 s."""


def test_the_notebook_is_generated_from_its_script(tmp_path):
    (notebook,) = (ROOT / "examples").glob("*.ipynb")
    script = tmp_path / f"{notebook.stem}.py"
    script.write_text((ROOT / "examples" / script.name).read_text())
    python_to_jupyter_cli([str(script)])
    files = script.with_suffix(".ipynb"), notebook
    made, published = (json.loads(file.read_text()) for file in files)
    assert published["cells"] == made["cells"]  # other entries have the version of Python


def printed(name: str, folder: Path) -> list[str]:
    """Return the lines that an example prints in an empty folder, and check its picture."""
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
    """Return the number in each line that matches a pattern."""
    return [float(match[1]) for line in lines if (match := re.search(pattern, line))]


@pytest.mark.parametrize(
    ("name", "pattern", "expected"),
    [
        # Six equal struts share two motions: the diagonal of the projector is 2 / 6.
        ("hexapod_lock", r"off by ([\d.]+) mrad", [0.333, 0.0]),
        # Opposite legs share each direction; without one of them the other bears the whole force.
        ("force", r": (\d+) N in", [200, 100]),
        # Numbers of locked joints up to which the camera, then the elbow, has a solution.
        ("hierarchy", r"up to (\d) joints", [5, 2, 1]),
        # Roll and yaw within the faces; Du, Quan, Yang, Cai: PNPNPN has none without a rotor.
        ("multirotor", r"can.* be controlled, ([\d.]+) N m", [1.50, 0.0, 1.20, 0.87]),
    ],
)
def test_an_example_prints_the_derived_numbers(name, pattern, expected, tmp_path):
    assert numbers(printed(name, tmp_path), pattern) == expected


def camera() -> np.ndarray:
    """Return rows [angular; linear] of the arm's camera in the axes `base`, by MuJoCo alone."""
    model = mujoco.MjModel.from_xml_path(str(MODELS / "arm.xml"))
    data, J = mujoco.MjData(model), np.zeros((2, 3, model.nv))
    mujoco.mj_forward(model, data)
    mujoco.mj_jacSite(model, data, J[1], J[0], model.site("payload").id)
    return (data.site("base").xmat.reshape(3, 3).T @ J).reshape(6, -1)


def test_the_speeds_of_the_camera_are_those_of_a_linear_program(tmp_path):
    J, d = camera()[:2], np.array([0.6, 0.8])
    fastest = linprog(
        [*np.zeros(7), -1],
        A_eq=np.column_stack([J, -d]),
        b_eq=[0, 0],
        bounds=[(-1, 1)] * 7 + [(0, None)],
    ).x[-1]
    at_limit = 1 / np.abs(np.linalg.pinv(J) @ d).max()
    speeds = numbers(printed("limits", tmp_path), r"up to ([\d.]+) rad/s")
    np.testing.assert_allclose(speeds, [at_limit, at_limit, fastest], atol=0.011)


def test_a_supervisor_identifies_the_lock_and_has_a_tenth_of_the_error(tmp_path):
    lines = printed("own_arm", tmp_path)
    assert 0.8 < numbers(lines, r"motor4 was identified as locked at ([\d.]+) s")[0] < 1.3
    undiagnosed, supervised = numbers(lines, r"RMS error ([\d.]+) mrad")
    assert supervised < 0.1 * undiagnosed


def test_both_controllers_track_and_the_supervisor_identifies_the_strut(tmp_path):
    lines = printed("other_controller", tmp_path)
    other, supervisor = numbers(lines, r"([\d.]+) µrad RMS")
    assert supervisor < other < 100 and "strut1 was identified as locked at 1.0" in lines[1]


def test_only_the_locked_motor_of_the_recorded_arm_is_at_rest(tmp_path):
    printed("recording", tmp_path)
    with np.load(tmp_path / "recording.npz") as run:
        moved = run["displacement"][1050:]
    at_rest = np.abs(moved - moved[0]).max(axis=0) < 1e-4  # [rad], after the lock
    assert at_rest.tolist() == [False, True, *[False] * 5]


@pytest.mark.parametrize("name", ["ik_arm", "ik_mobile", "ik_humanoid", "ik_quadruped"])
def test_an_unknown_lock_has_a_hundred_times_the_error_of_a_known_one(name, tmp_path):
    healthy, informed, undiagnosed = numbers(printed(name, tmp_path), r"within ([\d.]+) mm")
    assert informed < 2 * healthy < 0.2 and undiagnosed > 100 * informed


def test_with_five_motions_in_a_loop_the_place_is_exact_and_the_load_tilts(tmp_path):
    lines = printed("ik_two_arms", tmp_path)
    off = numbers(lines, r"lock: ([\d.]+) mm off")
    tilted = numbers(lines, r"circle, ([\d.]+)° tilted")
    assert max(off) < 0.01 and tilted[0] == 0.0 and min(tilted[1:]) > 1.0


def test_the_speed_after_a_lock_is_the_distance_of_the_nearest_face(tmp_path):
    """The reachable velocities are a polytope about zero; a locked joint removes its column."""
    J, one = camera()[3:], np.ones(7)
    left = [distances(J * (np.arange(7) != k), np.zeros(3), -one, one).min() for k in range(7)]
    part = np.array(left) / distances(J, np.zeros(3), -one, one).min()
    lines = printed("survey", tmp_path)
    assert numbers(lines, r"any of (\d) joints") == [np.count_nonzero(part > 1e-9), 1]
    assert lines[-1].endswith(f"motor{part.argmin() + 1} locked: {100 * part.min():.0f} %")
