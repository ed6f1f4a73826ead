"""Spaces of motions and forces by dense algebra in all coordinates: nothing is eliminated."""

from collections.abc import Sequence

import numpy as np

from prioritized import ConstrainedSystem, Kinematics
from tests.random_systems import ZERO


def null(A: np.ndarray) -> np.ndarray:
    """Null space of a matrix whose singular values are zero or far above 1e-8."""
    _, sigma, Vt = np.linalg.svd(A)
    return Vt[np.count_nonzero(sigma > ZERO) :].T


def projector(basis: np.ndarray) -> np.ndarray:
    """What two orthonormal bases of one space have in common."""
    return basis @ basis.T


def assert_same(one: np.ndarray, two: np.ndarray, atol: float = 1e-6) -> None:
    """Two orthonormal bases of one space."""
    np.testing.assert_allclose(projector(one), projector(two), atol=atol)


def assert_spans(basis: np.ndarray, made: np.ndarray, atol: float = 1e-6) -> None:
    """An orthonormal basis of what the columns of a matrix span."""
    beyond = projector(null(made.T))
    np.testing.assert_allclose(projector(basis), np.eye(len(made)) - beyond, atol=atol)


def dense_lexicographic(
    hard: np.ndarray, levels: Sequence[tuple[np.ndarray, np.ndarray]]
) -> np.ndarray:
    """Least |A x - b| for each level in turn inside hard x = 0, by nested null-space bases."""
    basis = null(hard)
    x = np.zeros(hard.shape[1])
    for A, b in levels:
        kernel = null(A @ basis)
        seen = basis @ null(kernel.T)
        x = x + seen @ np.linalg.lstsq(A @ seen, b - A @ x, rcond=None)[0]
        basis = basis @ kernel
    return x


def stuck_joints(system: ConstrainedSystem) -> list[int]:
    """Velocity indices of all joints that cannot move."""
    locked = system.active[sorted(system.failures.locked)].tolist()
    return sorted({*locked, *system.failures.locked_passive})


def closure(system: ConstrainedSystem) -> np.ndarray:
    """Section 2.3.2: J_C with a unit row under it for each stuck joint."""
    return np.vstack([system.J_C, np.eye(system.J_T.shape[1])[stuck_joints(system)]])


def motions(system: ConstrainedSystem) -> np.ndarray:
    """Orthonormal basis of all generalized velocities that the mechanism allows."""
    return null(closure(system))


def self_motions(system: ConstrainedSystem, kin: Kinematics) -> np.ndarray:
    """Orthonormal basis of those with every active joint held, in all coordinates."""
    fixed = np.eye(system.J_T.shape[1])[kin.active]
    return null(np.vstack([closure(system), fixed]))
