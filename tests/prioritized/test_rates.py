"""Rates without gains, loops without an SVD where ranks are clear: both say what the SVD says."""

from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from prioritized import ConstrainedSystem, velocity_mapping
from prioritized._mechanism import elimination
from prioritized._solver.rank import RANK_TOLERANCE
from tests.random_systems import (
    SEEDS,
    failures,
    of_rank,
    orthogonal,
    projector,
    rows_of,
    systems,
    weights,
)


def drawn_mapping(data, drawn):
    """Of some rows, the others being secondary, with weights of all kinds."""
    kin, rng = drawn.system.kinematics(), drawn.rng
    m, n = kin.J.shape
    major = rows_of(data, m)
    W1, W2 = data.draw(weights(n, rng)), data.draw(weights(m - len(major), rng))
    return kin.velocity_mapping(major, None, W1, W2)


def aims_of(mapping, rng):
    """Three random velocities; and the first of them with zeros for the others."""
    sizes = mapping.major.shape[1], *mapping.joint.shape[1:], mapping.secondary.shape[1]
    aims = tuple(rng.normal(size=size) for size in sizes)
    return aims, (aims[0], *map(np.zeros_like, aims[1:]))


def by_gains(mapping, v_m, rates_d, v_sd):
    gains = (mapping.major, v_m), (mapping.joint, rates_d), (mapping.secondary, v_sd)
    return sum(np.einsum("...ij,...j->...i", gain, value) for gain, value in gains)


@given(st.data(), systems())
def test_rates_are_what_the_gains_say_whatever_the_ranks(data, drawn):
    """Reflections where all is well conditioned, an SVD elsewhere: one result."""
    mapping = drawn_mapping(data, drawn)
    aims, zeros = aims_of(mapping, drawn.rng)
    np.testing.assert_allclose(mapping(*aims), by_gains(mapping, *aims), atol=1e-7)
    np.testing.assert_allclose(mapping(aims[0]), by_gains(mapping, *zeros), atol=1e-7)


@given(SEEDS, st.integers(1, 4), st.integers(0, 3), st.integers(1, 40), st.data())
def test_many_at_once_are_each_what_it_is_alone(seed, m1, extra, count, data):
    """Some of them singular, some with weights that decide nothing: each in its own way."""
    rng = np.random.default_rng(seed)
    m, n = m1 + 2, m1 + extra
    J = rng.normal(size=(count, m, n))
    J[rng.random(count) < 0.2, 0] = 0.0  # out of reach
    own = data.draw(st.booleans())
    W1 = rng.normal(size=(count, n, n) if own else (n, n))
    W1[..., data.draw(st.integers(0, n)) :, :] = 0.0
    W2 = rng.normal(size=(count, 2, 2)) if data.draw(st.booleans()) else np.ones(2)
    aims = rng.normal(size=(count, m1)), rng.normal(size=(count, n)), rng.normal(size=2)
    rates = velocity_mapping(J, list(range(m1)), None, W1, W2)(*aims)
    for k in range(count):
        weight = W1[k] if own else W1
        secondary = W2[k] if W2.ndim == 3 else W2
        alone = velocity_mapping(J[k], list(range(m1)), None, weight, secondary)
        size = 1e-9 * max(1.0, float(np.abs(rates[k]).max()))
        np.testing.assert_allclose(
            rates[k], alone(aims[0][k], aims[1][k], aims[2]), atol=size, rtol=1e-6
        )


@given(SEEDS, st.floats(4, 16), st.floats(-3, 3), st.booleans())
def test_near_a_singularity_the_major_task_is_met_until_the_threshold(
    seed, nearness, unit, in_weights
):
    """The major task or the weights lose a direction bit by bit; a batch says the same."""
    rng = np.random.default_rng(seed)
    small, size = 10.0**-nearness, 10.0**unit
    near = size * orthogonal(rng, 3) @ np.diag([1.0, 1.0, small]) @ orthogonal(rng, 3)
    well = size * of_rank(rng, 3, 3, 3)
    J = np.vstack([well[:1] if in_weights else near[:1], well[1:]])
    if not in_weights:  # two major rows, nearly one
        J[1] = J[0] + small * well[1]
    major = [0] if in_weights else [0, 1]
    W1 = near if in_weights else np.eye(3)
    mapping = velocity_mapping(J, major, joint_weight=W1)
    v_m = rng.normal(size=len(major)) * size
    if small > 1e3 * RANK_TOLERANCE:
        assert mapping.rank == len(major)
        assert float(mapping.gap) > 1.0
        np.testing.assert_allclose(J[major] @ mapping(v_m), v_m, rtol=1e-6, atol=1e-6 * size)
    pair = velocity_mapping(np.stack([J, J]), major, joint_weight=W1)(v_m)
    scale = float(np.abs(pair).max())
    close = 1e-13 / small if small > 2 * RANK_TOLERANCE else 1e-3
    np.testing.assert_allclose(pair[0], mapping(v_m), atol=close * scale + 1e-12)


def eliminates_without_svd(kin):
    """Whether the loops are found regular without a singular value decomposition."""
    with patch.object(elimination, "whole_svd", wraps=elimination.whole_svd) as svd:
        assert kin.J.ndim == 2
    return not svd.called


def with_a_row_of_zeros(system):
    """The same mechanism: J_Cp is not square any more."""
    J_C = np.vstack([system.J_C, np.zeros((1, system.J_C.shape[1]))])
    return system.at(J_C=J_C)


@given(st.data(), systems())
def test_a_row_of_zeros_changes_no_motion_and_no_verdict(data, drawn):
    """However many rows say the same: one mechanism."""
    system = data.draw(failures(drawn.system))
    kin, more = system.kinematics(), with_a_row_of_zeros(system).kinematics()
    np.testing.assert_allclose(kin.J, more.J, atol=1e-9)
    np.testing.assert_allclose(kin.passive_gain, more.passive_gain, atol=1e-9)
    np.testing.assert_allclose(projector(kin.self_motion), projector(more.self_motion), atol=1e-9)
    forbidden = kin.active_constraint, more.active_constraint
    np.testing.assert_allclose(*(rows.T @ rows for rows in forbidden), atol=1e-9)
    f = drawn.rng.normal(size=len(kin.J))
    c, forces = len(system.J_C), (kin.constraint_force(f), more.constraint_force(f))
    np.testing.assert_allclose(forces[0], np.delete(forces[1], c), atol=1e-9)
    major = rows_of(data, len(kin.J))
    one, other = kin.manipulability(major), more.manipulability(major)
    for name in {*one.bases} - {"irresolvable"}:  # nothing balances the reaction of such a row
        assert one.bases[name].shape == other.bases[name].shape, name
    statuses = {each.velocity_mapping(major).status for each in (kin, more)}
    assert len(statuses) == 1


@given(SEEDS, st.floats(0, 18), st.integers(1, 12), st.integers(1, 3), st.floats(-6, 6))
def test_loops_are_eliminated_without_svd_only_if_it_would_find_them_regular(
    seed, nearness, p, n, unit
):
    """The loops lose a direction bit by bit, in any units; verdict and motion stay the SVD's."""
    rng = np.random.default_rng(seed)
    sigma = np.append(rng.uniform(0.5, 2.0, size=p - 1), 10.0**-nearness)
    J_C = rng.normal(size=(p, n + p))
    J_C[:, n:] = orthogonal(rng, p) * sigma @ orthogonal(rng, p)
    system = ConstrainedSystem(rng.normal(size=(2, n + p)), 10.0**unit * J_C, range(n))
    kin, more = system.kinematics(), with_a_row_of_zeros(system).kinematics()
    relative, quick = sigma.min() / np.linalg.norm(J_C), eliminates_without_svd(kin)
    assert len(kin.active_constraint) == len(more.active_constraint)
    if relative > 1e-12:  # below it is round-off
        np.testing.assert_allclose(kin.gap, more.gap, rtol=1e-3)
    if quick:
        assert relative > 1.999 * RANK_TOLERANCE
        J_T, gain = system.J_T, np.linalg.pinv(system.J_C[:, n:]) @ system.J_C[:, :n]
        J = J_T[:, :n] - J_T[:, n:] @ gain
        scale = np.linalg.norm(J_T[:, :n]) + np.linalg.norm(J_T[:, n:]) * np.linalg.norm(gain)
        for each in (kin, more):
            np.testing.assert_allclose(each.J, J, atol=1e-13 / relative**2 * scale)
    else:
        assert relative < 2.001 * np.sqrt(p) * RANK_TOLERANCE


@given(SEEDS, st.integers(1, 20), st.integers(1, 4), st.floats(0.05, 0.9))
def test_loops_that_share_few_joints_move_as_dense_ones_do(seed, p, n, share):
    """Passive rates by LAPACK, whichever joints each loop has."""
    rng = np.random.default_rng(seed)
    J_C = rng.normal(size=(p, n + p)) * (rng.random((p, n + p)) < share)
    J_C[np.arange(p), n + rng.permutation(p)] += 4.0
    system = ConstrainedSystem(rng.normal(size=(2, n + p)), J_C, range(n))
    kin, error = system.kinematics(), 1e-13 * np.linalg.cond(J_C[:, n:]) ** 2
    expected = -np.linalg.solve(J_C[:, n:], J_C[:, :n])
    np.testing.assert_allclose(kin.passive_gain, expected, atol=error)
    force = np.linalg.solve(J_C[:, n:].T, -system.J_T[:, n:].T)
    np.testing.assert_allclose(kin.constraint_force(np.eye(2)).T, force, atol=error)


@given(SEEDS, st.integers(1, 4), st.integers(0, 4), st.integers(0, 3), st.booleans())
def test_reflections_solve_the_constrained_least_squares(seed, p, free, more, diagonal):
    """Equations met, and no slope left along what they leave free."""
    rng = np.random.default_rng(seed)
    n, m2 = p + free, more
    J, W2 = rng.normal(size=(p + m2, n)), rng.normal(size=m2)
    W1 = rng.uniform(0.1, 3.0, n) if diagonal else rng.normal(size=(n, n))
    mapping = velocity_mapping(J, list(range(p)), None, W1, W2)
    v, rates_d, v_sd = rng.normal(size=p), rng.normal(size=n), rng.normal(size=m2)
    matrix = np.diag(W1) if diagonal else W1
    assume(np.linalg.cond(J[:p]) < 1e3 and np.linalg.cond(matrix) < 1e4)
    x = mapping(v, rates_d, v_sd)
    size = max(1.0, np.abs(x).max())
    np.testing.assert_allclose(J[:p] @ x, v, atol=1e-9 * size)
    Z = np.linalg.svd(J[:p])[2][p:].T
    error, error_s = matrix @ (x - rates_d), W2 * (J[p:] @ x - v_sd)
    slope = Z.T @ (matrix.T @ error + J[p:].T @ (W2 * error_s))
    np.testing.assert_allclose(slope, 0.0, atol=1e-9 * size * float(np.linalg.norm(matrix)))


J = np.random.default_rng(3).normal(size=(4, 5))
BAD: dict[str, dict[str, Any]] = {
    "v_major": {"v_major": np.array([np.nan, 0.0])},
    "joint_velocity": {"v_major": np.ones(2), "joint_velocity": np.full(5, np.inf)},
    "secondary_velocity": {"v_major": np.ones(2), "secondary_velocity": np.array([np.nan, 1.0])},
}


@pytest.mark.parametrize("name", BAD)
@pytest.mark.parametrize("batch", [False, True])
def test_a_velocity_that_is_not_finite_is_refused_by_name_without_gains_too(name, batch):
    many = np.stack([J, J]) if batch else J
    mapping = velocity_mapping(many, [0, 1], None, np.ones(5), np.ones(2))
    with pytest.raises(ValueError, match=f"{name} must be finite"):
        mapping(**BAD[name])
    with pytest.raises(ValueError, match=r"v_major must have shape \(\.\.\., 2\), got \(3,\)"):
        mapping(np.ones(3))


def test_lists_and_integers_are_as_good_as_arrays():
    mapping = velocity_mapping(J, [0, 1], None, np.ones(5), [1, 2])
    np.testing.assert_array_equal(mapping([1, 2], [0] * 5), mapping(np.array([1.0, 2.0])))


def test_a_mapping_keeps_its_own_copy_of_what_it_was_given():
    given_J, W1 = J.copy(), np.eye(5)
    mapping = velocity_mapping(given_J, [0, 1], joint_weight=W1)
    before = mapping(np.ones(2))
    given_J *= 2.0
    W1[0, 0] = 100.0
    np.testing.assert_array_equal(mapping(np.ones(2)), before)
    np.testing.assert_allclose(mapping.major @ np.ones(2), before, atol=1e-12)


@given(systems(), SEEDS)
def test_a_mechanism_at_another_pose_is_as_if_made_there(drawn, seed):
    system = drawn.system.with_failures(locked=[0])
    rng = np.random.default_rng(seed)
    J_T = system.J_T + 0.1 * rng.normal(size=system.J_T.shape)
    assert system.kinematics().J.shape[1] == len(system.active) - 1
    for moved, J_C in (
        (system.at(J_T), system.J_C),
        (system.at(J_T, 2 * system.J_C), 2 * system.J_C),
    ):
        made = ConstrainedSystem(J_T, J_C, system.active).with_failures(locked=[0])
        assert moved.failures == made.failures
        np.testing.assert_array_equal(moved.kinematics().J, made.kinematics().J)
        np.testing.assert_array_equal(moved.kinematics().gap, made.kinematics().gap)
        freed = moved.with_failures(free=[len(system.active) - 1])
        assert freed.kinematics().J.shape[1] == max(0, len(system.active) - 2)
    with pytest.raises(ValueError, match="J_T must have"):
        system.at(np.zeros((len(J_T) + 1, J_T.shape[1])))


@given(st.data(), systems())
def test_rates_at_another_pose_are_what_the_gains_there_say(data, drawn):
    """One compiled call where ranks are clearly full, elsewhere the mapping there: one result."""
    mapping, J_T = drawn_mapping(data, drawn), drawn.system.J_T
    there = drawn.system.at(J_T=orthogonal(drawn.rng, len(J_T)) @ J_T).kinematics()
    aims, zeros = aims_of(mapping, drawn.rng)
    expected = by_gains(mapping.at(there), *aims)
    np.testing.assert_allclose(mapping.at(there)(*aims), expected, atol=1e-7)
    expected = by_gains(mapping.at(there), *zeros)
    np.testing.assert_allclose(mapping.at(there)(aims[0]), expected, atol=1e-7)
    np.testing.assert_allclose(mapping.at(there)(aims[0].tolist()), expected, atol=1e-7)


def test_rates_at_another_pose_obey_limits_and_refuse_what_a_call_refuses():
    rng = np.random.default_rng(0)
    J, limit = rng.normal(size=(3, 5)), 0.1
    system = ConstrainedSystem(J, None, range(5))
    kin, there = system.kinematics(), system.at(J_T=2 * J).kinematics()
    free = kin.velocity_mapping([0, 1], joint_weight=np.ones(5))
    limited = kin.velocity_mapping([0, 1], joint_weight=np.ones(5), rate_limits=(-limit, limit))
    assert np.abs(free.at(there)(np.ones(2))).max() > limit
    assert np.abs(limited.at(there)(np.ones(2))).max() <= limit
    many = free.at(there)(np.ones((4, 2)))
    np.testing.assert_allclose(many, np.tile(free.at(there)(np.ones(2)), (4, 1)), rtol=1e-12)
    for wrong in (np.ones(3), np.array([np.nan, 0.0]), "fast"):
        with pytest.raises(ValueError, match="v_major must"):
            free.at(there)(wrong)
    other = ConstrainedSystem(J[:, :4], None, range(4)).kinematics()
    with pytest.raises(ValueError, match="kinematics must have a J of shape"):
        free.at(other)(np.ones(2))
    with pytest.raises(TypeError, match="kinematics must be a Kinematics"):
        free.at(J)(np.ones(2))  # type: ignore[arg-type]


def test_rates_at_a_pose_where_the_loop_ties_the_actuators_obey_it():
    """A loop whose passive joint cannot move any more, though it could where the mapping began."""
    J_T, loop = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]), np.array([[1.0, -1.0, 1.0]])
    system = ConstrainedSystem(J_T, loop, [0, 1])
    mapping = system.kinematics().velocity_mapping([0], joint_weight=np.ones(2))
    np.testing.assert_allclose(mapping.at(system.kinematics())(np.ones(1)), [1, 0], atol=1e-14)
    tied = system.at(J_C=loop * [1.0, 1.0, 0.0]).kinematics()
    np.testing.assert_allclose(mapping.at(tied)(np.ones(1)), [1, 1], atol=1e-14)
