"""What limits cost: attainable sets that are known by hand, their verdicts, and the atlas."""

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prioritized import ConstrainedSystem, failure_atlas
from prioritized._analysis.attainable import AttainableStatus
from sim import jacobians
from tests.random_systems import (
    SEEDS,
    failures,
    null,
    pairs,
    rows_of,
    springs,
    systems,
    with_stiffness,
)

ARM = ConstrainedSystem(np.eye(2), None, [0, 1])
GEARED = ConstrainedSystem([[1.0, 0.0]], [[1.0, 1.0]], [0, 1])
"""Two motors on one shaft, turning against each other: their rates add to zero."""


def assert_set(a, status: AttainableStatus, radius: float, support, direction=(1.0,)) -> None:
    assert a.status is status
    assert a.radius == pytest.approx(radius, abs=1e-12)
    assert a.support(direction) == pytest.approx(support, abs=1e-12)
    assert str(a).startswith(status.value[:1].upper())


def test_two_joints_at_right_angles_make_a_square():
    """Each joint moves one axis: the corners are those of the limits, the ball touches sides."""
    a = ARM.kinematics().attainable([0, 1], ([-1, -2], [3, 4]))
    assert_set(a, AttainableStatus.INTERIOR, 1.0, 7.0, [1, 1])
    corners = [[-1, -2], [3, -2], [3, 4], [-1, 4]]
    start = corners.index(a.vertices.round(9).tolist()[0])
    np.testing.assert_allclose(a.vertices, np.roll(corners, -start, axis=0), atol=1e-12)


@given(st.integers(3, 8), st.floats(0.1, 10.0))
def test_joints_all_around_make_a_polygon_with_twice_as_many_sides(n, rate):
    """Directions 180/n degrees apart: a regular polygon of known apothem."""
    angle = np.pi * np.arange(n) / n
    arm = ConstrainedSystem([np.cos(angle), np.sin(angle)], None, range(n))
    a = arm.kinematics().attainable([0, 1], (-rate, rate))
    side, sides = 2 * rate, 2 * n
    assert len(a.vertices) == sides
    np.testing.assert_allclose(a.radius, side / (2 * np.tan(np.pi / sides)), rtol=1e-9)
    edges = np.roll(a.vertices, -1, axis=0) - a.vertices
    np.testing.assert_allclose(np.linalg.norm(edges, axis=1), side, rtol=1e-9)
    locked = arm.with_failures(locked=[0]).kinematics().attainable([0, 1], (-rate, rate))
    assert locked.radius < a.radius


@given(st.floats(-9.0, 0.0))
def test_the_speed_of_an_arm_falls_to_zero_as_it_stretches_out(exponent):
    """A parallelogram's height; at the singularity itself the direction is out of reach."""
    bend = 10.0**exponent
    tip = np.array([1 + np.cos(bend), np.sin(bend)])
    elbow = np.array([np.cos(bend), np.sin(bend)])
    J = np.array([[-tip[1], -elbow[1]], [tip[0], elbow[0]]])
    a = ConstrainedSystem(J, None, [0, 1]).kinematics().attainable([0, 1], (-1, 1))
    assert a.status is AttainableStatus.INTERIOR
    np.testing.assert_allclose(a.radius, np.sin(bend) / np.linalg.norm(tip), rtol=1e-5)
    assert len(a.vertices) == 4 or bend < 1e-8
    straight = ConstrainedSystem([[0, 0], [2, 1]], None, [0, 1]).kinematics()
    assert straight.attainable([0, 1], (-1, 1)).status is AttainableStatus.OUT_OF_REACH


@given(st.floats(-8.5, -1.0))
def test_rates_without_limits_do_not_hide_the_limit_of_a_slow_one(exponent):
    """A limited motor turns two others, which have no limits, 1/ratio times as fast as itself.

    Their columns of the constraint are then nearly parallel.
    """
    ratio = 10.0**exponent
    drive = ConstrainedSystem([[ratio, 0, 0]], [[1, 1, 1], [0, ratio, 1]], [0, 1, 2])
    a = drive.kinematics().attainable([0], ([-np.inf, -np.inf, -1], [np.inf, np.inf, 2]))
    assert a.status is AttainableStatus.INTERIOR
    expected = (1 - ratio) * np.array([1, 2, 1])
    np.testing.assert_allclose([a.radius, *a.support([[1], [-1]])], expected, rtol=1e-6)


def test_geared_motors_are_as_fast_as_the_slower_and_as_strong_as_both():
    """Rates oppose and torques add: the limits of one motor are those of the other, turned."""
    kin = GEARED.kinematics()
    assert_set(kin.attainable([0], ([-1, -9], [9, 9])), AttainableStatus.INTERIOR, 1.0, 9.0)
    assert_set(kin.attainable([0], ([-9, -1], [9, 9])), AttainableStatus.INTERIOR, 1.0, 1.0)
    assert_set(kin.attainable_force([0], ([-1, -2], [4, 5])), AttainableStatus.INTERIOR, 6.0, 6.0)


def test_the_status_says_why_the_radius_is_zero():
    """Out of reach, no room about zero, a contradiction, or a task that moves by itself."""
    status, kin, geared = AttainableStatus, ARM.kinematics(), GEARED.kinematics()
    locked = kin.attainable([0, 1], ([-1, 0], [1, 0]))
    assert_set(locked, status.OUT_OF_REACH, 0.0, 1.0, [1, 5])
    np.testing.assert_allclose(sorted(locked.vertices.tolist()), [[-1, 0], [1, 0]], atol=1e-12)
    assert_set(kin.attainable([0, 1], (0, 1)), status.NOT_INTERIOR, 0.0, 2.0, [1, 1])
    assert_set(kin.attainable([0, 1], (1, 2)), status.NOT_INTERIOR, 0.0, -2.0, [-1, -1])
    assert_set(geared.attainable([0], (1, 2)), status.EMPTY, 0.0, -np.inf)
    assert_set(geared.attainable([0], ([1, 1], [1, 1])), status.EMPTY, 0.0, -np.inf)
    assert_set(geared.attainable([0], ([1, -1], [1, -1])), status.OUT_OF_REACH, 0.0, 1.0)
    # Both may only push, against each other: nothing moves, though each limit alone leaves room.
    assert_set(geared.attainable([0], (0, 1)), status.NOT_INTERIOR, 0.0, 0.0)
    assert len(geared.attainable([0], (1, 2)).vertices) == 0
    with_a_third = ConstrainedSystem([[1, 0, 0], [0, 0, 1]], [[1, 1, 0]], [0, 1, 2]).kinematics()
    flat = with_a_third.attainable([0, 1], (0, 1))
    assert_set(flat, status.NOT_INTERIOR, 0.0, 1.0, [7, 1])
    assert len(flat.vertices) == 0
    loose = ConstrainedSystem([[1.0, 1.0]], None, [0])
    assert_set(loose.kinematics().attainable([0], (-1, 1)), status.SELF_MOTION, 0.0, 1.0)
    assert_set(loose.kinematics().attainable_force([0], (-1, 1)), status.OUT_OF_REACH, 0.0, 0.0)


def test_what_the_structure_bears_has_no_limit():
    """A crane whose slewing is locked: any moment about the mast, without a torque."""
    locked = ARM.with_failures(locked=[0]).kinematics()
    held = locked.attainable_force([0, 1], (-1, 1))
    assert_set(held, AttainableStatus.INTERIOR, 1.0, np.inf, [1, 0])
    assert held.support([0, 1]) == pytest.approx(1.0)
    assert not held.bounded
    assert "no limit" in str(held)
    assert not held.vertices.size
    assert ARM.kinematics().attainable([0, 1]).radius == np.inf
    assert ARM.kinematics().attainable([0, 1], (-1, 1)).bounded


@pytest.mark.parametrize(
    "wrong",
    [
        (1, -1),
        (np.nan, 1),
        (-1, np.nan),
        ([-1, -1, -1], 1),
        1.0,
        "ab",
        (-1, 1, 2),
        (np.inf, np.inf),
    ],
    ids=str,
)
def test_limits_that_cannot_be_are_refused_by_name(wrong):
    kin = ARM.kinematics()
    with pytest.raises(ValueError, match="rate_limits must"):
        kin.attainable([0], wrong)
    with pytest.raises(ValueError, match="torque_limits must"):
        kin.attainable_force([0], wrong)
    with pytest.raises(ValueError, match="rate_limits must"):
        failure_atlas(ARM, [0], rate_limits=wrong)
    with pytest.raises(ValueError, match="torque_limits must"):
        failure_atlas(ARM, [0], torque_limits=wrong)


def test_a_task_of_too_many_facets_is_refused_at_once():
    """40 joints and 6 rows: 658008 sets of five joints, each a candidate for a facet."""
    arm = ConstrainedSystem(np.random.default_rng(0).normal(size=(6, 40)), None, range(40))
    with pytest.raises(ValueError, match="major must leave at most 100000 sets of actuators"):
        arm.kinematics().attainable(range(6), (-1, 1))
    assert arm.kinematics().attainable(range(3), (-1, 1)).radius > 0


def assert_alone(classes, row: int, system, major, rates, torques) -> None:
    """Worst speed and force of one row of an atlas against the sets of that condition."""
    kin = system.kinematics()
    speed, force = kin.attainable(major, rates).radius, kin.attainable_force(major, torques).radius
    np.testing.assert_allclose(classes.worst_speed[row], speed, rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(classes.worst_force[row], force, rtol=1e-7, atol=1e-9)
    assert classes.possible[row] or speed == 0.0


@given(st.data(), systems(actives=(1, 3), tasks=(1, 3)), st.booleans())
def test_each_condition_has_the_worst_speed_and_force_that_it_has_alone(data, drawn, elastic):
    """Redundant rows, self-motion, springs, failures already there, any limits: row by row."""
    system, n = drawn.system, len(drawn.system.active)
    if elastic:
        R = data.draw(springs(system.J_T.shape[1], drawn.rng))
        system = with_stiffness(system, R.T @ R)
    system = data.draw(failures(system))
    major = rows_of(data, len(system.J_T))
    rates, torques = data.draw(pairs(n)), data.draw(pairs(n))
    codes = drawn.rng.integers(0, 3, size=(4, n))
    atlas = failure_atlas(system, major, codes=codes, rate_limits=rates, torque_limits=torques)
    rigid = ConstrainedSystem(system.J_T, system.J_C, system.active).with_failures(
        system.failures.locked, system.failures.free, system.failures.locked_passive
    )
    for row, code in enumerate(codes):
        failed = np.flatnonzero(code == 1), np.flatnonzero(code == 2)
        assert_alone(atlas, row, rigid.with_failures(*failed), major, rates, torques)
        if atlas.elastic is not None:
            condition = system.with_failures(*failed)
            assert_alone(atlas.elastic, row, condition, major, rates, torques)


@given(SEEDS)
def test_each_condition_may_have_limits_of_its_own(seed):
    rng = np.random.default_rng(seed)
    arm = ConstrainedSystem(rng.normal(size=(2, 4)), None, range(4))
    codes = rng.integers(0, 3, size=(5, 4))
    own = -rng.uniform(0, 2, size=(5, 4)), rng.uniform(0, 2, size=(5, 4))
    both = failure_atlas(arm, [0, 1], codes=codes, rate_limits=own, torque_limits=own)
    assert both.worst_speed is not None and both.worst_force is not None
    for row, code in enumerate(codes):
        limits = own[0][row], own[1][row]
        one = failure_atlas(arm, [0, 1], codes=[code], rate_limits=limits, torque_limits=limits)
        assert one.worst_speed is not None and one.worst_force is not None
        np.testing.assert_allclose(both.worst_speed[row], one.worst_speed[0], rtol=1e-9)
        np.testing.assert_allclose(both.worst_force[row], one.worst_force[0], rtol=1e-9)
    for rows in (4, 6):
        wrong = -np.ones((rows, 4)), np.ones((rows, 4))
        with pytest.raises(ValueError, match="rate_limits must be of shape"):
            failure_atlas(arm, [0, 1], codes=codes, rate_limits=wrong)


def test_the_limits_of_failed_actuators_do_not_matter():
    """A failed joint does not move and exerts nothing, even if its limits demand that it does."""
    limits = ([0.25, -1], [1, 1])
    atlas = failure_atlas(
        ARM, [1], codes=[[0, 0], [1, 0]], rate_limits=limits, torque_limits=limits
    )
    assert atlas.worst_speed is not None and atlas.worst_force is not None
    np.testing.assert_allclose([atlas.worst_speed, atlas.worst_force], 1.0)
    assert ARM.with_failures(locked=[0]).kinematics().attainable([1], limits).radius == 1.0


@given(SEEDS)
def test_one_motor_moves_the_task_at_its_gain_however_soft_the_springs(seed):
    """Soft springs let passive joints move fast; that round-off is no constraint on the motor."""
    rng = np.random.default_rng(seed)
    J_T, J_C = rng.normal(size=(1, 6)), rng.normal(size=(3, 6))
    free = null(np.vstack([J_C, np.eye(6)[5]])).T
    beside = null(free) @ rng.normal(size=4)
    R = np.vstack([rng.normal(size=6), 1.5e-3 * free[1] + beside])
    system = ConstrainedSystem(J_T, J_C, [5], stiffness=R.T @ R)
    classes = failure_atlas(system, [0], codes=[[0]], rate_limits=(-1, 1)).elastic
    assert classes is not None and classes.worst_speed is not None
    if classes.possible[0]:
        np.testing.assert_allclose(classes.worst_speed, classes.worst_gain, rtol=1e-9)


@pytest.fixture(scope="module")
def hexapod(model) -> ConstrainedSystem:
    """With springs on the struts alone."""
    jac = jacobians(model, mujoco.MjData(model), site="payload", axes="base")
    K = np.zeros(jac.J_T.shape[1])
    K[jac.active] = model.actuator_gainprm[:, 0]
    return ConstrainedSystem(jac.J_T, jac.J_C, jac.active, stiffness=np.diag(K))


STRUTS_M = (-635e-6, 635e-6)
COILS_N = (-80.0, 80.0)


def test_the_hexapod_points_three_quarters_as_far_with_one_strut_locked_and_half_with_two(hexapod):
    """The struts turn the payload about three axes, 60 degrees apart, two struts about each.

    The worst direction is across one of these axes: the other four struts share it equally, of
    which one or two are lost.
    """
    atlas = failure_atlas(hexapod, [0, 1], rate_limits=STRUTS_M, torque_limits=COILS_N)
    assert atlas.elastic is not None
    assert atlas.worst_speed is not None and atlas.worst_force is not None
    sound, one = atlas.row(), atlas.row(locked=[0])
    assert atlas.worst_speed[sound] == pytest.approx(4.42e-3, abs=5e-6)
    kinds = (atlas.codes == 1).sum(axis=1), (atlas.codes == 2).sum(axis=1)
    left = atlas.worst_speed / atlas.worst_speed[sound]
    for locks, fraction in ((0, 1.0), (1, 0.75), (2, 0.5)):
        np.testing.assert_allclose(left[(kinds[0] == locks) & (kinds[1] == 0)], fraction)
    elastic = atlas.elastic.worst_speed
    assert elastic is not None
    np.testing.assert_allclose(elastic[atlas.row(free=[0])], elastic[one], rtol=1e-9)
    assert atlas.worst_speed[atlas.row(free=[0])] == 0.0
    # A locked strut bears what a coil would; without a coil the moment falls as the speed does.
    assert atlas.worst_force[sound] == pytest.approx(45.98, abs=0.01)
    assert atlas.worst_force[one] == pytest.approx(atlas.worst_force[sound])
    assert atlas.worst_force[atlas.row(free=[0])] == pytest.approx(34.48, abs=0.01)
    assert (atlas.worst_speed > 0).sum() == atlas.possible.sum() == 54
    assert failure_atlas(hexapod, [0, 1]).worst_speed is None


def conditions_of_the_hexapod(hexapod, every: int) -> None:
    limits = {"rate_limits": STRUTS_M, "torque_limits": (-80.0, np.arange(6) * 10.0)}
    atlas = failure_atlas(hexapod, [0, 1, 5], **limits)
    rigid = ConstrainedSystem(hexapod.J_T, hexapod.J_C, hexapod.active)
    for row in range(0, 729, every):
        failed = np.flatnonzero(atlas.codes[row] == 1), np.flatnonzero(atlas.codes[row] == 2)
        for classes, system in ((atlas, rigid), (atlas.elastic, hexapod)):
            assert_alone(classes, row, system.with_failures(*failed), [0, 1, 5], *limits.values())


def test_some_conditions_of_the_hexapod_have_the_speed_and_force_they_have_alone(hexapod):
    conditions_of_the_hexapod(hexapod, 31)


@pytest.mark.long
def test_all_conditions_of_the_hexapod_have_the_speed_and_force_they_have_alone(hexapod):
    conditions_of_the_hexapod(hexapod, 1)
