"""The part of a linear plant that its inputs excite and its outputs see."""

from typing import TYPE_CHECKING

import numpy as np
import scipy.linalg

from argument_checks import Array
from ftc.control.frequency_response import balanced

if TYPE_CHECKING:
    import control

_DECAYS = 1e-6
"""Part of the size of the state matrix by which a motion must decay to do so for certain, and below
which one motion that does not decay drives no other."""
_SEEN = 1e-4
"""Part of all inputs or outputs below which a motion is not excited, or not seen."""


def minimal(plant: "control.StateSpace") -> "control.StateSpace":
    """A plant without those motions that do not decay and that no input excites or no output sees.

    A rod that spins between two ball joints is a pole at zero that no loop could move and none has
    to. The motions that do not decay are split off (ordered Schur form of the balanced state
    matrix, Sylvester equation: Bavely and Stewart, SIAM J. Numer. Anal. 16 (1979)), and of these
    what no input excites and then what no output sees is taken out, by the staircase algorithm
    (Rosenbrock 1970; Van Dooren, IEEE Trans. Automatic Control 26 (1981)). The tolerances of this
    module decide what counts as zero. Motions that decay stay, whether seen or not.
    """
    import control  # late, as in ftc.control.compensator

    A, scale = balanced(plant.A)
    least = _DECAYS * float(np.linalg.norm(A, 2)) if len(A) else 0.0
    T, Z, count = scipy.linalg.schur(A, output="real", sort=lambda re, im: re > -least)
    if not count:
        return plant
    B, C = Z.T @ (plant.B / scale[:, None]), (plant.C * scale) @ Z
    slow, fast = T[:count, :count], T[count:, count:]
    X = scipy.linalg.solve_sylvester(slow, -fast, -T[:count, count:])
    B_slow, C_slow = B[:count] - X @ B[count:], C[:, :count]
    for _ in range(2):  # what is excited, then of the dual what is seen
        V = _reached(slow, B_slow, _SEEN * float(np.abs(B).max(initial=0.0)), least)
        slow, B_slow, C_slow = (V.T @ slow @ V).T, (C_slow @ V).T, (V.T @ B_slow).T
        B, C = C.T, B.T
    outputs = np.hstack([C_slow, C[:, :count] @ X + C[:, count:]])
    inputs = np.vstack([B_slow, B[count:]])
    return control.ss(scipy.linalg.block_diag(slow, fast), inputs, outputs, plant.D)


def _reached(A: Array, B: Array, least_input: float, least_motion: float) -> Array:
    """Orthonormal basis of what B drives through A, shape (s, r)."""
    found = new = _basis(B, np.zeros((len(A), 0)), least_input)
    while new.shape[1]:
        new = _basis(A @ new, found, least_motion)
        found = np.hstack([found, new])
    return found


def _basis(motions: Array, known: Array, least: float) -> Array:
    """Orthonormal basis of what these motions add to those that are known."""
    for _ in range(2):  # once leaves round-off of what is taken off
        motions = motions - known @ (known.T @ motions)
    U, s, _ = np.linalg.svd(motions, full_matrices=False)
    return U[:, s > least]
