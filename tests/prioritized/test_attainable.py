"""Test attainable sets of the major task within limits of rates and torques."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linprog
from scipy.spatial import ConvexHull

from prioritized import Attainable, ConstrainedSystem
from prioritized._analysis.attainable import AttainableStatus
from tests import spaces
from tests.random_systems import failures, pairs, rows_of, systems


def largest(d, equalities, x_of, limits) -> float:
    """Return the largest d @ x with equalities @ x = 0 and limits on x_of @ x, or an infinity."""
    lower, upper = limits
    rows = np.vstack([x_of[np.isfinite(upper)], -x_of[np.isfinite(lower)]])
    finite = np.concatenate([upper[np.isfinite(upper)], -lower[np.isfinite(lower)]])
    none = np.zeros(len(equalities))
    for goal in (1.0, 0.0):  # unbounded or infeasible may have one status
        result = linprog(-goal * d, rows, finite, equalities, none, bounds=[(None, None)] * len(d))
        if result.status == 0:
            return -result.fun if goal else np.inf
    return -np.inf


def directions(rng: np.random.Generator, m1: int, count: int = 10) -> np.ndarray:
    """Return some directions along axes, and some random ones."""
    return np.vstack([rng.normal(size=(count, m1)), np.eye(m1), -np.eye(m1)])


@pytest.mark.parametrize("of", ["velocities", "forces"])
@given(st.data(), systems(actives=(1, 4), tasks=(1, 4)))
def test_the_support_is_the_optimum_over_all_motions_or_equilibria(of, data, sample):
    """Compare with linear programs in all N velocities, or forces on all joints, eq. (5)."""
    rates = of == "velocities"
    system, N, m = (
        data.draw(failures(sample.system)),
        sample.system.J_T.shape[1],
        len(sample.system.J_T),
    )
    major, limits = rows_of(data, m), data.draw(pairs(len(system.active)))
    kin, stuck = system.kinematics(), spaces.stuck_joints(system)
    survivors = tuple(limit[kin.actuators] for limit in limits)
    D = sample.rng.permutation(directions(sample.rng, len(major), 3))[:2]
    if rates:
        # xi of eq. (10) is not commanded.
        closed = np.vstack([system.J_C, np.eye(N)[stuck], spaces.self_motions(system, kin).T])
        select, driven = system.J_T[major], np.eye(N)[kin.active]
    else:
        balance = np.hstack([system.J_T.T, system.J_C.T])  # (N, m + c): generalized forces
        closed = balance[sorted(set(range(N)) - set(kin.active.tolist()) - set(stuck))]
        select, driven = np.eye(m + len(system.J_C))[major], balance[kin.active]
    a = (kin.attainable if rates else kin.attainable_force)(major, limits)
    expected = [largest(d @ select, closed, driven, survivors) for d in D]
    np.testing.assert_allclose(a.support(D), expected, atol=1e-6)


def basic_points(a: Attainable) -> np.ndarray:
    """Return G x of every basic solution: some x at limits, the others given by the constraints."""
    C = a.constraint
    r, n = C.shape
    points = []
    for basic in map(list, itertools.combinations(range(n), r)):
        others = [i for i in range(n) if i not in basic]
        if r and np.linalg.svd(C[:, basic], compute_uv=False)[-1] < 1e-9:
            continue
        for corner in itertools.product(*((a.lower[i], a.upper[i]) for i in others)):
            x = np.zeros(n)
            x[others] = corner
            x[basic] = np.linalg.solve(C[:, basic], -C[:, others] @ corner)
            if (x >= a.lower - 1e-9).all() and (x <= a.upper + 1e-9).all():
                points.append(a.gain @ x)
    return np.array(points).reshape(-1, len(a.gain))


def radius_of(points: np.ndarray) -> float:
    """Return the radius of the largest ball about zero in the hull of points."""
    m1 = points.shape[1]
    flat = len(points) <= m1 or np.linalg.svd(points - points[0], compute_uv=False)[m1 - 1] < 1e-8
    if flat:
        return 0.0
    if m1 == 1:
        return max(0.0, min(points.max(), -points.min()))
    return max(0.0, -ConvexHull(points).equations[:, -1].max())


@given(st.data(), systems(actives=(1, 4), tasks=(1, 3), self_motion=False))
def test_the_radius_is_that_of_the_hull_of_all_extreme_motions(data, sample):
    """Check as well that every corner is an extreme motion, and the farthest in some direction."""
    n, m = len(sample.system.active), len(sample.system.J_T)
    major, limits = rows_of(data, m), data.draw(pairs(n, infinite=False))
    a = sample.system.kinematics().attainable(major, limits)
    points = basic_points(a)
    assert (a.status is AttainableStatus.EMPTY) == (len(points) == 0)
    assert (a.status is AttainableStatus.INTERIOR) == (a.radius > 0)
    if not len(points):
        assert a.radius == 0.0
        return
    expected = radius_of(points)
    np.testing.assert_allclose(a.radius, expected, atol=1e-8)
    assert (a.radius > 0) == (expected > 1e-8)  # round-off is no margin
    D = directions(sample.rng, len(major), 30)
    if a.status is AttainableStatus.INTERIOR:
        np.testing.assert_allclose((a.vertices @ D.T).max(axis=0), a.support(D), atol=1e-8)
    for corner in a.vertices:
        assert np.linalg.norm(points - corner, axis=1).min() < 1e-8


@pytest.mark.parametrize("unit", [1e-12, 1e12])
def test_a_set_grows_with_its_limits(unit):
    rng = np.random.default_rng(0)
    kin = ConstrainedSystem(rng.normal(size=(3, 5)), None, range(5)).kinematics()
    one, other = (kin.attainable([0, 1, 2], (-size, 2 * size)) for size in (1.0, unit))
    assert other.radius == pytest.approx(unit * one.radius)
    np.testing.assert_allclose(other.vertices, unit * one.vertices, rtol=1e-9)


@given(st.data(), systems(actives=(1, 4), tasks=(1, 3)))
def test_infinite_limits_equal_sufficiently_wide_ones(data, sample):
    """Compare infinite limits with increasing ones, for velocities and forces."""
    n, m = len(sample.system.active), len(sample.system.J_T)
    major, (lower, upper) = rows_of(data, m), data.draw(pairs(n))
    kin = sample.system.kinematics()
    wide, wider = ((np.clip(lower, -far, None), np.clip(upper, None, far)) for far in (1e5, 1e6))
    for attainable in (kin.attainable, kin.attainable_force):
        endless, ended = attainable(major, (lower, upper)), attainable(major, wide)
        if np.isfinite(endless.radius):
            np.testing.assert_allclose(ended.radius, endless.radius, rtol=1e-6, atol=1e-6)
        else:  # it increases with the limits, even at a small gain
            assert attainable(major, wider).radius == pytest.approx(10 * ended.radius, rel=0.1)
            assert ended.radius > 0


def test_corners_in_the_plane_are_in_counter_clockwise_order():
    rng = np.random.default_rng(5)
    for _ in range(40):
        J, upper = rng.normal(size=(2, 5)), rng.uniform(0.1, 1.0, 5)
        system = ConstrainedSystem(J, None, range(5))
        x, y = system.kinematics().attainable([0, 1], (-upper, 2 * upper)).vertices.T
        turns = (np.roll(x, -1) - x) * (np.roll(y, -2) - np.roll(y, -1))
        turns -= (np.roll(y, -1) - y) * (np.roll(x, -2) - np.roll(x, -1))
        assert (turns > 0.0).all()


def arm() -> ConstrainedSystem:
    return ConstrainedSystem(np.eye(2), None, [0, 1])


def geared() -> ConstrainedSystem:
    """Return two motors on one shaft in opposite directions: their rates add to zero."""
    return ConstrainedSystem([[1.0, 0.0]], [[1.0, 1.0]], [0, 1])


def assert_set(a, status: AttainableStatus, radius: float, support, direction=(1.0,)) -> None:
    assert a.status is status
    assert a.radius == pytest.approx(radius, abs=1e-12)
    assert a.support(direction) == pytest.approx(support, abs=1e-12)
    assert str(a).startswith(status.value[:1].upper())


@given(st.floats(-9.0, 0.0))
def test_the_speed_of_an_arm_falls_to_zero_as_it_stretches_out(exponent):
    """Compare with a parallelogram's height; at the singularity the direction is unreachable."""
    bend = 10.0**exponent
    tip = np.array([1 + np.cos(bend), np.sin(bend)])
    elbow = np.array([np.cos(bend), np.sin(bend)])
    J = np.array([[-tip[1], -elbow[1]], [tip[0], elbow[0]]])
    a = ConstrainedSystem(J, None, [0, 1]).kinematics().attainable([0, 1], (-1, 1))
    assert a.status is AttainableStatus.INTERIOR
    np.testing.assert_allclose(a.radius, np.sin(bend) / np.linalg.norm(tip), rtol=1e-5)
    assert len(a.vertices) == 4 or bend < 1e-8
    straight = ConstrainedSystem([[0, 0], [2, 1]], None, [0, 1]).kinematics()
    assert straight.attainable([0, 1], (-1, 1)).status is AttainableStatus.UNREACHABLE


@given(st.floats(-8.5, -1.0))
def test_rates_without_limits_do_not_hide_the_limit_of_a_slow_one(exponent):
    """Check a limited motor that drives two unlimited ones at 1/ratio by near-parallel columns."""
    ratio = 10.0**exponent
    drive = ConstrainedSystem([[ratio, 0, 0]], [[1, 1, 1], [0, ratio, 1]], [0, 1, 2])
    a = drive.kinematics().attainable([0], ([-np.inf, -np.inf, -1], [np.inf, np.inf, 2]))
    assert a.status is AttainableStatus.INTERIOR
    expected = (1 - ratio) * np.array([1, 2, 1])
    np.testing.assert_allclose([a.radius, *a.support([[1], [-1]])], expected, rtol=1e-6)


def test_the_status_explains_a_zero_radius():
    """Check unreachable directions, limits that exclude zero, contradictions, and self-motion."""
    status, kin, pair = AttainableStatus, arm().kinematics(), geared().kinematics()
    locked = kin.attainable([0, 1], ([-1, 0], [1, 0]))
    assert_set(locked, status.UNREACHABLE, 0.0, 1.0, [1, 5])
    np.testing.assert_allclose(sorted(locked.vertices.tolist()), [[-1, 0], [1, 0]], atol=1e-12)
    assert_set(kin.attainable([0, 1], (0, 1)), status.NOT_INTERIOR, 0.0, 2.0, [1, 1])
    assert_set(kin.attainable([0, 1], (1, 2)), status.NOT_INTERIOR, 0.0, -2.0, [-1, -1])
    assert_set(pair.attainable([0], (1, 2)), status.EMPTY, 0.0, -np.inf)
    assert_set(pair.attainable([0], ([1, 1], [1, 1])), status.EMPTY, 0.0, -np.inf)
    assert_set(pair.attainable([0], ([1, -1], [1, -1])), status.UNREACHABLE, 0.0, 1.0)
    # Both may only push, against each other, so no motion is possible.
    assert_set(pair.attainable([0], (0, 1)), status.NOT_INTERIOR, 0.0, 0.0)
    assert len(pair.attainable([0], (1, 2)).vertices) == 0
    with_a_third = ConstrainedSystem([[1, 0, 0], [0, 0, 1]], [[1, 1, 0]], [0, 1, 2]).kinematics()
    flat = with_a_third.attainable([0, 1], (0, 1))
    assert_set(flat, status.NOT_INTERIOR, 0.0, 1.0, [7, 1])
    assert len(flat.vertices) == 0
    loose = ConstrainedSystem([[1.0, 1.0]], None, [0])
    assert_set(loose.kinematics().attainable([0], (-1, 1)), status.SELF_MOTION, 0.0, 1.0)
    assert_set(loose.kinematics().attainable_force([0], (-1, 1)), status.UNREACHABLE, 0.0, 0.0)


def test_forces_borne_by_the_structure_are_unlimited():
    """Check a crane with locked slewing: it bears any moment about the mast without torque."""
    locked = arm().with_failures(locked=[0]).kinematics()
    fixed = locked.attainable_force([0, 1], (-1, 1))
    assert_set(fixed, AttainableStatus.INTERIOR, 1.0, np.inf, [1, 0])
    assert fixed.support([0, 1]) == pytest.approx(1.0)
    assert not fixed.bounded
    assert "no limit" in str(fixed)
    assert not fixed.vertices.size
    assert arm().kinematics().attainable([0, 1]).radius == np.inf
    assert arm().kinematics().attainable([0, 1], (-1, 1)).bounded


def test_a_task_of_too_many_facets_raises_immediately():
    """Check 40 joints and 6 rows: 658008 sets of five joints, each a candidate for a facet."""
    arm = ConstrainedSystem(np.random.default_rng(0).normal(size=(6, 40)), None, range(40))
    with pytest.raises(ValueError, match="major must leave at most 100000 sets of actuators"):
        arm.kinematics().attainable(range(6), (-1, 1))
    assert arm.kinematics().attainable(range(3), (-1, 1)).radius > 0
