"""The hexapod that recordings draw, against MuJoCo's."""

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from experiments.recording.file import rgb
from experiments.recording.hexapod import hexapod_motion, load_colors
from experiments.recording.mechanism import exaggerated, exaggeration, motion_of
from experiments.study.plotting import YELLOW
from sim import Plant, Pose, load_model
from sim.mjcf.model import HEXAPOD_MJCF
from tests import rrd

COMMANDS_M = 1e-4 * np.array([[1, -2, 3, -1, 2, -3], [6, 6, 6, 6, 6, 6], [-4, 4, 0, 0, 2, -2]])


@pytest.mark.parametrize("command_m", COMMANDS_M)
def test_at_true_size_the_drawing_is_what_mujoco_does(model, command_m):
    """From the payload's pose alone, every body is where the physics has it."""
    plant = Plant(model)
    plant.step(command_m, 1.0)
    pose = plant.pose()
    drawn = hexapod_motion(model, Pose(pose.rotation[None], pose.translation_m[None]))
    for k, name in enumerate(drawn.names):
        body = plant.data.body(name)
        np.testing.assert_allclose(drawn.position_m[0, k], body.xpos, atol=2e-8)
        turn = drawn.rotation[0, k].T @ body.xmat.reshape(3, 3)
        # The flexures share a strut's twist about its own line, which a drawing need not show.
        assert Rotation.from_matrix(turn).magnitude() < (1e-9 if name == "payload" else 3e-3)


@pytest.mark.parametrize("factor", [1, 1000])
def test_however_large_the_motion_the_drawn_loops_are_closed(model, factor):
    """Tips stay on the payload's frame, stems in the lines of their struts."""
    rng = np.random.default_rng(0)
    turn = Rotation.from_rotvec(factor * rng.normal(scale=1e-4, size=(20, 3)))
    pose = Pose(turn.as_matrix(), factor * rng.normal(scale=2e-5, size=(20, 3)))
    drawn = hexapod_motion(model, pose)
    nominal = motion_of(model, model.qpos0[None])
    place = {name: k for k, name in enumerate(nominal.names)}
    at = {name: drawn.position_m[:, k] for k, name in enumerate(drawn.names)}
    turned = {name: drawn.rotation[:, k] for k, name in enumerate(drawn.names)}
    payload = place["payload"]
    for k in range(1, 7):
        tip = nominal.position_m[0, place[f"tip{k}"]] - nominal.position_m[0, payload]
        carried = nominal.rotation[0, payload].T @ tip
        expected = at["payload"] + turned["payload"] @ carried
        np.testing.assert_allclose(at[f"tip{k}"], expected, atol=1e-12)
        line = turned[f"stem{k}"][:, :, 2]
        across = np.cross(line, at[f"tip{k}"] - at[f"housing{k}"])
        np.testing.assert_allclose(across, 0, atol=1e-12)


def test_exaggeration_multiplies_every_bodys_displacement():
    """Twice as large twice is four times, and once is the motion itself."""
    model = load_model(HEXAPOD_MJCF.with_name("hand.xml"))
    rng = np.random.default_rng(1)
    motion = motion_of(model, model.qpos0 + rng.normal(scale=1e-3, size=(5, model.nq)))
    nominal = motion_of(model, model.qpos0[None])
    same = exaggerated(motion, nominal, 1)
    np.testing.assert_allclose(same.position_m, motion.position_m, atol=1e-15)
    np.testing.assert_allclose(same.rotation, motion.rotation, atol=1e-12)
    twice = exaggerated(exaggerated(motion, nominal, 2), nominal, 2)
    four = exaggerated(motion, nominal, 4)
    np.testing.assert_allclose(twice.position_m, four.position_m, atol=1e-12)
    np.testing.assert_allclose(twice.rotation, four.rotation, atol=1e-12)


@pytest.mark.parametrize("angle_rad", [1e-9, 1e-4, 3e-3, 0.5])
@pytest.mark.parametrize("way_m", [0.0, 1e-5, 1e-2])
def test_a_motion_is_made_visible_by_a_round_factor_and_never_shrunk(angle_rad, way_m):
    factor = exaggeration(angle_rad, way_m)
    assert str(factor)[0] in "125"
    assert set(str(factor)[1:]) <= {"0"}
    large = max(angle_rad / 0.12, way_m / 0.03)
    assert factor == 1 if large > 1 else 0.4 <= factor * large <= 1.0


def test_struts_are_blue_when_they_pull_red_when_they_push_and_grey_at_rest():
    blue, grey, red = load_colors(np.array([-5.0, 0.0, 5.0]), 5.0).astype(int)
    assert blue[2] > blue[0] + 100
    assert red[0] > red[2] + 100
    assert np.ptp(grey) < 5


def test_colours_and_poses_of_the_recording_are_those_of_the_run(table1_folder, runs, model):
    """25 pictures a second; the motion 1000 times as large, and as it is."""
    run, path = runs["W_b"], table1_folder / "W_b.rrd"
    housing = model.body("housing3").geomadr[0]
    entity = f"/hexapod_x1000/visual_geometries/housing3/geom_{housing}"
    times, colors = rrd.rows(path, entity, "Cylinders3D:colors")
    inputs = run["strut_input_percent"][times // 1_000_000, 2]
    full = np.ceil(np.abs(run["strut_input_percent"]).max())
    packed = load_colors(inputs, full).astype(np.uint32)
    expected = (packed[:, 0] << 24) + (packed[:, 1] << 16) + (packed[:, 2] << 8) + 255
    drawn = np.array([color[0] for color in colors])
    # The first row at time zero is the library's own, in the file's colours.
    np.testing.assert_array_equal(drawn[-399:], expected[-399:])

    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    for factor in (1000, 1):
        where = f"/hexapod_x{factor}/bodies/payload"
        times, places = rrd.rows(path, where, "Transform3D:translation")
        moved = np.array(places)[-399:, 0] - data.body("payload").xpos
        shift = factor * run["secondary"][times[-399:] // 1_000_000, 1:]
        # World axes: y_b and z_b point the other way; float32 is 30 nm at 0.3 m.
        np.testing.assert_allclose(moved, shift * [1, -1, -1], atol=6e-8)


def test_a_failed_strut_wears_a_yellow_collar_and_no_other_does(table1_folder):
    for name, struts in (("W_a", set()), ("W_e", {1})):
        path = table1_folder / f"{name}.rrd"
        worn = {e for e in rrd.entities(path) if e.endswith("/failed") and "x1000" in e}
        assert worn == {f"/hexapod_x1000/bodies/housing{k}/failed" for k in struts}
    times, labels = rrd.rows(path, worn.pop(), "Cylinders3D:labels")
    assert labels[-1] == ["strut 1 locked, corrected"]
    assert times[0] == 0
    assert rgb(YELLOW) == [240, 228, 66]


def test_a_collar_says_when_a_strut_failed_and_when_that_was_found(recover_folder):
    path = recover_folder / "locked.rrd"
    entity = next(e for e in rrd.entities(path) if e.endswith("housing1/failed"))
    times, labels = rrd.rows(path, entity, "Cylinders3D:labels")
    assert [label[0] for label in labels] == ["strut 1 locked", "found: strut 1 locked"]
    assert 0 < times[1] - times[0] < 300_000_000
