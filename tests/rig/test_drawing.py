"""The machine on paper against MuJoCo's, and a run as an animation."""

import io
from collections import Counter

import mujoco
import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image
from scipy.spatial.transform import Rotation

from experiments.app.cli import main
from experiments.figures.machine import figure_machine
from experiments.recording import animation as animations
from experiments.recording.animation import Animation, figure_at, write_animation
from experiments.recording.drawing import COLORS, View, draw_machine, machine, motion_at
from experiments.recording.gif import pixels
from experiments.recording.marks import Mark
from experiments.recording.shown import Shown
from experiments.recording.solids import solid_of
from experiments.rig.hexapod.simulation import Trajectory
from experiments.study.files import write_arrays
from experiments.study.plotting import VERMILION, save_figure
from sim import NOMINAL, Plant, Pose
from sim.mjcf.model import HEXAPOD_MJCF

SHAPES = """<mujoco><asset><mesh name="m" vertex="0 0 0  .1 0 0  0 .2 0  0 0 .3"/></asset>
<worldbody><body pos="1 2 3" euler="10 20 30">
<geom type="sphere" size=".1" pos=".1 0 0"/><geom type="box" size=".1 .2 .3" euler="40 0 0"/>
<geom type="ellipsoid" size=".1 .2 .3"/><geom type="capsule" size=".05 .2" euler="0 50 0"/>
<geom type="cylinder" size=".2 .1" pos="0 .3 0"/><geom type="mesh" mesh="m"/>
<geom type="plane" size="1 1 1"/></body></worldbody></mujoco>"""


def corners_in_world(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> np.ndarray:
    """Faces of a solid (F, 4, 3), as its body stands."""
    solid, body = solid_of(model, geom), model.geom_bodyid[geom]
    assert solid
    world = solid.points_m @ data.xmat[body].reshape(3, 3).T + data.xpos[body]
    return world[solid.faces]


@pytest.mark.parametrize("shape", range(6))
def test_a_solid_is_the_geom_that_mujocos_rays_hit(shape):
    """Rays onto the middle of each face, along its normal: the surface is met there."""
    text = SHAPES.splitlines()
    model = mujoco.MjModel.from_xml_string("\n".join(text))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    for geom in set(range(model.ngeom)) - {shape}:
        model.geom_group[geom] = 5
    corners = corners_in_world(model, data, shape)
    normal = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    unique = [np.unique(face, axis=0).mean(axis=0) for face in corners]
    only, hit = np.array([1, 1, 1, 1, 1, 0], dtype=np.uint8), np.zeros(1, dtype=np.int32)
    for middle, outward in zip(unique, normal, strict=True):
        start = middle + 2 * outward
        distance = mujoco.mj_ray(model, data, start, -outward, only, 1, -1, hit, None)
        assert hit[0] == shape
        assert distance == pytest.approx(2, abs=0.011)  # chords of the round ones lie inside


def test_a_plane_has_no_solid_and_each_edge_two_faces():
    model = mujoco.MjModel.from_xml_string(SHAPES)
    assert solid_of(model, 6) is None
    for geom in range(6):
        solid = solid_of(model, geom)
        assert solid
        vertices = len(np.unique(solid.faces))
        assert vertices - len(solid.edges) + len(solid.faces) == 2  # Euler: closed, no holes
        for (one, other), beside in zip(solid.edges, solid.beside, strict=True):
            assert all({one, other} <= set(solid.faces[face].tolist()) for face in beside)


def test_the_points_drawn_are_where_the_physics_has_them(model):
    """After a step of the plant, from the payload's pose alone; flexures twist by some mrad."""
    plant = Plant(model)
    plant.step(1e-4 * np.array([4, -2, 3, -6, 2, -3]), 1.0)
    pose, drawn = plant.pose(), machine(model)
    motion = motion_at(model, Pose(pose.rotation[None], pose.translation_m[None]))
    placed = drawn.placed(motion, 0)
    data = plant.data
    for body in range(model.nbody):
        own = drawn.bodies == body
        truth = drawn.points_m[own] @ data.xmat[body].reshape(3, 3).T + data.xpos[body]
        assert abs(placed[own] - truth).max(initial=0) < 1e-4
    # They are those of the MJCF: the beam's upper end, and the middle of the detector.
    at = {body: placed[drawn.bodies == body] for body in (0, model.body("payload").id)}
    assert abs(at[0] - [0, 0, 0.39]).sum(axis=1).min() < 2e-3
    detector = data.geom("detector").xpos
    assert abs(at[model.body("payload").id] - detector).max(axis=1).min() < 0.031


def test_the_view_is_a_rotation_of_the_world():
    view = View(azimuth_deg=-90.0, elevation_deg=0.0)
    np.testing.assert_allclose(view.on_paper(np.array([0.3, 7.0, 0.2])), [0.3, 0.2], atol=1e-12)
    points = np.random.default_rng(0).normal(size=(9, 3))
    turned = Rotation.from_euler("zx", [-(90 + 35), -(90 - 20)], degrees=True).apply(points)
    np.testing.assert_allclose(View(35.0, 20.0).on_paper(points), turned[:, :2], atol=1e-12)


def colored(figure: Figure, color: tuple[int, int, int]) -> int:
    """Pixels of about a colour."""
    return int((abs(np.asarray(pixels(figure)).astype(int) - color).max(axis=-1) < 60).sum())


def test_what_is_behind_is_hidden(model):
    """Strut 1 from both sides: in front, and half behind the telescope."""
    shares = []
    for azimuth_deg in (98.0, -82.0):
        figure = Figure(figsize=(3, 3), dpi=100)
        axes = figure.add_axes((0, 0, 1, 1), aspect="equal", xlim=(-0.5, 0.5), ylim=(-0.3, 0.7))
        drawn, motion = machine(model), motion_at(model, NOMINAL.moved(np.zeros((1, 6))))
        view = View(azimuth_deg, 15.0)
        draw_machine(axes, drawn, drawn.placed(motion, 0), view, COLORS | {"strut1": VERMILION})
        shares.append(colored(figure, (190, 90, 30)))
    assert shares[0] > 1.2 * shares[1] > 0


@pytest.mark.long
def test_the_picture_of_the_machine_names_what_it_draws_once(model, tmp_path):
    figure = figure_machine(model)
    words = Counter(text.get_text() for text in figure.axes[0].texts)
    names = [*"123456", "$x_b$", "$y_b$", "$z_b$", "$\\alpha$", "$\\beta$", "$\\gamma$"]
    names += ["$t_x$", "$t_y$", "$t_z$", "base", "payload", "laser", "detector", "line of sight"]
    assert {name: words[name] for name in names} == dict.fromkeys(names, 1)
    assert len(figure.legends) == 1
    for folder in ("one", "other"):
        (tmp_path / folder).mkdir()
        save_figure(figure_machine(model), tmp_path / folder, "machine")
    for kind in ("png", "pdf"):
        one, other = (tmp_path / folder / f"machine.{kind}" for folder in ("one", "other"))
        assert one.read_bytes() == other.read_bytes()


# A run as an animation.

FAILED_S, FOUND_S = 1.5, 1.5235


@pytest.fixture(scope="module")
def run() -> Trajectory:
    """A spiral of 2 s at 1 kHz, made here; strut 1 is no longer driven once it is found."""
    time_s = np.arange(2000) / 1000
    angle = 1e-4 * time_s[:, None] * np.c_[np.cos(6 * time_s), np.sin(6 * time_s)]
    inputs = np.outer(np.sin(time_s), np.ones(6))
    inputs[time_s >= FOUND_S, 0] = 0
    return Trajectory(
        time_s=time_s,
        desired_rad=angle,
        true_rad=0.98 * angle,
        measured_rad=0.98 * angle,
        strut_input_percent=inputs,
        strut_displacement_m=np.zeros((2000, 6)),
        secondary=1e-6 * np.outer(time_s, [1, 2, 3, 4]),
        secondary_estimated=np.zeros((2000, 4)),
        closure_residual_m=np.zeros(2000),
    )


@pytest.fixture(scope="module")
def animated(model, run) -> Animation:
    mark = Mark(0, FAILED_S, "strut 1 locked", FOUND_S, "found: strut 1 locked")
    return Animation(model, Shown(run, [mark]))


def test_the_frames_run_forward_and_stop_at_failure_and_diagnosis(animated):
    frames = animated.frames
    ticks = [frame.tick for frame in frames]
    assert ticks == sorted(set(ticks))
    assert (ticks[0], ticks[-1]) == (0, 1999)
    assert 90 < len(frames) <= 120
    standing = [frame.tick for frame in frames if frame.shown_ms > 1000]
    assert standing == [1500, 1524, 1999]  # the first ticks not before the events, and the end
    assert 8000 < sum(frame.shown_ms for frame in frames) < 12000
    even = Animation(animated.model, Shown(animated.shown.run)).frames
    assert np.ptp(np.diff([frame.tick for frame in even])) <= 1


def words(figure: Figure) -> str:
    return "\n".join(text.get_text() for text in figure.texts)


def test_a_frame_says_what_is_known_then_and_by_what_the_motion_is_magnified(animated):
    assert "all six struts sound" in words(figure_at(animated, 1499))
    assert "strut 1 locked at 1.50 s, unannounced" in words(figure_at(animated, 1500))
    found = words(figure_at(animated, 1524))
    assert "found after 24 ms: strut 1 locked; mapping reconfigured, 5 struts go on" in found
    assert f"motion magnified {animated.factor} times" in found
    assert colored(figure_at(animated, 1499), (190, 90, 30)) < 20
    assert colored(figure_at(animated, 1500), (190, 90, 30)) > 300


def test_the_line_of_sight_is_drawn_at_its_true_pose_times_the_factor(animated, run):
    """Its end, by rotation matrices of scipy's, seen by the same view."""
    for tick in (0, 700, 1999):
        machine_axes, detector, error = figure_at(animated, tick).axes
        twist = animated.factor * np.r_[run.true_rad[tick], run.secondary[tick]]
        to_world = np.diag([1.0, -1.0, -1.0])  # base axes: half a turn about x
        payload = animated.model.body("payload").pos
        reach = Rotation.from_rotvec(twist[:3]).apply([0, 0, -0.45])
        end = payload + to_world @ (twist[3:] + reach)
        place = np.asarray(machine_axes.lines[-1].get_xydata())[0]
        np.testing.assert_allclose(place, View(98.0, 22.0).on_paper(end), atol=1e-9)
        curves = detector.lines[1], error.lines[0]
        assert [np.size(curve.get_xdata()) for curve in curves] == [tick + 1, tick + 1]
        assert [bool(axes.get_legend()) for axes in (machine_axes, detector, error)] == [
            False,
            True,
            False,
        ]


@pytest.mark.long
def test_an_animation_is_small_repeats_and_is_the_same_file_every_time(
    animated, tmp_path, monkeypatch
):
    monkeypatch.setattr(animations, "FRAMES", 4)
    few, done = Animation(animated.model, animated.shown), []
    for name in ("one.gif", "other.gif"):
        write_animation(tmp_path / name, few, lambda *both: done.append(both))
    one = (tmp_path / "one.gif").read_bytes()
    assert one == (tmp_path / "other.gif").read_bytes()
    assert len(one) * 120 / len(few.frames) < 3e6
    assert done[-1] == (len(few.frames), len(few.frames))
    picture = Image.open(io.BytesIO(one))
    assert getattr(picture, "n_frames", 1) == len(few.frames)
    assert 640 <= picture.width <= 800
    assert picture.info["loop"] == 0
    assert picture.convert("RGB").getpixel((2, 2)) == (255, 255, 255)


def test_the_command_writes_the_animation_of_a_run(run, tmp_path, monkeypatch):
    monkeypatch.setattr(animations, "FRAMES", 3)
    write_arrays(tmp_path / "run.npz", vars(run))
    out = tmp_path / "new" / "run.gif"
    assert main(["animate", str(tmp_path / "run.npz"), "--out", str(out)]) == 0
    assert out.read_bytes()[:6] == b"GIF89a"
    assert [path.name for path in out.parent.iterdir()] == ["run.gif"]


@pytest.mark.parametrize(
    ("name", "options", "said"),
    [
        ("run.npz", ["--out", "run.png"], "must end in .gif"),
        ("text.npz", [], "is not a readable .npz"),
        ("other.npz", [], "is not a run of the hexapod"),
        ("missing.npz", [], "there is no file"),
        ("run.npz", ["--model", str(HEXAPOD_MJCF.with_name("arm.xml"))], "six actuators"),
    ],
)
def test_what_cannot_be_animated_is_one_sentence(capsys, run, tmp_path, name, options, said):
    write_arrays(tmp_path / "run.npz", vars(run))
    write_arrays(tmp_path / "other.npz", {"x": np.zeros(3)})
    (tmp_path / "text.npz").write_text("text")
    out = ["--out", str(tmp_path / "new" / "a.gif")]
    assert main(["animate", str(tmp_path / name), *out, *options]) == 2
    told = capsys.readouterr().err
    assert told.startswith("fjh: ")
    assert told.count("\n") == 1
    assert said in told
    assert not (tmp_path / "new").exists()
