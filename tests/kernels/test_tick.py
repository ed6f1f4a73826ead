"""The compiled parts of a simulated tick, against numpy and scipy over random poses."""

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fjh.rig.hexapod.closed_form import Hexapod
from kernels import Struct, lib, pointer
from sim import Bench, Plant, Pose, load_model
from sim.plant import TaskSensor

seeds = pytest.mark.parametrize("seed", range(8))


def machine(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Bottom and top nodes of struts that are long enough to have a direction."""
    bottom, top = rng.normal(size=(2, 6, 3))
    return bottom - [0, 0, 5], top


def pose(rng: np.random.Generator, *batch: int) -> Pose:
    turns = Rotation.random(int(np.prod(batch)), rng=rng).as_matrix()
    return Pose(turns.reshape(*batch, 3, 3), rng.normal(size=(*batch, 3)))


@seeds
def test_a_strut_has_the_length_between_its_nodes(seed):
    rng = np.random.default_rng(seed)
    (bottom, top), at = machine(rng), pose(rng, 4)
    length, A = Hexapod(bottom, top).lengths_and_jacobian(at)
    arms = np.einsum("bij,kj->bki", at.rotation, top)
    struts_m = arms + at.translation_m[:, None] - bottom
    by_hand = np.linalg.norm(struts_m, axis=-1)
    u = struts_m / by_hand[..., None]
    np.testing.assert_allclose(length, by_hand, rtol=1e-14)
    rows = np.concatenate([np.cross(arms, u), u], axis=-1)
    np.testing.assert_allclose(A, rows, atol=1e-14)


@pytest.mark.parametrize("angle", [0.0, 1e-200, 1e-12, 1e-5, 0.3, 3.0, np.pi, 40.0])
def test_a_pose_turns_about_its_rotation_vector_and_then_shifts(angle):
    rng = np.random.default_rng(1)
    at, axis = pose(rng, 5), rng.normal(size=(5, 3))
    turn = angle * axis / np.linalg.norm(axis, axis=1, keepdims=True)
    moved = at.moved(np.concatenate([turn, axis], axis=1))
    expected = Rotation.from_rotvec(turn).as_matrix() @ at.rotation
    np.testing.assert_allclose(moved.rotation, expected, atol=2e-14)
    np.testing.assert_array_equal(moved.translation_m, at.translation_m + axis)


def test_a_pose_stays_a_rotation_over_a_thousand_ticks():
    """Round-off of a steady turn does not add up; `secondary_motion` refuses 1e-6."""
    R, t, twist = np.eye(3)[None], np.zeros((1, 3)), np.array([[3e-5, -2e-5, 1e-5, 0.0, 0.0, 0.0]])
    for _ in range(1_000):
        lib.move(1, *map(pointer, (R, t, twist, R, t)))
    assert np.abs(R[0] @ R[0].T - np.eye(3)).max() < 2e-14


@seeds
def test_a_step_ends_where_the_twist_of_the_missing_lengths_leads(seed):
    """And the struts follow to second order of the step."""
    rng = np.random.default_rng(seed)
    geometry, at = Hexapod(*machine(rng)), pose(rng)
    here = geometry.posture(at)
    asked = here.displacement_m + 1e-6 * rng.normal(size=6)
    twist = np.linalg.solve(here.inverse_jacobian, asked - here.displacement_m)
    there, expected = geometry.moved(at, asked), geometry.posture(at.moved(twist))
    size = np.linalg.cond(here.inverse_jacobian)
    for name in ("rotation", "translation_m", "displacement_m", "inverse_jacobian"):
        close = {"atol": 1e-15 * size, "rtol": 1e-13}
        np.testing.assert_allclose(getattr(there, name), getattr(expected, name), **close)
    change, missed = here.inverse_jacobian @ rng.normal(size=6), []
    for step in (1e-3, 1e-4):
        asked = here.displacement_m + step * change
        missed.append(np.abs(geometry.moved(at, asked).displacement_m - asked).max())
    assert missed[0] / missed[1] == pytest.approx(100, rel=0.2)


SHIFTED = np.roll(np.eye(6), 1, axis=0) + 1e-14 * np.arange(1.0, 37).reshape(6, 6)
"""A well-conditioned matrix with small numbers on its diagonal, which cost no digits."""


@pytest.mark.parametrize("A", [SHIFTED, *np.random.default_rng(6).normal(size=(20, 6, 6))])
def test_the_twist_is_the_solution_of_linear_algebra(A):
    b = np.arange(1.0, 7)
    before, x = A.copy(), b.copy()
    assert lib.strut_twist(pointer(A), pointer(x))
    np.testing.assert_array_equal(A, before)
    np.testing.assert_allclose(x, np.linalg.solve(A, b), rtol=1e-11, atol=1e-13)


def test_struts_without_length_or_direction_are_refused():
    bottom, top = machine(np.random.default_rng(0))
    parallel = Hexapod(top - [0, 0, 1], top)  # nothing holds a horizontal shift
    with pytest.raises(ValueError, match="must not be singular"):
        parallel.moved(Pose(np.eye(3), np.zeros(3)), np.full(6, 1e-3))
    top[2] = bottom[2]
    with pytest.raises(ValueError, match="one whose nodes coincide"):
        Hexapod(bottom, top).posture(Pose(np.eye(3), np.zeros(3)))


@seeds
def test_the_base_sees_how_a_frame_has_moved_since_its_nominal_pose(seed):
    rng = np.random.default_rng(seed)
    frames, (base,), (nominal,) = pose(rng, 4), pose(rng, 1).rotation, pose(rng, 1).rotation
    R, t, p_0 = np.empty((3, 3)), np.empty(3), rng.normal(size=3)
    to_frame = np.ascontiguousarray(nominal.T)
    given = frames.rotation[2], frames.translation_m[2], base, to_frame, p_0
    lib.seen_from(*map(pointer, (*given, R, t)))
    in_world = frames.rotation[2] @ nominal.T
    np.testing.assert_allclose(R, base.T @ in_world @ base, atol=1e-14)
    np.testing.assert_allclose(t, base.T @ (frames.translation_m[2] - p_0), atol=1e-14)


@seeds
def test_the_spot_is_where_the_beam_crosses_the_focal_plane(seed):
    rng = np.random.default_rng(seed)
    R, noise, seen = pose(rng).rotation, rng.normal(size=2), np.empty(2)
    focal, half_width, deviation = 2.0, 1.5, 0.1
    lib.spot(pointer(R), focal, half_width, deviation, pointer(noise), pointer(seen))
    beam = np.linalg.solve(R, [0.0, 0.0, 1.0])
    spot = np.clip(focal * beam[:2] / beam[2] + deviation * noise, -half_width, half_width)
    np.testing.assert_allclose(seen, np.array([spot[1], -spot[0]]) / focal, rtol=1e-12)


def test_the_largest_gap_is_that_of_the_rows_that_count():
    rng = np.random.default_rng(0)
    gaps, counts = rng.normal(size=20), np.array([1.0, 0.0, 1.0])
    owners = rng.integers(3, size=20).astype(np.int32)
    for rows in range(21):
        own = [abs(gap) for gap, owner in zip(gaps[:rows], owners, strict=False) if owner != 1]
        found = lib.largest_gap(*map(pointer, (gaps, owners, counts)), rows)
        assert found == max(own, default=0.0)


@pytest.mark.parametrize("bad", [0.0, np.nan, np.inf])
def test_the_largest_gap_in_its_unit_hides_none_that_is_not_finite(bad):
    gaps, units = np.random.default_rng(0).normal(size=(2, 9))
    gaps[4] += bad
    found = lib.largest(pointer(gaps), pointer(units), 7)
    np.testing.assert_array_equal(found, np.abs(gaps * units)[:7].max())


MIXED = """<mujoco><worldbody><body><joint name="j" axis="0 1 0" stiffness="9"/>
<geom size=".1"/><site name="payload" pos="1 0 0"/>
<body pos="1 0 0"><joint name="t" axis="0 1 0"/><geom size=".1"/></body></body></worldbody>
<tendon><fixed name="t" stiffness="5"><joint joint="t" coef="2"/></fixed></tendon>
<equality><joint name="lock2" joint1="j" active="false"/></equality>
<actuator><position tendon="t" gear="3" kp="40"/><motor joint="j"/></actuator></mujoco>"""
"""Drives of both kinds, a tendon first; seen from the world."""


@pytest.mark.parametrize("mixed", [False, True], ids=["hexapod", "tendon and joint"])
def test_a_log_has_what_the_plant_says_of_itself_at_each_tick(mixed):
    model = mujoco.MjModel.from_xml_string(MIXED) if mixed else load_model()
    plant = Plant(model, base=None) if mixed else Plant(model)
    sensors, period_s = TaskSensor([0], 0.0, 0.0, seed=0), plant.model.opt.timestep * 4
    bench = Bench(plant, sensors, time_s=np.arange(3.0), period_s=period_s, keep_qpos=True)
    for tick in range(3):
        bench.measure()
        assert bench.qpos is not None and bench.actuator_force is not None
        np.testing.assert_array_equal(bench.rotation[tick], plant.pose().rotation)
        np.testing.assert_array_equal(bench.translation_m[tick], plant.pose().translation_m)
        np.testing.assert_array_equal(bench.displacement[tick], plant.displacements())
        np.testing.assert_array_equal(bench.qpos[tick], plant.data.qpos)
        np.testing.assert_array_equal(bench.actuator_force[tick], plant.data.actuator_force)
        assert bench.closure_residual_m[tick] == plant.closure_residual_m()
        bench.apply(1e-5 * np.arange(len(plant.drives)))
    assert np.abs(bench.displacement[2]).max() > 1e-8
    with pytest.raises(IndexError):
        bench.measure()


@pytest.mark.parametrize("whole", [False, True])
def test_a_converter_scales_rounds_and_clips(whole):
    x, y = np.random.default_rng(0).normal(size=200), np.empty(200)
    by = Struct("conversion", factor=3.0, lower=-2.0, upper=1.5, gain=10.0, whole=whole)
    lib.convert(by.pointer, 200, pointer(x), pointer(y))
    scaled = np.rint(3.0 * x) if whole else 3.0 * x
    np.testing.assert_array_equal(y, 10.0 * np.clip(scaled, -2.0, 1.5))
    assert {-20.0, 15.0} < set(y)


def test_rows_at_the_midpoint_move_each_pair_by_half_of_its_gap():
    rng = np.random.default_rng(1)
    gaps, axes, J = rng.normal(size=8), rng.normal(size=(5, 6)), rng.normal(size=(8, 5))
    points = np.array([1, 2, 3, 5, 6, 7])
    carried = np.repeat(rng.integers(0, 3, size=(2, 5)), 3, axis=0).astype(float)
    expected = J.copy()
    for own in points.reshape(2, 3):
        expected[own] += carried[own[0] // 4 * 3] * np.cross(gaps[own] / 2, axes[:, :3]).T
    given = pointer(gaps), pointer(axes), 5, pointer(points), 6, pointer(carried)
    lib.at_midpoints(*given, pointer(J))
    np.testing.assert_allclose(J, expected, rtol=1e-14)
