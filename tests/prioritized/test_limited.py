"""Test mappings under limits: priority of the major task, exact limits, and status."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linprog, lsq_linear

from prioritized import Status, force_mapping, velocity_mapping
from tests.profiles import examples
from tests.random_systems import SEEDS, major_and_secondary, of_rank, rows_of, systems

INF = np.inf
EYE = np.eye(2)
NIGHT = [pytest.mark.long, pytest.mark.night]


def box(rng: np.random.Generator, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Return limits that zero satisfies, every tenth pair equal."""
    lower, upper = -rng.uniform(0.05, 1, n), rng.uniform(0.05, 1, n)
    fixed = rng.random(n) < 0.1
    lower[fixed] = upper[fixed] = 0.0
    return lower, upper


def task_jacobian(rng: np.random.Generator, m: int, n: int) -> np.ndarray:
    """Sample full rank, any rank, or one singular value down to 1e-5."""
    kind = rng.integers(0, 3)
    if kind == 0:
        return of_rank(rng, m, n, int(rng.integers(1, min(m, n) + 1)))
    J = rng.normal(size=(m, n))
    if kind == 2:
        U, sigma, Vt = np.linalg.svd(J, full_matrices=False)
        sigma[-1] = 10.0 ** rng.uniform(-5, -1)
        J = U * sigma @ Vt
    return J


def within(rates: np.ndarray, limits: Any) -> bool:
    return bool(((limits[0] <= rates) & (rates <= limits[1])).all())


def moved_by_weights(made: Any, when: str, seed: int) -> tuple[float, bool]:
    """Return the largest relative change of the major residual by weights; and `limited`."""
    rng = np.random.default_rng(seed)
    n, m = int(rng.integers(2, 8)), int(rng.integers(1, 7))
    m1 = int(rng.integers(1, m + 1))
    J, limits = task_jacobian(rng, m, n), box(rng, n)
    C = rng.normal(size=(1, n)) if n > 2 and rng.random() < 0.3 else None
    v = rng.normal(size=m1) * 10.0 ** rng.uniform(-1.5, 0.5)
    is_velocity, residuals, limited = made is velocity_mapping, [], False
    for weighed in ("both", "secondary", "joints"):
        W1 = rng.uniform(0.1, 10, n) if weighed != "secondary" else None
        W2 = rng.uniform(0.1, 10, m - m1) if weighed != "joints" else None
        listed = {"rate_limits" if is_velocity else "torque_limits": limits, "when_limited": when}
        mapping = made(J, list(range(m1)), None, W1, W2, C, **listed)
        result = mapping.solve(v, rng.normal(size=n), rng.normal(size=m - m1))
        assert within(result.rates if is_velocity else result.torques, limits)
        assert result.status not in (Status.INFEASIBLE, Status.UNFINISHED)
        if is_velocity and C is not None:
            assert abs(C @ result.rates) < 1e-12
        residuals.append(result.residual)
        limited = limited or bool(result.limited)
    size = np.linalg.norm(v) + np.linalg.norm(J)
    moved = max(float(np.linalg.norm(others - residuals[0])) for others in residuals)
    return moved / float(size), limited


@pytest.mark.parametrize(
    "seeds",
    # A torque of the last three hardly depends on a force: intermediate x are 1e5 times as large.
    [[*range(40), 138, 500, 3476], pytest.param(range(5000), marks=NIGHT, id="5000")],
)
@pytest.mark.parametrize("when", ["least_squares", "scaled"])
@pytest.mark.parametrize("made", [velocity_mapping, force_mapping])
def test_weights_do_not_affect_a_limited_major_task(made, when, seeds):
    """Check that joint and secondary weights and goals do not change its residual."""
    moved, limited = zip(*(moved_by_weights(made, when, seed) for seed in seeds), strict=True)
    assert max(moved) < 1e-9
    assert 0.25 < np.mean(limited) < 0.75


@given(st.data(), systems())
@examples(60)
def test_equal_limits_of_zero_are_a_lock(data, sample):
    """Compare with the mechanism with these actuators locked, with redundant rows or not."""
    kin, rng = sample.system.kinematics(), sample.rng
    m, n = kin.J.shape
    major = rows_of(data, m)
    locked = data.draw(st.sets(st.integers(0, n - 1)))
    lower, upper = -rng.uniform(0.1, 1, n), rng.uniform(0.1, 1, n)
    W, v = rng.uniform(0.5, 2, n), 2 * rng.normal(size=len(major))
    failed = sample.system.with_failures(locked=sorted(locked)).kinematics()
    there = failed.velocity_mapping(major, joint_weight=W, rate_limits=(lower, upper)).solve(v)
    lower[list(locked)] = upper[list(locked)] = 0.0
    here = kin.velocity_mapping(major, joint_weight=W, rate_limits=(lower, upper)).solve(v)
    np.testing.assert_allclose(failed.expand(there.rates), here.rates, rtol=0, atol=1e-6)
    np.testing.assert_allclose(there.residual, here.residual, rtol=0, atol=1e-7)


@given(SEEDS, st.integers(1, 3), st.integers(0, 3))
def test_a_scaled_task_has_the_largest_factor_within_the_limits(seed, m, redundant):
    """Compare the factor with a linear program; it is 1 if the task is within the limits."""
    rng = np.random.default_rng(seed)
    n = m + redundant
    J, limits, v = rng.normal(size=(m, n)), box(rng, n), rng.normal(size=m)
    mapping = velocity_mapping(
        J, list(range(m)), joint_weight=np.ones(n), rate_limits=limits, when_limited="scaled"
    )
    result = mapping.solve(v, rng.normal(size=n))
    bounds = [*zip(*limits, strict=True), (0, 1)]
    most = linprog(
        [*np.zeros(n), -1.0], A_eq=np.column_stack([J, -v]), b_eq=np.zeros(m), bounds=bounds
    )
    assert result.scale == pytest.approx(most.x[-1], abs=1e-7)
    np.testing.assert_allclose(
        J @ result.rates, result.scale * v, rtol=0, atol=1e-11 * (1 + abs(v).max())
    )
    assert within(result.rates, limits)
    slow = mapping.solve(0.5 * most.x[-1] * v)
    assert slow.scale == pytest.approx(1.0, abs=1e-12)
    assert slow.status is (Status.EXACT if most.x[-1] > 1e-9 else slow.status)


@given(SEEDS, st.integers(2, 6))
def test_gains_are_the_slope_of_the_rates_while_active_limits_stay(seed, n):
    rng = np.random.default_rng(seed)
    J, limits = rng.normal(size=(3, n)), (-np.full(n, 0.4), np.full(n, 0.5))
    mapping = velocity_mapping(
        J, [0], joint_weight=np.ones(n), secondary_weight=np.ones(2), rate_limits=limits,
        rate_rows=(rng.normal(size=(1, n)), -0.2, 0.2),
    )  # fmt: skip
    targets = rng.normal(size=1), rng.normal(size=n), rng.normal(size=2)
    result, p = mapping.solve(*targets), np.concatenate(targets)
    assert not result.gains[result.active_limits != 0].any()
    step = 1e-7
    for k, gain in enumerate(result.gains.T):
        moved = p + step * np.eye(len(p))[k]
        other = mapping.solve(*np.split(moved, [1, 1 + n]), start=result)
        same = (other.active_limits == result.active_limits).all()
        if same and (other.active_rows == result.active_rows).all():
            np.testing.assert_allclose((other.rates - result.rates) / step, gain, atol=1e-6)


@pytest.mark.parametrize(
    ("J", "v", "more", "status"),
    [
        (EYE, [0.5, 0.5], {}, Status.EXACT),
        (EYE, [2.0, 0.5], {}, Status.LIMITED),
        (EYE, [2.0, 0.5], {"when_limited": "scaled"}, Status.SCALED),
        (EYE, [0.5, 0.5], {"when_limited": "scaled"}, Status.EXACT),
        (np.ones((2, 2)), [1.0, 0.5], {}, Status.LEAST_SQUARES),
        (np.ones((2, 2)), [9.0, 9.0], {}, Status.LIMITED),
        (EYE, [0.5, 0.5], {"self_motion": np.array([[1.0], [0.0]])}, Status.SELF_MOTION),
        (EYE, [9.0, 0.5], {"self_motion": np.array([[1.0], [0.0]])}, Status.SELF_MOTION),
        (EYE, [0.5, 0.5], {"rate_rows": (np.ones((1, 2)), 3.0, 4.0)}, Status.INFEASIBLE),
        (EYE, [0.5, 0.5], {"active_constraint": EYE, "rate_limits": (0.1, 1)}, Status.INFEASIBLE),
        (EYE, [0.5, 0.0], {"damping": 0.1}, Status.DAMPED),
    ],
)
def test_the_status_distinguishes_the_restrictions_of_the_task(J, v, more, status):
    mapping = velocity_mapping(J, [0, 1], **({"rate_limits": (-1.0, 1.0)} | more))
    result = mapping.solve(v)
    assert result.status is status
    assert np.isfinite(result.rates).all()
    assert bool(result.limited) == (max(v) > 1) or status is Status.INFEASIBLE


@given(SEEDS, st.integers(1, 5), st.data())
def test_the_major_force_is_the_nearest_that_the_torque_limits_admit(seed, n, data):
    """Compare, for square J, with the least squares over the box by another solver."""
    rng, m1 = np.random.default_rng(seed), data.draw(st.integers(1, n))
    J, f = of_rank(rng, n, n, n), 3 * rng.normal(size=m1)
    limits = -rng.uniform(0.1, 1, n), rng.uniform(0.1, 1, n)
    if data.draw(st.booleans()):  # cables and fingers only pull or push
        limits = np.zeros(n), np.full(n, INF)
    major = list(range(m1))
    result = force_mapping(J, major, torque_weight=np.ones(n), torque_limits=limits).solve(f)
    assert within(result.torques, limits)
    forces = np.linalg.inv(J.T)[:m1]
    best = lsq_linear(forces, f, limits, method="bvls", tol=1e-14).x
    np.testing.assert_allclose(result.residual, f - forces @ best, rtol=0, atol=1e-6)
    balance = J.T @ np.append(f - result.residual, result.secondary_force)
    np.testing.assert_allclose(result.torques, balance, rtol=0, atol=1e-11)


@given(st.data(), systems())
@examples(60)
def test_limited_torques_balance_task_and_internal_forces(data, sample):
    """Check torques = J^T f + C^T eta, within the limits exactly, for any mechanism."""
    kin, rng = sample.system.kinematics(), sample.rng
    m, n = kin.J.shape
    major, others = major_and_secondary(data, m)
    limits = -rng.uniform(0.1, 1, n), rng.uniform(0.1, 1, n)
    f = 3 * rng.normal(size=len(major))
    result = kin.force_mapping(major, torque_weight=np.ones(n), torque_limits=limits).solve(f)
    assert within(result.torques, limits)
    assert result.status not in (Status.INFEASIBLE, Status.UNFINISHED)
    force = np.zeros(m)
    force[major], force[others] = f - result.residual, result.secondary_force
    balance = kin.J.T @ force + kin.active_constraint.T @ result.internal_force
    size = 1 + abs(force).max(initial=0) + abs(result.internal_force).max(initial=0)
    np.testing.assert_allclose(result.torques, balance, rtol=0, atol=1e-9 * size)


def test_a_friction_pyramid_limits_the_tangential_force():
    """Check a coefficient of 0.5: 2 N normal force bears 1 N tangential, 3 N need 6 N."""
    mu = 0.5
    sides = np.array([[1.0, 0, -mu], [-1, 0, -mu], [0, 1, -mu], [0, -1, -mu], [0, 0, -1]])
    mapping = force_mapping(np.eye(3), [0], force_rows=(sides, -INF, 0.0))
    fixed = force_mapping(
        np.eye(3), [2], secondary=[0, 1], secondary_weight=np.ones(2), force_rows=(sides, -INF, 0.0)
    ).solve([2.0], secondary_force=[3.0, 0.2])
    np.testing.assert_allclose(fixed.torques, [1.0, 0.2, 2.0], atol=1e-12)
    assert fixed.active_rows.tolist() == [1, 0, 0, 0, 0]
    alone = mapping.solve([3.0])
    np.testing.assert_allclose(alone.torques, [3.0, 0.0, 6.0], atol=1e-12)
    assert alone.status is Status.EXACT
