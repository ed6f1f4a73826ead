"""Spaces of motions and forces by dense algebra in all coordinates, without elimination."""

from collections.abc import Sequence

import numpy as np

from prioritized import ConstrainedSystem, Kinematics
from tests.random_systems import ZERO


def null(A: np.ndarray) -> np.ndarray:
    """Return the null space of a matrix whose singular values are zero or far above 1e-8."""
    _, sigma, Vt = np.linalg.svd(A)
    return Vt[np.count_nonzero(sigma > ZERO) :].T


def projector(basis: np.ndarray) -> np.ndarray:
    """Return the orthogonal projector, which all orthonormal bases of a space have in common."""
    return basis @ basis.T


def assert_same(one: np.ndarray, two: np.ndarray, atol: float = 1e-6) -> None:
    """Assert that two orthonormal bases span one space."""
    np.testing.assert_allclose(projector(one), projector(two), atol=atol)


def assert_spans(basis: np.ndarray, made: np.ndarray, atol: float = 1e-6) -> None:
    """Assert that an orthonormal basis spans the columns of a matrix."""
    beyond = projector(null(made.T))
    np.testing.assert_allclose(projector(basis), np.eye(len(made)) - beyond, atol=atol)


def dense_lexicographic(
    hard: np.ndarray, levels: Sequence[tuple[np.ndarray, np.ndarray]]
) -> np.ndarray:
    """Minimize |A x - b| for each level in turn with hard x = 0, by nested null-space bases."""
    basis = null(hard)
    x = np.zeros(hard.shape[1])
    for A, b in levels:
        kernel = null(A @ basis)
        seen = basis @ null(kernel.T)
        x = x + seen @ np.linalg.lstsq(A @ seen, b - A @ x, rcond=None)[0]
        basis = basis @ kernel
    return x


def stuck_joints(system: ConstrainedSystem) -> list[int]:
    """Return the velocity indices of all joints that cannot move."""
    locked = system.active[sorted(system.failures.locked)].tolist()
    return sorted({*locked, *system.failures.locked_passive})


def closure(system: ConstrainedSystem) -> np.ndarray:
    """Return J_C with a unit row for each stuck joint, section 2.3.2."""
    return np.vstack([system.J_C, np.eye(system.J_T.shape[1])[stuck_joints(system)]])


def motions(system: ConstrainedSystem) -> np.ndarray:
    """Return an orthonormal basis of all generalized velocities that the mechanism allows."""
    return null(closure(system))


def self_motions(system: ConstrainedSystem, kin: Kinematics) -> np.ndarray:
    """Return an orthonormal basis of motions with every active joint locked, in all coordinates."""
    fixed = np.eye(system.J_T.shape[1])[kin.active]
    return null(np.vstack([closure(system), fixed]))
