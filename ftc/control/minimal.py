"""The part of a linear plant that its inputs excite and its outputs see."""

from typing import TYPE_CHECKING

import numpy as np
import scipy.linalg

from argument_checks import Array

if TYPE_CHECKING:
    import control

TOLERANCE = 1e-7
"""Part of the state matrix, balanced, below which one motion does not drive another."""
_DECAYS = 1e-7
"""Part of the fastest pole by which a pole must lie left of the axis, to decay for certain."""


def minimal(plant: "control.StateSpace") -> "control.StateSpace":
    """A minimal realization of a plant with motions that do not decay; else the plant itself.

    A rod that spins between two ball joints is a double pole at zero, which no loop could move and
    none has to. What no input excites goes first, then what no output sees: the staircase algorithm
    (Rosenbrock 1970; Van Dooren, IEEE Trans. Automatic Control 26 (1981)) on the balanced state
    matrix, with orthogonal transformations; :data:`TOLERANCE` decides what counts as zero. A plant
    of which every motion decays is left as it is: there nothing needs to be judged.
    """
    import control  # late, as in ftc.control.compensator

    poles = plant.poles()
    if poles.real.max(initial=-np.inf) < -_DECAYS * np.abs(poles).max(initial=1.0):
        return plant
    (A, (scale, _)) = scipy.linalg.matrix_balance(plant.A, permute=False, separate=True)
    B, C = plant.B / scale[:, None], plant.C * scale
    V = _reached(A, B)
    A, B, C = V.T @ A @ V, V.T @ B, C @ V
    W = _reached(A.T, C.T)
    return control.ss(W.T @ A @ W, W.T @ B, C @ W, plant.D)


def _reached(A: Array, B: Array) -> Array:
    """Orthonormal basis of what B drives through A, shape (s, r)."""
    found = new = _basis(B, np.zeros((len(A), 0)), np.abs(B).max(initial=0.0))
    size = float(np.linalg.norm(A, 2))
    while new.shape[1]:
        new = _basis(A @ new, found, size)
        found = np.hstack([found, new])
    return found


def _basis(motions: Array, known: Array, size: float) -> Array:
    """Orthonormal basis of what these motions add to those that are known."""
    for _ in range(2):  # once leaves round-off of what is taken off
        motions = motions - known @ (known.T @ motions)
    U, s, _ = np.linalg.svd(motions, full_matrices=False)
    return U[:, s > TOLERANCE * size]
