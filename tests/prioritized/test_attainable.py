"""Attainable sets: what limits of rates and torques leave of the major task."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linprog
from scipy.spatial import ConvexHull

from prioritized import Attainable, ConstrainedSystem
from prioritized._analysis.attainable import AttainableStatus
from tests.random_systems import failures, pairs, rows_of, stuck_joints, systems


def largest(d, equalities, x_of, limits) -> float:
    """Largest d @ x of x with equalities @ x = 0 and limits on x_of @ x, by linear programming.

    Infinite if it has no bound, minus infinity if there is no such x.
    """
    lower, upper = limits
    rows = np.vstack([x_of[np.isfinite(upper)], -x_of[np.isfinite(lower)]])
    room = np.concatenate([upper[np.isfinite(upper)], -lower[np.isfinite(lower)]])
    none = np.zeros(len(equalities))
    for goal in (1.0, 0.0):  # the solver may not tell unbounded from infeasible
        found = linprog(-goal * d, rows, room, equalities, none, bounds=[(None, None)] * len(d))
        if found.status == 0:
            return -found.fun if goal else np.inf
    return -np.inf


def directions(rng: np.random.Generator, m1: int, count: int = 10) -> np.ndarray:
    """Some along axes, some anywhere."""
    return np.vstack([rng.normal(size=(count, m1)), np.eye(m1), -np.eye(m1)])


@given(st.data(), systems(actives=(1, 4), tasks=(1, 4), self_motion=False))
def test_the_support_of_velocities_is_the_optimum_over_all_motions_of_the_mechanism(data, drawn):
    """Over all N velocities that close the loops, none eliminated: a linear program."""
    system = drawn.system
    n, N, m = len(system.active), system.J_T.shape[1], len(system.J_T)
    locked = data.draw(st.sets(st.integers(0, n - 1), max_size=1))
    system = system.with_failures(locked=locked)
    major, limits = rows_of(data, m), data.draw(pairs(n))
    kin = system.kinematics()
    a = kin.attainable(major, limits)
    D = drawn.rng.permutation(directions(drawn.rng, len(major), 3))[:2]
    closure = np.vstack([system.J_C, np.eye(N)[stuck_joints(system)]])
    survivors = tuple(limit[kin.actuators] for limit in limits)
    driven = np.eye(N)[kin.active]
    expected = [largest(d @ system.J_T[major], closure, driven, survivors) for d in D]
    np.testing.assert_allclose(a.support(D), expected, atol=1e-6)


@given(st.data(), systems(actives=(1, 4), tasks=(1, 4)))
def test_the_support_of_forces_is_the_optimum_over_all_equilibria_of_the_mechanism(data, drawn):
    """Over all task and constraint forces that balance every joint, eq. (5): a linear program."""
    system = data.draw(failures(drawn.system))
    n, N, m = len(system.active), system.J_T.shape[1], len(system.J_T)
    major, limits = rows_of(data, m), data.draw(pairs(n))
    kin = system.kinematics()
    a = kin.attainable_force(major, limits)
    D = drawn.rng.permutation(directions(drawn.rng, len(major), 3))[:2]
    balance = np.hstack([system.J_T.T, system.J_C.T])  # (N, m + c): generalized forces
    passive = sorted(set(range(N)) - set(kin.active.tolist()) - set(stuck_joints(system)))
    survivors = tuple(limit[kin.actuators] for limit in limits)
    select = np.eye(m + len(system.J_C))[major]
    expected = [largest(d @ select, balance[passive], balance[kin.active], survivors) for d in D]
    np.testing.assert_allclose(a.support(D), expected, atol=1e-6)


def basic_points(a: Attainable) -> np.ndarray:
    """G x of every basic solution: some x at limits, the others as the constraints say."""
    C = a.constraint
    r, n = C.shape
    points = []
    for basic in map(list, itertools.combinations(range(n), r)):
        rest = [i for i in range(n) if i not in basic]
        if r and np.linalg.svd(C[:, basic], compute_uv=False)[-1] < 1e-9:
            continue
        for corner in itertools.product(*((a.lower[i], a.upper[i]) for i in rest)):
            x = np.zeros(n)
            x[rest] = corner
            x[basic] = np.linalg.solve(C[:, basic], -C[:, rest] @ corner)
            if (x >= a.lower - 1e-9).all() and (x <= a.upper + 1e-9).all():
                points.append(a.gain @ x)
    return np.array(points).reshape(-1, len(a.gain))


def radius_of(points: np.ndarray) -> float:
    """Of the largest ball about zero in the hull of points."""
    m1 = points.shape[1]
    flat = len(points) <= m1 or np.linalg.svd(points - points[0], compute_uv=False)[m1 - 1] < 1e-8
    if flat:
        return 0.0
    if m1 == 1:
        return max(0.0, min(points.max(), -points.min()))
    return max(0.0, -ConvexHull(points).equations[:, -1].max())


@given(st.data(), systems(actives=(1, 4), tasks=(1, 3), self_motion=False))
def test_the_radius_is_that_of_the_hull_of_all_extreme_motions(data, drawn):
    """Every corner of the set is an extreme motion, and in each direction a corner is farthest."""
    n, m = len(drawn.system.active), len(drawn.system.J_T)
    major, limits = rows_of(data, m), data.draw(pairs(n, infinite=False))
    a = drawn.system.kinematics().attainable(major, limits)
    points = basic_points(a)
    assert (a.status is AttainableStatus.EMPTY) == (len(points) == 0)
    assert (a.status is AttainableStatus.INTERIOR) == (a.radius > 0)
    if not len(points):
        assert a.radius == 0.0
        return
    expected = radius_of(points)
    np.testing.assert_allclose(a.radius, expected, atol=1e-8)
    assert (a.radius > 0) == (expected > 1e-8)  # round-off is no room
    D = directions(drawn.rng, len(major), 30)
    if a.status is AttainableStatus.INTERIOR:
        np.testing.assert_allclose((a.vertices @ D.T).max(axis=0), a.support(D), atol=1e-8)
    for corner in a.vertices:
        assert np.linalg.norm(points - corner, axis=1).min() < 1e-8


@given(st.data(), systems(actives=(1, 4), tasks=(1, 3)))
def test_no_limits_are_limits_that_are_wide_enough(data, drawn):
    """An infinite limit is the end of wider and wider ones, for velocities and for forces."""
    n, m = len(drawn.system.active), len(drawn.system.J_T)
    major, (lower, upper) = rows_of(data, m), data.draw(pairs(n))
    kin = drawn.system.kinematics()
    wide, wider = ((np.clip(lower, -far, None), np.clip(upper, None, far)) for far in (1e5, 1e6))
    for attainable in (kin.attainable, kin.attainable_force):
        endless, ended = attainable(major, (lower, upper)), attainable(major, wide)
        if np.isfinite(endless.radius):
            np.testing.assert_allclose(ended.radius, endless.radius, rtol=1e-6, atol=1e-6)
        else:  # it grows with the limits, by however small a gain
            assert attainable(major, wider).radius == pytest.approx(10 * ended.radius, rel=0.1)
            assert ended.radius > 0


@given(st.data(), systems(actives=(1, 4)))
def test_a_rate_of_zero_is_a_lock_and_a_torque_of_zero_a_free_joint(data, drawn):
    """By limits or by failure: the same velocities, the same forces. n-wide limits are cut."""
    system, n, m = drawn.system, len(drawn.system.active), len(drawn.system.J_T)
    major, (lower, upper) = rows_of(data, m), data.draw(pairs(n))
    k = data.draw(st.integers(0, n - 1))
    lower[k] = upper[k] = 0.0
    kin, D = system.kinematics(), directions(drawn.rng, len(major))
    sound = kin.attainable(major, (lower, upper))
    locked = system.with_failures(locked=[k]).kinematics().attainable(major, (lower, upper))
    np.testing.assert_allclose(sound.support(D), locked.support(D), atol=1e-7)
    np.testing.assert_allclose(sound.radius, locked.radius, atol=1e-7)
    held = kin.attainable_force(major, (lower, upper))
    free = system.with_failures(free=[k]).kinematics().attainable_force(major, (lower, upper))
    np.testing.assert_allclose(held.support(D), free.support(D), atol=1e-7)
    np.testing.assert_allclose(held.radius, free.radius, atol=1e-7)


@given(st.data(), systems(actives=(1, 4)), st.floats(0.1, 10.0))
def test_twice_the_limits_are_twice_the_speed_and_force(data, drawn, factor):
    """The sets grow with the limits; a direction twice as long has twice the support."""
    n, m = len(drawn.system.active), len(drawn.system.J_T)
    major, (lower, upper) = rows_of(data, m), data.draw(pairs(n))
    kin, D = drawn.system.kinematics(), directions(drawn.rng, len(major))
    for attainable in (kin.attainable, kin.attainable_force):
        once, more = (attainable(major, (f * lower, f * upper)) for f in (1.0, factor))
        np.testing.assert_allclose(more.radius, factor * once.radius, rtol=1e-7)
        np.testing.assert_allclose(more.support(D), factor * once.support(D), rtol=1e-7, atol=1e-9)
        np.testing.assert_allclose(once.support(factor * D), factor * once.support(D), rtol=1e-7)
        np.testing.assert_allclose(
            once.support(D[None, :, None])[0, :, 0], once.support(D), rtol=1e-12
        )


def test_corners_in_the_plane_are_in_counter_clockwise_order():
    rng = np.random.default_rng(5)
    for _ in range(40):
        J, upper = rng.normal(size=(2, 5)), rng.uniform(0.1, 1.0, 5)
        system = ConstrainedSystem(J, None, range(5))
        x, y = system.kinematics().attainable([0, 1], (-upper, 2 * upper)).vertices.T
        turns = (np.roll(x, -1) - x) * (np.roll(y, -2) - np.roll(y, -1))
        turns -= (np.roll(y, -1) - y) * (np.roll(x, -2) - np.roll(x, -1))
        assert (turns > 0.0).all()
