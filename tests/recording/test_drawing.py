"""The machine on paper against MuJoCo's."""

from collections import Counter

import mujoco
import numpy as np
import pytest
from matplotlib.figure import Figure
from scipy.spatial.transform import Rotation

from experiments.figures.machine import figure_machine
from experiments.recording.drawing import COLORS, View, draw_machine, machine
from experiments.recording.gif import pixels
from experiments.recording.motion import hexapod_mover
from experiments.recording.solids import solid_of
from experiments.study.palette import VERMILION
from experiments.study.plotting import save_figure
from sim import NOMINAL, Plant, Pose

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
    motion = hexapod_mover(model)(Pose(pose.rotation[None], pose.translation_m[None]))
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
        drawn, motion = machine(model), hexapod_mover(model)(NOMINAL.moved(np.zeros((1, 6))))
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
