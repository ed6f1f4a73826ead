"""Test hierarchies under limits, damped or not: velocity mappings, oracles, other poses."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prioritized import ConstrainedSystem, Kinematics, Status, Task, lexicographic_least_squares
from tests.lexicographic_oracles import by_active_sets
from tests.profiles import examples, scaled
from tests.random_systems import SEEDS, failures, major_and_secondary, of_rank, orthogonal, systems

DAMPED = st.one_of(st.just(0.0), st.floats(0.01, 2.0))


def arm(J: np.ndarray) -> Kinematics:
    """Return an open chain with this Jacobian."""
    return ConstrainedSystem(J, None, range(J.shape[1])).kinematics()


def null_projector(A: np.ndarray) -> np.ndarray:
    return np.eye(A.shape[1]) - np.linalg.pinv(A) @ A


@given(st.data(), systems(tasks=(1, 5)), st.one_of(st.just(0.0), st.floats(1e-3, 1.0)))
@examples(100)
def test_two_levels_are_a_velocity_mapping(data, sample, damping):
    """Compare the major task, then rates and secondary velocity in one level; with failures."""
    system, rng = data.draw(failures(sample.system)), sample.rng
    kin, n_all = system.kinematics(), len(sample.system.active)
    m, n = kin.J.shape
    major, others = major_and_secondary(data, m)
    W1, W2 = rng.uniform(0.5, 2, n_all), rng.uniform(0.5, 2, len(others))
    limits = -rng.uniform(0.1, 1, n_all), rng.uniform(0.1, 1, n_all)
    v, d, v_s = 2 * rng.normal(size=len(major)), rng.normal(size=n), rng.normal(size=len(others))
    mapping = kin.velocity_mapping(major, None, W1, W2, damping=damping, rate_limits=limits)
    aside = [Task.joints(W1), *([Task(others, W2)] if others else [])]
    hierarchy = kin.hierarchy([Task(major, damping=damping), aside], rate_limits=limits)
    expected = mapping.solve(v, d, v_s)
    result = hierarchy.solve([v, [d, v_s] if others else d])
    np.testing.assert_allclose(result.rates, expected.rates, atol=1e-6 if others else 1e-7, rtol=0)
    np.testing.assert_allclose(result.residuals[0], expected.residual, rtol=0, atol=1e-8)
    assert damping or result.status is expected.status


@given(SEEDS, st.integers(2, 4), DAMPED, DAMPED)
@examples(80)
def test_three_levels_are_the_best_of_every_active_set(seed, n, first, second):
    """Compare with enumeration, damping as further rows: singular vectors on the null space."""
    rng = np.random.default_rng(seed)
    J, W, W1 = of_rank(rng, 3, n, min(3, n)), rng.uniform(0.5, 2, 2), rng.uniform(0.5, 2, n)
    lower, upper = -rng.uniform(0.1, 0.5, n), rng.uniform(0.1, 0.5, n)
    levels = [Task([0], damping=first), Task([1, 2], W, damping=second), Task.joints(W1)]
    targets = [2 * rng.normal(size=1), rng.normal(size=2), rng.normal(size=n)]
    result = arm(J).hierarchy(levels, rate_limits=(lower, upper)).solve(targets)
    rows, left, problem = (J[:1], W[:, None] * J[1:], np.diag(W1)), np.eye(n), []
    for A, b, damping in zip(rows, (1.0, W, W1), (first, second, 0.0), strict=True):
        _, sigma, V = np.linalg.svd(A @ left, full_matrices=False)
        V = V[sigma > 1e-9] if damping else np.zeros((0, n))
        target = b * targets[len(problem)]
        problem.append((np.vstack([A, damping * V]), np.append(target, np.zeros(len(V)))))
        left = left @ null_projector(A @ left)
    x = by_active_sets(problem, lower, upper)
    np.testing.assert_allclose(result.rates, x, rtol=0, atol=1e-7)
    assert (lower <= result.rates).all() and (result.rates <= upper).all()
    of_rows = zip(result.residuals, (J[:1], J[1:], np.eye(n)), targets, strict=True)
    for residual, A, target in of_rows:
        np.testing.assert_allclose(residual, target - A @ x, rtol=0, atol=1e-7)


@given(SEEDS, st.integers(2, 6), st.booleans())
def test_an_interval_is_satisfied_after_the_previous_levels(seed, n, first):
    """Compare with intervals of lexicographic least squares on the rows of the mechanism."""
    rng = np.random.default_rng(seed)
    kin, low = arm(of_rank(rng, 3, n, min(3, n))), rng.normal(size=2)
    interval, v = (low, low + rng.uniform(0, 0.5, 2)), rng.normal(size=1)
    levels, targets = [Task([0]), Task([1, 2], interval=True)], [v, interval]
    problem: list[Any] = [(kin.J[:1], v), (kin.J[1:], *interval)]
    order = slice(None, None, -1 if first else 1)
    result = kin.hierarchy(levels[order], rate_limits=(-0.4, 0.4)).solve(targets[order])
    expected = lexicographic_least_squares(problem[order], -0.4, 0.4)
    np.testing.assert_allclose(result.rates, expected.x, rtol=0, atol=1e-9)
    moved = kin.J[1:] @ result.rates
    violation = result.residuals[0 if first else 1]
    np.testing.assert_allclose(violation, np.clip(moved, *interval) - moved, atol=1e-12)


@pytest.mark.parametrize(
    ("J", "active", "target", "more", "status"),
    [
        (np.eye(2), [0, 1], [0.5, 0.5], {}, Status.EXACT),
        (np.eye(2), [0, 1], [3.0, 0.5], {}, Status.LIMITED),
        (np.eye(2), [0, 1], [0.5, 0.5], {"rate_rows": (np.ones((1, 2)), 3, 4)}, Status.INFEASIBLE),
        (np.ones((2, 2)), [0, 1], [1.0, 0.0], {}, Status.LEAST_SQUARES),
        (np.eye(2), [0], [0.0, 1.0], {}, Status.SELF_MOTION),
    ],
)
def test_the_status_is_that_of_the_first_level(J, active, target, more, status):
    kin = ConstrainedSystem(J, None, active).kinematics()
    hierarchy = kin.hierarchy([Task([0, 1]), Task.joints()], rate_limits=(-1, 1), **more)
    result = hierarchy.solve([target, 9 * np.ones(len(active))])
    assert result.status is status
    assert (abs(result.rates) <= 1).all()


@pytest.mark.parametrize("level", [0, 1])
def test_rates_stay_bounded_as_a_singular_value_vanishes(level):
    """Check the bound |target| / (2 damping), for damping of any level."""
    for seed in range(scaled(340)):
        rng, least = np.random.default_rng(seed), 10.0 ** -(seed % 17) * (seed % 17 > 0)
        damping, v = 10.0 ** -rng.uniform(0, 6), rng.normal(size=3)
        Q = orthogonal(rng, 6)
        near = orthogonal(rng, 3) @ np.diag([1.0, 0.7, least]) @ Q[:3]
        tasks, targets = [Task([0, 1, 2], damping=damping)], [v]
        if level:  # a level before it, orthogonal to it
            near = np.vstack([near, Q[3:4]])
            tasks, targets = [Task([3]), *tasks], [np.zeros(1), v]
        rates = arm(near).hierarchy(tasks)(targets)
        assert np.linalg.norm(rates) <= np.linalg.norm(v) / (2 * damping) * (1 + 1e-9)


@given(SEEDS, st.floats(1e-3, 10.0), st.integers(0, 9))
def test_levels_after_a_damped_one_have_its_null_space(seed, damping, nearness):
    """Check that the second level is exact and the first unaffected, with a redundant row."""
    rng = np.random.default_rng(seed)
    Q = orthogonal(rng, 7)
    near = np.diag([1.0, 10.0**-nearness]) @ Q[:2]
    J = np.vstack([near, near.sum(axis=0), Q[2:]])
    kin, v = arm(J), rng.normal(size=8)
    damped = Task([0, 1, 2], damping=damping)
    alone = kin.hierarchy([damped]).solve([v[:3]])
    result = kin.hierarchy([damped, Task(range(3, 8))]).solve([v[:3], v[3:]])
    np.testing.assert_allclose(result.residuals[0], alone.residuals[0], rtol=0, atol=1e-11)
    np.testing.assert_allclose(result.residuals[1], 0.0, rtol=0, atol=1e-11)
    assert result.damping_errors[0] > 1e-9


@given(SEEDS, st.floats(0.01, 1.0), st.booleans())
@examples(40)
def test_the_damping_error_is_the_difference_to_the_undamped_levels(seed, damping, limited):
    """Compare with the undamped hierarchy in every level, also in an undamped second one."""
    rng = np.random.default_rng(seed)
    J, v = of_rank(rng, 4, 5, 4), rng.normal(size=4)
    box = (-0.3, 0.3) if limited else None
    kin, targets = arm(J), [v[:2], v[2:]]
    result = kin.hierarchy([Task([0, 1], damping=damping), Task([2, 3])], rate_limits=box)
    result = result.solve(targets)
    plain = kin.hierarchy([Task([0, 1]), Task([2, 3])], rate_limits=box).solve(targets)
    expected = [np.linalg.norm(rows @ (plain.rates - result.rates)) for rows in (J[:2], J[2:])]
    np.testing.assert_allclose(result.damping_errors, expected, rtol=1e-9, atol=1e-12)
    assert plain.damping_errors == (0.0, 0.0)
    assert (result.status is Status.DAMPED) == (plain.status is Status.EXACT)
    assert plain.status is not Status.DAMPED


@given(SEEDS, st.floats(0.01, 1.0))
def test_an_interval_with_a_damped_level_holds_or_changes_nothing(seed, damping):
    rng = np.random.default_rng(seed)
    J, low, v = of_rank(rng, 3, 4, 3), rng.normal(size=1), rng.normal(size=2)
    kin, damped = arm(J), Task([1, 2], damping=damping)
    levels = [Task([0], interval=True), damped, Task([1, 2])]
    result = kin.hierarchy(levels).solve([(low, low + 0.1), v, v])
    np.testing.assert_allclose(result.residuals[0], 0.0, atol=1e-12)
    # The next level has the same target without damping, but no remaining motion.
    np.testing.assert_allclose(result.residuals[2], result.residuals[1], atol=1e-12)
    assert result.damping_errors[1] > 0.0
    wide = kin.hierarchy(levels[:2])([(-99.0, 99.0), v])
    np.testing.assert_allclose(wide, kin.hierarchy([damped])([v]), rtol=0, atol=1e-12)
    with pytest.raises(ValueError, match="damping must be 0"):
        Task([0], interval=True, damping=damping)


def test_the_largest_damping_of_a_level_counts():
    kin = arm(np.eye(2))
    for dampings in ((0.5, 0.1), (0.0, 0.5)):
        tasks = [Task([row], damping=each) for row, each in enumerate(dampings)]
        rates = kin.hierarchy([tasks])([[[1.0], [1.0]]])
        np.testing.assert_allclose(rates, [0.8, 0.8], atol=1e-12)


@given(SEEDS, st.integers(-119, 99), st.integers(-119, 99))
def test_rates_are_finite_for_any_weight_and_damping(seed, weight, damping):
    """Check damping of 1e99 with a weight of 1e-100, which gave NaN."""
    rng = np.random.default_rng(seed)
    kin, v, d = arm(rng.normal(size=(1, 3))), rng.normal(size=1), rng.normal(size=3)
    w, damping = 10.0**weight * rng.uniform(0.5, 2, 3), 10.0**damping
    joints = Task.joints(w, damping=damping)
    with np.errstate(over="ignore"):
        expected = d / (1 + (damping / w) ** 2)
    np.testing.assert_allclose(kin.hierarchy([joints])([d]), expected, rtol=1e-9, atol=1e-12)
    assert np.isfinite(kin.hierarchy([Task([0]), joints])([v, d])).all()


class Measured:
    """Exact entries with units of rad for some task rows and velocities and of m for the others."""

    error_bound = 0.0

    def __init__(self, rng: np.random.Generator, m: int, c: int, N: int) -> None:
        self.task_units, self.velocity_units = rng.choice([1.0, 0.4], m), rng.choice([1.0, 0.4], N)
        self.constraint_units = np.ones(c)
        self.J_T_error, self.J_C_error = np.zeros((m, N)), np.zeros((c, N))


def assert_same(result: Any, expected: Any, targets: list[Any]) -> None:
    """Assert bit-wise equality of two solutions."""
    a, b = result.solve(targets), expected.solve(targets)
    np.testing.assert_array_equal(a.rates, b.rates)
    np.testing.assert_array_equal(a.packed.A, b.packed.A)
    np.testing.assert_array_equal(a.packed.scales, b.packed.scales)
    assert (a.status, a.gap, str(a)) == (b.status, b.gap, str(b))


@given(st.data(), systems(tasks=(2, 5), actives=(2, 4)), st.integers(-18, 0), st.booleans())
@examples(100)
def test_levels_at_another_pose_equal_those_created_there(data, sample, nearness, in_metres):
    """Check failures, near-singular poses, weights of all actuators, and mixed units."""
    first, rng, n = sample.system, sample.rng, len(sample.system.active)
    m, N = first.J_T.shape
    J_T = first.J_T.copy()
    J_T[-1] = J_T[0] + 10.0**nearness * rng.normal(size=N)
    loops = first.J_C, first.active
    units = [Measured(rng, m, len(first.J_C), N) if in_metres else None for _ in range(2)]
    here = data.draw(failures(ConstrainedSystem(first.J_T, *loops, accuracy=units[0])))
    there = ConstrainedSystem(J_T, *loops, failures=here.failures, accuracy=units[1])
    if data.draw(st.booleans()):
        there = data.draw(failures(there))
    before, there = here.kinematics(), there.kinematics()
    major, others = major_and_secondary(data, m)
    requested: dict[str, Any] = {
        "levels": [
            Task(major, rng.uniform(0.5, 2, len(major)) if rng.random() < 0.5 else None),
            *([Task(others, damping=rng.choice([0.0, 0.1]))] if others else []),
            Task.joints(rng.uniform(0.5, 2, n) if rng.random() < 0.5 else None),
        ]
    }
    if rng.random() < 0.5:
        requested["tie_metric"] = rng.uniform(0.5, 2, n)
    if rng.random() < 0.5:
        requested["rate_rows"] = rng.normal(size=(1, n)), -0.3, 0.3
    limits = -rng.uniform(0.1, 1, n), rng.uniform(0.1, 1, n)
    v, d = rng.normal(size=m), rng.normal(size=there.J.shape[1])
    targets = [v[: len(major)], *([v[len(major) :]] if others else []), d]
    made = before.hierarchy(**requested, rate_limits=limits)
    assert_same(made.at(there), there.hierarchy(**requested, rate_limits=limits), targets)
    narrow = 0.1 * limits[0], 0.1 * limits[1]
    assert_same(
        made.at(before).at(there, rate_limits=narrow),
        there.hierarchy(**requested, rate_limits=narrow),
        targets,
    )
