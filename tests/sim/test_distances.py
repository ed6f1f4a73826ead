"""Distances between geoms, their rates and safe steps, compared with MuJoCo."""

import mujoco
import numpy as np
import pytest

from sim import Body, Distances, ModelError
from tests.scenes import PAIRS, arm_among, distances_of, moved, two

SMOOTH = {"ellipsoid", "cylinder"}
"""Shapes whose depth of penetration MuJoCo computes approximately."""
RADIUS_M = 0.05
"""Radius of a capsule: deeper in a box, where its axis is inside, rows may be wrong."""


@pytest.mark.parametrize("poses", [6, pytest.param(20, marks=pytest.mark.long)])
def test_the_rows_are_the_slopes_of_the_distance_on_the_manifold(poses):
    """The scenes have all pairs of shapes on slides, hinges, balls and free bodies."""
    rng, h = np.random.default_rng(0), 1e-5
    seen = {"apart": 0, "overlapping": 0}
    for first, second in PAIRS:
        model = two(first, second)
        data, distances = mujoco.MjData(model), Distances(model, detection_m=1.0)
        for _ in range(poses):
            data.qpos[:] = moved(model, model.qpos0, rng.normal(scale=0.2, size=model.nv))
            (distance,), (row,), _ = near = distances.at(data)
            axis_inside = {first, second} == {"capsule", "box"} and distance < -RADIUS_M + 1e-9
            if axis_inside or (distance < 0 and SMOOTH & {first, second}):
                continue
            step = rng.normal(size=model.nv)
            step *= h / np.linalg.norm(step)
            ends = [moved(model, data.qpos, sign * step) for sign in (1, -1)]
            after, before = (distances_of(model, q, near.pairs, 1.0)[0] for q in ends)
            sides = (after - distance) / h, (distance - before) / h  # another pair of corners
            assert min(sides) - 2e-3 < row @ step / h < max(sides) + 2e-3
            seen["apart" if distance > 0 else "overlapping"] += 1
    assert min(seen.values()) > 2 * poses


@pytest.mark.parametrize("second", ["sphere", "capsule", "box", "plane", "cylinder"])
def test_the_row_of_a_sphere_in_another_geom_is_that_of_their_contact(second):
    """The row of a frictionless contact in MuJoCo's solver is the rate of the distance."""
    model, rng, samples = two("sphere", second), np.random.default_rng(0), 0
    model.geom_condim[:], model.opt.cone = 1, mujoco.mjtCone.mjCONE_ELLIPTIC
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    data, distances = mujoco.MjData(model), Distances(model)
    for _ in range(100):
        data.qpos[:] = moved(model, model.qpos0, rng.normal(scale=0.1, size=model.nv))
        mujoco.mj_forward(model, data)
        near = distances.at(data)
        if data.ncon and near.distance_m[0] < 0:
            assert near.distance_m == pytest.approx(data.contact.dist, abs=1e-12)
            of_contact = data.efc_J.reshape(-1, model.nv)
            np.testing.assert_allclose(near.rows, of_contact, atol=1e-9)
            samples += 1
    assert samples > 10


@pytest.mark.parametrize("other", ["sphere", "capsule", "box", "mesh", "plane"])
def test_touching_geoms_separate_along_the_line_of_approach(other):
    """The witness points coincide and have no direction."""
    model, rng = two("box", other), np.random.default_rng(0)
    data, distances = mujoco.MjData(model), Distances(model, detection_m=1.0)
    away = np.eye(model.nv)[0 if other == "plane" else 5]
    turned = moved(model, model.qpos0, rng.normal(size=model.nv) * (away == 0))
    turned[6:9] = 0.0  # a floating geom starts inside the other one
    rows = {}
    for height in (1e-5, 0.0):
        low, high = 0.0, 1.0
        for _ in range(60):
            middle = (low + high) / 2
            data.qpos[:] = moved(model, turned, middle * away)
            is_high = distances.at(data).distance_m[0] > height
            low, high = (low, middle) if is_high else (middle, high)
        rows[height] = distances.at(data)
    assert abs(rows[0.0].distance_m[0]) < 1e-12
    np.testing.assert_allclose(rows[0.0].rows, rows[1e-5].rows, atol=1e-3)


def test_geoms_excluded_by_bounding_spheres_are_not_near():
    rng, counts = np.random.default_rng(0), []
    for _ in range(40):
        model = arm_among(12, rng)
        data, distances = mujoco.MjData(model), Distances(model, detection_m=0.1)
        data.qpos[:] = rng.uniform(-2, 2, size=model.nq)
        near, pairs = distances.at(data), distances.geom_pairs
        every = distances_of(model, data.qpos, pairs, 1.0)
        np.testing.assert_array_equal(near.pairs, pairs[every < 0.1])
        np.testing.assert_allclose(near.distance_m, every[every < 0.1], atol=1e-9)
        counts.append((len(near.pairs), len(pairs)))
    assert np.sum(counts, axis=0)[0] > 50 and np.sum(counts, axis=0)[1] > 1000


def crowd(rng: np.random.Generator) -> str:
    """Create nine bodies in random trees at one place, some of them welded."""
    open_tags, xml = 0, '<geom contype="1" conaffinity="3"/><body name="b0"><geom/></body>'
    for k in range(1, 9):
        joint = '<joint axis="1 0 0"/>' if rng.random() < 0.7 else ""
        bits = rng.integers(0, 4, size=2)
        xml += f'<body name="b{k}">{joint}<geom contype="{bits[0]}" conaffinity="{bits[1]}"/>'
        xml += '<geom name="twin"/>' if k == 5 else ""
        open_tags += 1
        for _ in range(rng.integers(0, open_tags + 1)):
            xml, open_tags = xml + "</body>", open_tags - 1
    contact = '<exclude body1="b7" body2="b2"/><exclude body1="b3" body2="b8"/>'
    contact += '<pair geom1="twin" geom2="listed"/>'
    listed = '<body name="own"><joint/><geom name="listed" contype="0" conaffinity="0"/></body>'
    bodies = f"<worldbody>{xml}{'</body>' * open_tags}{listed}</worldbody>"
    return (
        f'<mujoco><default><geom size="0.1" mass="1"/></default>{bodies}'
        f"<contact>{contact}</contact></mujoco>"
    )


@pytest.mark.parametrize("filtered", [True, False])
def test_the_pairs_of_a_model_are_those_that_can_collide_in_mujoco(filtered):
    """The geoms are all in one place, so that all that can collide do."""
    rng = np.random.default_rng(0)
    for _ in range(30):
        model = mujoco.MjModel.from_xml_string(crowd(rng))
        if not filtered:
            model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_FILTERPARENT)
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        colliding = {tuple(sorted(pair)) for pair in data.contact.geom.tolist()}
        assert set(map(tuple, Distances(model).geom_pairs.tolist())) == colliding


TREE = """<mujoco><default><geom size="0.1"/></default><worldbody>
  <body name="left"><freejoint/><geom name="left1"/><body name="hand" pos="1 0 0"><joint/>
    <geom name="left2"/><body name="tip"><joint/><geom name="left3"/></body></body></body>
  <body name="right"><freejoint/><geom name="r1"/><geom name="air" contype="0" conaffinity="0"/>
  </body></worldbody></mujoco>"""


def pairs_of(*pairs) -> list[list[int]]:
    return Distances(mujoco.MjModel.from_xml_string(TREE), list(pairs)).geom_pairs.tolist()


def test_groups_are_geoms_and_bodies_with_their_subtrees():
    once = [[0, 3], [1, 3]]
    assert pairs_of((["left1", "left2"], ["r1"]), (["left1"], ["r1"]), (["r1"], ["left1"])) == once
    assert pairs_of((["left1"], ["r1"])) == pairs_of(([0], [np.int64(3)])) == [[0, 3]]
    assert pairs_of(([Body("left")], ["r1", "air"])) == [[0, 3], [1, 3], [2, 3]]
    assert pairs_of(([Body("hand")], [Body(4)])) == [[1, 3], [2, 3]]
    everything = [Body("left"), Body("right")]
    every = [[0, 2], [0, 3], [1, 3], [2, 3]]  # except parents
    assert pairs_of((everything, everything)) == every


@pytest.mark.parametrize(
    ("pairs", "pattern"),
    [
        ([(["lift1"], ["r1"])], 'no geom named "lift1".*did you mean "left1"'),
        ([([Body("rigt")], ["r1"])], 'no body named "rigt".*did you mean "right"'),
        ([(["left1"], ["air"])], "pairs must name two geoms that .* collide"),
    ],
)
def test_invalid_pairs_are_rejected(pairs, pattern):
    with pytest.raises(ModelError, match=pattern):
        pairs_of(*pairs)


def test_a_margin_beyond_the_distance_of_detection_is_rejected():
    with pytest.raises(ValueError, match="margin_m must be below detection_m"):
        Distances(two("box", "plane"), margin_m=0.05)


@pytest.mark.long
def test_a_signed_distance_field_is_rejected():
    torus = mujoco.MjModel.from_xml_string("""<mujoco>
      <extension><plugin plugin="mujoco.sdf.torus"><instance name="torus"/></plugin></extension>
      <asset><mesh name="torus"><plugin instance="torus"/></mesh></asset>
      <worldbody><body><freejoint/><geom size="0.1"/></body>
        <body><freejoint/><geom type="sdf" mesh="torus"><plugin instance="torus"/></geom></body>
      </worldbody></mujoco>""")
    with pytest.raises(ModelError, match="signed distance field, got geom number 1"):
        Distances(torus)


MARGIN_M, DT = 0.01, 0.05


def check_scene(seed: int) -> float:
    """Check that the safe fraction of a fast step is safe, and twice as much is not."""
    rng = np.random.default_rng([seed, 2003])
    model = arm_among(int(rng.integers(1, 12)), rng)
    data, distances = mujoco.MjData(model), Distances(model, margin_m=MARGIN_M)
    data.qpos[:] = start = rng.uniform(-2, 2, size=model.nq)
    qvel = rng.normal(scale=10.0, size=model.nv)
    before = distances_of(model, start, distances.geom_pairs, 1.0)

    def safe(fraction: float) -> np.ndarray:
        there = moved(model, start, fraction * DT * qvel)
        after = distances_of(model, there, distances.geom_pairs, 1.0)
        return after >= np.minimum(before, MARGIN_M) - 2e-9

    fraction = distances.safe_fraction(data, qvel, DT)
    assert safe(fraction).all()
    if fraction < 1.0:
        assert not safe(2 * fraction if fraction else 2.0**-10).all()
    fresh = mujoco.MjData(model)
    fresh.qpos[:] = start
    mujoco.mj_kinematics(model, fresh)
    for name in ("qpos", "geom_xpos", "geom_xmat"):
        np.testing.assert_array_equal(getattr(data, name), getattr(fresh, name))
    return fraction


@pytest.mark.parametrize("scenes", [50, pytest.param(1000, marks=pytest.mark.long)])
def test_after_the_safe_fraction_of_a_step_no_pair_is_nearer_than_allowed(scenes):
    fractions = {check_scene(seed) for seed in range(scenes)}
    assert len(fractions) > (4 if scenes < 1000 else 6)


BEAM = """<mujoco><worldbody><geom type="plane" size="1 1 1"/><body pos="0 0 0.1">
  <joint type="slide" axis="0 0 1"/><joint axis="0 1 0"/>
  <geom type="box" size="0.5 0.1 0.05"/></body></worldbody></mujoco>"""


def test_a_turn_about_the_nearest_corner_lowers_the_other_one():
    """The row is that of the nearest corner, and allows a step through the floor."""
    model = mujoco.MjModel.from_xml_string(BEAM)
    data, distances = mujoco.MjData(model), Distances(model, margin_m=MARGIN_M, detection_m=0.1)
    data.qpos[1] = 0.01
    near, qvel = distances.at(data), np.array([0.0, -2.0])
    lower = -distances.gain / DT * (near.distance_m - MARGIN_M)
    assert (near.rows @ qvel >= lower).all()
    assert distances_of(model, data.qpos + DT * qvel, distances.geom_pairs, 1.0) < MARGIN_M
    assert 0.0 < distances.safe_fraction(data, qvel, DT) < 1.0


def test_a_zero_step_and_a_step_away_are_safe_from_any_start():
    model = mujoco.MjModel.from_xml_string(BEAM)
    data, distances = mujoco.MjData(model), Distances(model, margin_m=MARGIN_M)
    for depth in (0.0, 0.045, 0.05, 0.12):
        data.qpos[:] = -depth, 0.2
        assert distances.safe_fraction(data, np.zeros(2), DT) == 1.0
        assert distances.safe_fraction(data, [1.0, 0.0], DT) == 1.0
