"""Mappings under limits: what is promised of the major task, of limits, and of each status."""

import itertools
from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linprog, lsq_linear, nnls

from prioritized import ConstrainedSystem, Status, force_mapping, velocity_mapping
from sim import jacobians
from tests.profiles import examples
from tests.random_systems import SEEDS, major_and_rest, of_rank, rows_of, systems

INF = np.inf
EYE = np.eye(2)


def box(rng: np.random.Generator, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Limits that zero obeys, every tenth pair equal."""
    lower, upper = -rng.uniform(0.05, 1, n), rng.uniform(0.05, 1, n)
    held = rng.random(n) < 0.1
    lower[held] = upper[held] = 0.0
    return lower, upper


def task_jacobian(rng: np.random.Generator, m: int, n: int) -> np.ndarray:
    """Full rank, any rank, or one singular value down to 1e-5."""
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


def weights_move_the_major_residual_by(seed: int) -> tuple[float, bool]:
    """The most, relative to the task, over three choices of weights and goals; whether limited."""
    rng = np.random.default_rng(seed)
    n, m = int(rng.integers(2, 8)), int(rng.integers(1, 7))
    m1 = int(rng.integers(1, m + 1))
    J, limits = task_jacobian(rng, m, n), box(rng, n)
    C = rng.normal(size=(1, n)) if n > 2 and rng.random() < 0.3 else None
    v = rng.normal(size=m1) * 10.0 ** rng.uniform(-1.5, 0.5)
    residuals, limited = [], False
    for kind in range(3):
        mapping = velocity_mapping(
            J,
            list(range(m1)),
            joint_weight=rng.uniform(0.1, 10, n) if kind != 1 else None,
            secondary_weight=rng.uniform(0.1, 10, m - m1) if kind != 2 else None,
            active_constraint=C,
            rate_limits=limits,
            when_limited=("least_squares", "scaled")[seed % 2],
        )
        found = mapping.solve(v, rng.normal(size=n), rng.normal(size=m - m1))
        assert within(found.rates, limits)
        assert found.status not in (Status.INFEASIBLE, Status.UNFINISHED)
        if C is not None:
            assert abs(C @ found.rates) < 1e-12
        residuals.append(found.residual)
        limited = limited or bool(found.limited)
    size = np.linalg.norm(v) + np.linalg.norm(J)
    moved = max(float(np.linalg.norm(rest - residuals[0])) for rest in residuals)
    return moved / float(size), limited


def test_weights_never_move_the_major_task_when_limits_bind():
    moved, limited = zip(*map(weights_move_the_major_residual_by, range(300)), strict=True)
    assert max(moved) < 1e-9
    assert 100 < sum(limited) < 200


@pytest.mark.long
def test_weights_never_move_the_major_task_in_10000_problems():
    moved, limited = zip(*map(weights_move_the_major_residual_by, range(10_000)), strict=True)
    assert max(moved) < 1e-9
    assert 4000 < sum(limited) < 6000


@given(SEEDS, st.integers(1, 6), st.integers(1, 4))
def test_rates_within_their_limits_are_the_ones_without_limits(seed, n, m):
    rng = np.random.default_rng(seed)
    J, v, d = rng.normal(size=(m, n)), rng.normal(size=1), rng.normal(size=n)
    free = velocity_mapping(J, [0], joint_weight=np.ones(n))
    rates = free(v, d)
    limits = rates - rng.uniform(1e-9, 1, n), rates + rng.uniform(1e-9, 1, n)
    found = velocity_mapping(J, [0], joint_weight=np.ones(n), rate_limits=limits).solve(v, d)
    np.testing.assert_allclose(found.rates, rates, rtol=0, atol=1e-13 * np.abs(rates).max())
    assert not found.active_limits.any()
    assert not found.limited


@given(st.data(), systems())
@examples(60)
def test_equal_limits_of_zero_are_a_lock(data, drawn):
    """The same rates as of the mechanism with these actuators locked, redundant rows or not."""
    kin, rng = drawn.system.kinematics(), drawn.rng
    m, n = kin.J.shape
    major = rows_of(data, m)
    locked = data.draw(st.sets(st.integers(0, n - 1)))
    lower, upper = -rng.uniform(0.1, 1, n), rng.uniform(0.1, 1, n)
    W, v = rng.uniform(0.5, 2, n), 2 * rng.normal(size=len(major))
    failed = drawn.system.with_failures(locked=sorted(locked)).kinematics()
    there = failed.velocity_mapping(major, joint_weight=W, rate_limits=(lower, upper)).solve(v)
    lower[list(locked)] = upper[list(locked)] = 0.0
    here = kin.velocity_mapping(major, joint_weight=W, rate_limits=(lower, upper)).solve(v)
    np.testing.assert_allclose(failed.expand(there.rates), here.rates, rtol=0, atol=1e-6)
    np.testing.assert_allclose(there.residual, here.residual, rtol=0, atol=1e-7)


@pytest.mark.parametrize("when", ["least_squares", "scaled"])
@pytest.mark.parametrize("constrained", [False, True])
def test_a_batch_is_answered_one_by_one(when, constrained):
    rng = np.random.default_rng(0)
    J, v = rng.normal(size=(4, 3, 5)), rng.normal(size=(2, 4, 2))
    C = rng.normal(size=(4, 1, 5)) if constrained else None
    task: Any = {"major": [0, 1], "joint_weight": np.ones(5)}
    task |= {"rate_limits": (-0.3, 0.4), "when_limited": when}
    found = velocity_mapping(J, active_constraint=C, **task).solve(v)
    for i, k in np.ndindex(2, 4):
        C_k = None if C is None else C[k]
        alone = velocity_mapping(J[k], active_constraint=C_k, **task).solve(v[i, k])
        np.testing.assert_allclose(found.rates[i, k], alone.rates, atol=1e-9)
        np.testing.assert_allclose(found.scale[i, k], alone.scale, atol=1e-9)
        assert found.limited[i, k] == alone.limited
        np.testing.assert_allclose(found.gains[i, k], alone.gains, atol=1e-7)


@given(systems(tasks=(2, 4)), SEEDS)
@examples(30)
def test_a_mapping_at_another_pose_keeps_its_limits(drawn, seed):
    rng, kin = np.random.default_rng(seed), drawn.system.kinematics()
    limits, v = box(rng, kin.J.shape[1]), rng.normal(size=1)
    J_T = drawn.system.J_T + 0.1 * rng.normal(size=drawn.system.J_T.shape)
    there = drawn.system.at(J_T, drawn.system.J_C).kinematics()
    moved = kin.velocity_mapping([0], rate_limits=limits).at(there)
    made = there.velocity_mapping([0], rate_limits=limits)
    np.testing.assert_allclose(moved(v), made(v), rtol=0, atol=1e-9)
    assert within(moved(v), limits)


@given(systems(tasks=(2, 4)), SEEDS, st.booleans())
@examples(30)
def test_a_mapping_at_another_pose_takes_the_limits_given_there(drawn, seed, diagonal):
    """As if it were made there, for all actuators or the survivors of a lock."""
    rng, n = np.random.default_rng(seed), len(drawn.system.active)
    failed = drawn.system.with_failures(locked=[0])
    limits, other, v = box(rng, n), box(rng, n), rng.normal(size=1)
    W = rng.uniform(0.5, 2.0, size=n) if diagonal else rng.normal(size=(n, n))
    mapping = failed.kinematics().velocity_mapping([0], joint_weight=W, rate_limits=limits)
    J_T = failed.J_T + 0.1 * rng.normal(size=failed.J_T.shape)
    there = failed.at(J_T).kinematics()
    moved = mapping.at(there, rate_limits=other)
    made = there.velocity_mapping([0], joint_weight=W, rate_limits=other)
    np.testing.assert_allclose(moved(v), made(v), rtol=0, atol=1e-9)
    np.testing.assert_allclose(moved.solve(v).rates, moved(v), rtol=0, atol=1e-9)
    assert moved.status is made.status
    assert within(moved(v), [side[1:] for side in other])
    assert within(mapping.at(there)(v), [side[1:] for side in limits])


@given(SEEDS, st.integers(2, 6), st.floats(0.01, 1))
def test_damping_weighs_the_error_against_the_rates_within_the_limits(seed, n, damping):
    """Another solver of |J x - v|^2 + damping^2 |x|^2 finds no less, J of full column rank."""
    rng = np.random.default_rng(seed)
    J, v, limits = rng.normal(size=(n, n)), 2 * rng.normal(size=n), box(rng, n)
    limits = limits[0] - 1e-3, limits[1] + 1e-3
    rates = velocity_mapping(J, list(range(n)), damping=damping, rate_limits=limits)(v)
    A, b = np.vstack([J, damping * np.eye(n)]), np.append(v, np.zeros(n))
    best = lsq_linear(A, b, limits, method="bvls", tol=1e-14).x
    np.testing.assert_allclose(rates, best, rtol=0, atol=1e-7)


@given(SEEDS, st.integers(1, 3), st.integers(0, 3))
def test_a_scaled_task_keeps_its_direction_as_fast_as_possible(seed, m, redundant):
    """A linear program knows the largest factor; 1 where the task is within the limits."""
    rng = np.random.default_rng(seed)
    n = m + redundant
    J, limits, v = rng.normal(size=(m, n)), box(rng, n), rng.normal(size=m)
    mapping = velocity_mapping(
        J, list(range(m)), joint_weight=np.ones(n), rate_limits=limits, when_limited="scaled"
    )
    found = mapping.solve(v, rng.normal(size=n))
    bounds = [*zip(*limits, strict=True), (0, 1)]
    most = linprog(
        [*np.zeros(n), -1.0], A_eq=np.column_stack([J, -v]), b_eq=np.zeros(m), bounds=bounds
    )
    assert found.scale == pytest.approx(most.x[-1], abs=1e-7)
    np.testing.assert_allclose(
        J @ found.rates, found.scale * v, rtol=0, atol=1e-11 * (1 + abs(v).max())
    )
    assert within(found.rates, limits)
    slow = mapping.solve(0.5 * most.x[-1] * v)
    assert slow.scale == pytest.approx(1.0, abs=1e-12)
    assert slow.status is (Status.EXACT if most.x[-1] > 1e-9 else slow.status)


@given(SEEDS, st.integers(2, 6))
def test_gains_are_the_slope_of_the_rates_while_the_active_limits_stay(seed, n):
    rng = np.random.default_rng(seed)
    J, limits = rng.normal(size=(3, n)), (-np.full(n, 0.4), np.full(n, 0.5))
    mapping = velocity_mapping(
        J, [0], joint_weight=np.ones(n), secondary_weight=np.ones(2), rate_limits=limits,
        rate_rows=(rng.normal(size=(1, n)), -0.2, 0.2),
    )  # fmt: skip
    aims = rng.normal(size=1), rng.normal(size=n), rng.normal(size=2)
    found, p = mapping.solve(*aims), np.concatenate(aims)
    assert not found.gains[found.active_limits != 0].any()
    step = 1e-7
    for k, gain in enumerate(found.gains.T):
        moved = p + step * np.eye(len(p))[k]
        other = mapping.solve(*np.split(moved, [1, 1 + n]), start=found)
        same = (other.active_limits == found.active_limits).all()
        if same and (other.active_rows == found.active_rows).all():
            np.testing.assert_allclose((other.rates - found.rates) / step, gain, atol=1e-6)


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
def test_the_status_says_what_holds_the_task_back(J, v, more, status):
    mapping = velocity_mapping(J, [0, 1], **({"rate_limits": (-1.0, 1.0)} | more))
    found = mapping.solve(v)
    assert found.status is status
    assert np.isfinite(found.rates).all()
    assert bool(found.limited) == (max(v) > 1) or status is Status.INFEASIBLE


@pytest.fixture(scope="module")
def hexapod(model) -> ConstrainedSystem:
    jac = jacobians(model, mujoco.MjData(model), site="payload", axes="base")
    return ConstrainedSystem(jac.J_T, jac.J_C, jac.active)


CODES = list(itertools.product(range(3), repeat=6))
"""All conditions: each strut sound, locked or free."""


def limited_in_all_conditions(hexapod: ConstrainedSystem, codes: Any, count: int) -> None:
    rng = np.random.default_rng(0)
    for code in codes:
        locked, free = ([k for k in range(6) if code[k] == c] for c in (1, 2))
        kin = hexapod.with_failures(locked=locked, free=free).kinematics()
        if not len(kin.actuators):
            continue
        limits = -rng.uniform(0.5, 1, 6), rng.uniform(0.5, 1, 6)
        mapping = kin.velocity_mapping(
            [0, 1], joint_weight=np.ones(6), secondary_weight=[10, 10, 1, 1.0], rate_limits=limits
        )
        for _ in range(count):
            found = mapping.solve(10.0 ** rng.uniform(-1, 2) * rng.normal(size=2))
            assert found.status not in (Status.INFEASIBLE, Status.UNFINISHED), code
            assert within(found.rates, [side[kin.actuators] for side in limits]), code
            assert np.isfinite(found.residual).all()
            size = 1 + np.abs(kin.active_constraint).sum()
            assert np.all(abs(kin.active_constraint @ found.rates) < 1e-10 * size), code


def test_saturated_targets_in_conditions_of_the_hexapod(hexapod):
    limited_in_all_conditions(hexapod, CODES[::7], 2)


@pytest.mark.long
def test_200_saturated_targets_in_all_729_conditions_of_the_hexapod(hexapod):
    limited_in_all_conditions(hexapod, CODES, 200)


# Forces.


@given(SEEDS, st.integers(1, 5), st.data())
def test_the_major_force_is_the_nearest_that_the_torque_limits_admit(seed, n, data):
    """J is square: forces J^-T torques, whose least squares over the box another solver knows."""
    rng, m1 = np.random.default_rng(seed), data.draw(st.integers(1, n))
    J, f = of_rank(rng, n, n, n), 3 * rng.normal(size=m1)
    limits = -rng.uniform(0.1, 1, n), rng.uniform(0.1, 1, n)
    major = list(range(m1))
    found = force_mapping(J, major, torque_weight=np.ones(n), torque_limits=limits).solve(f)
    assert within(found.torques, limits)
    forces = np.linalg.inv(J.T)[:m1]
    best = lsq_linear(forces, f, limits, method="bvls", tol=1e-14).x
    np.testing.assert_allclose(found.residual, f - forces @ best, rtol=0, atol=1e-6)
    balance = J.T @ np.append(f - found.residual, found.secondary_force)
    np.testing.assert_allclose(found.torques, balance, rtol=0, atol=1e-11)


@given(st.data(), systems())
@examples(60)
def test_limited_torques_are_in_equilibrium_with_task_and_internal_forces(data, drawn):
    """Torques = J^T f + C^T eta, within the limits exactly, whatever the mechanism."""
    kin, rng = drawn.system.kinematics(), drawn.rng
    m, n = kin.J.shape
    major, rest = major_and_rest(data, m)
    limits = -rng.uniform(0.1, 1, n), rng.uniform(0.1, 1, n)
    f = 3 * rng.normal(size=len(major))
    found = kin.force_mapping(major, torque_weight=np.ones(n), torque_limits=limits).solve(f)
    assert within(found.torques, limits)
    assert found.status not in (Status.INFEASIBLE, Status.UNFINISHED)
    force = np.zeros(m)
    force[major], force[rest] = f - found.residual, found.secondary_force
    balance = kin.J.T @ force + kin.active_constraint.T @ found.internal_force
    size = 1 + abs(force).max(initial=0) + abs(found.internal_force).max(initial=0)
    np.testing.assert_allclose(found.torques, balance, rtol=0, atol=1e-9 * size)


@given(SEEDS, st.integers(1, 3), st.integers(1, 3))
def test_actuators_that_only_push_make_the_nearest_force_of_their_cone(seed, m, extra):
    """Cables and fingers: torques J^T f >= 0; of square J nonnegative least squares knows it."""
    n, rng = m + extra - 1, np.random.default_rng(seed)
    J, f = of_rank(rng, n, n, n), rng.normal(size=m)
    major = list(range(m))
    found = force_mapping(J, major, torque_limits=(0.0, INF)).solve(f)
    assert (found.torques >= 0).all()
    _, error = nnls(np.linalg.inv(J.T)[:m], f)
    assert np.linalg.norm(found.residual) == pytest.approx(error, abs=1e-8)


def test_a_friction_pyramid_holds_the_tangential_force_back():
    """Coefficient 0.5: 2 N along the normal bear 1 N across it, 3 N across need 6 N along."""
    mu = 0.5
    sides = np.array([[1.0, 0, -mu], [-1, 0, -mu], [0, 1, -mu], [0, -1, -mu], [0, 0, -1]])
    mapping = force_mapping(np.eye(3), [0], force_rows=(sides, -INF, 0.0))
    held = force_mapping(
        np.eye(3), [2], secondary=[0, 1], secondary_weight=np.ones(2), force_rows=(sides, -INF, 0.0)
    ).solve([2.0], secondary_force=[3.0, 0.2])
    np.testing.assert_allclose(held.torques, [1.0, 0.2, 2.0], atol=1e-12)
    assert held.active_rows.tolist() == [1, 0, 0, 0, 0]
    alone = mapping.solve([3.0])
    np.testing.assert_allclose(alone.torques, [3.0, 0.0, 6.0], atol=1e-12)
    assert alone.status is Status.EXACT


def test_scaled_forces_keep_their_direction():
    mapping = force_mapping(np.eye(2), [0, 1], torque_limits=(-1.0, 1.0), when_limited="scaled")
    found = mapping.solve([4.0, 1.0])
    np.testing.assert_allclose(found.torques, [1.0, 0.25], atol=1e-12)
    assert found.scale == pytest.approx(0.25)
    assert found.status is Status.SCALED


# Copies, and wrong input.


@pytest.mark.parametrize("made", [velocity_mapping, force_mapping])
def test_without_limits_a_solution_is_the_answer_of_the_mapping(made):
    mapping = made(np.array([[1.0, 0.5, 0.2], [0.3, 1.0, 0.1]]), [0])
    found = mapping.solve([2.0])
    answer = found.rates if made is velocity_mapping else found.torques
    np.testing.assert_allclose(answer, mapping([2.0]), atol=1e-14)
    np.testing.assert_array_equal(found.active_limits, [0, 0, 0])
    assert found.status is Status.EXACT and found.active_rows.size == 0


def test_mappings_and_solutions_keep_copies():
    J, low, up, v = np.eye(2), -np.ones(2), np.ones(2), np.array([2.0, 0.5])
    for made, limits in ((velocity_mapping, "rate_limits"), (force_mapping, "torque_limits")):
        J[:], low[:], up[:], v[:] = np.eye(2), -1.0, 1.0, [2.0, 0.5]
        given_limits: dict[str, Any] = {limits: (low, up)}
        mapping = made(J, [0, 1], **given_limits)
        found = mapping.solve(v)
        J[:], low[:], up[:], v[:] = 9.0, -9.0, 9.0, 9.0
        np.testing.assert_allclose(mapping([2.0, 0.5]), [1.0, 0.5], atol=1e-15)
        np.testing.assert_allclose(found.residual, [1.0, 0.0], atol=1e-15)
        assert found.status is Status.LIMITED


@pytest.mark.parametrize(
    ("made", "named", "arguments"),
    [
        (velocity_mapping, "rate_limits", {"rate_limits": (1.0, 0.0)}),
        (velocity_mapping, "rate_limits", {"rate_limits": (np.nan, 1.0)}),
        (velocity_mapping, "rate_limits", {"rate_limits": ([0, np.nan], [1.0, 1.0])}),
        (velocity_mapping, "rate_limits", {"rate_limits": (np.zeros(2), np.array([1, np.nan]))}),
        (velocity_mapping, "rate_limits", {"rate_limits": (np.zeros(3), np.ones(3))}),
        (velocity_mapping, "rate_limits", {"rate_limits": 1.0}),
        (velocity_mapping, "rate_limits", {"rate_limits": (INF, INF)}),
        (velocity_mapping, "rate_rows", {"rate_rows": (EYE, 0.0)}),
        (velocity_mapping, "rate_rows", {"rate_rows": (np.eye(3), 0.0, 1.0)}),
        (velocity_mapping, "when_limited", {"when_limited": "clipped"}),
        (force_mapping, "torque_limits", {"torque_limits": (1.0, 0.0)}),
        (force_mapping, "torque_rows", {"torque_rows": (EYE, 1.0, 0.0)}),
        (force_mapping, "force_rows", {"force_rows": (np.eye(3), 0.0, 1.0)}),
    ],
)
def test_wrong_limits_are_named_in_one_sentence(made, named, arguments):
    with pytest.raises(ValueError, match="must") as error:
        made(EYE, [0, 1], **arguments)
    assert str(error.value).startswith(named)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("made", [velocity_mapping, force_mapping])
def test_the_solution_of_the_tick_before_is_a_start(made):
    """The same answer from it as from nothing, in fewer steps."""
    rng, steps = np.random.default_rng(0), np.zeros(2)
    name = "rate_limits" if made is velocity_mapping else "torque_limits"
    limits: dict[str, Any] = {name: (-0.3, 0.3)}
    for _ in range(20):
        mapping = made(rng.normal(size=(4, 6)), [0, 1], **limits)
        v = rng.normal(size=2)
        begun = mapping.solve(v)
        cold = mapping.solve(1.01 * v)
        warm = mapping.solve(1.01 * v, start=begun)
        np.testing.assert_allclose(warm.optimum.x, cold.optimum.x, rtol=0, atol=1e-9)
        steps += cold.optimum.point.steps[0], warm.optimum.point.steps[0]
    assert steps[1] < steps[0]
