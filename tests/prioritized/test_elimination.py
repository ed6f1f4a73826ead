"""Test loops that are eliminated without an SVD: results equal those of the SVD."""

from unittest.mock import patch

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from prioritized import ConstrainedSystem
from prioritized._mechanism import elimination
from prioritized._solver.rank import RANK_TOLERANCE
from tests import spaces
from tests.random_systems import SEEDS, failures, orthogonal, rows_of, systems


def eliminates_without_svd(kin):
    """Return whether the loops are certified regular without a singular value decomposition."""
    with patch.object(elimination, "whole_svd", wraps=elimination.whole_svd) as svd:
        assert kin.J.ndim == 2
    return not svd.called


def with_a_row_of_zeros(system):
    """Return the same mechanism with a non-square J_Cp."""
    J_C = np.vstack([system.J_C, np.zeros((1, system.J_C.shape[1]))])
    return system.at(J_C=J_C)


@given(st.data(), systems())
def test_a_row_of_zeros_changes_no_motion_and_no_classification(data, sample):
    """Compare the mechanism with itself with redundant rows."""
    system = data.draw(failures(sample.system))
    kin, more = system.kinematics(), with_a_row_of_zeros(system).kinematics()
    np.testing.assert_allclose(kin.J, more.J, atol=1e-9)
    np.testing.assert_allclose(kin.passive_gain, more.passive_gain, atol=1e-9)
    spaces.assert_same(kin.self_motion, more.self_motion, 1e-9)
    forbidden = kin.active_constraint, more.active_constraint
    np.testing.assert_allclose(*(rows.T @ rows for rows in forbidden), atol=1e-9)
    f = sample.rng.normal(size=len(kin.J))
    c, forces = len(system.J_C), (kin.constraint_force(f), more.constraint_force(f))
    np.testing.assert_allclose(forces[0], np.delete(forces[1], c), atol=1e-9)
    major = rows_of(data, len(kin.J))
    one, other = kin.manipulability(major), more.manipulability(major)
    for name in {*one.bases} - {"irresolvable"}:  # the reaction of such a row is not balanced
        assert one.bases[name].shape == other.bases[name].shape, name
    statuses = {each.velocity_mapping(major).status for each in (kin, more)}
    assert len(statuses) == 1


@given(SEEDS, st.floats(0, 18), st.integers(1, 12), st.integers(1, 3), st.floats(-6, 6))
def test_loops_are_eliminated_without_svd_only_if_they_are_regular(seed, nearness, p, n, unit):
    """Check loops that gradually lose a direction, in any units, against the SVD."""
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
    """Compare passive rates with LAPACK for sparse loops."""
    rng = np.random.default_rng(seed)
    J_C = rng.normal(size=(p, n + p)) * (rng.random((p, n + p)) < share)
    J_C[np.arange(p), n + rng.permutation(p)] += 4.0
    system = ConstrainedSystem(rng.normal(size=(2, n + p)), J_C, range(n))
    kin, error = system.kinematics(), 1e-13 * np.linalg.cond(J_C[:, n:]) ** 2
    expected = -np.linalg.solve(J_C[:, n:], J_C[:, :n])
    np.testing.assert_allclose(kin.passive_gain, expected, atol=error)
    force = np.linalg.solve(J_C[:, n:].T, -system.J_T[:, n:].T)
    np.testing.assert_allclose(kin.constraint_force(np.eye(2)).T, force, atol=error)
