"""Distance of a wrench from the border of the attainable set: the formula of Du et al.

G.-X. Du, Q. Quan, B. Yang, K.-Y. Cai, "Controllability analysis for multirotor helicopter rotor
degradation and failure", J. Guidance, Control, and Dynamics 38(5), 2015, theorem 3 (arXiv
1403.5986).
"""

from itertools import combinations

import numpy as np

ARM, DRAG, LARGEST, WEIGHT = 0.275, 0.1, 6.125, 1.535 * 9.80
"""Constants of both hexacopters: arm [m], drag torque per thrust [m], thrust [N], weight [N]."""

ROUNDED = 5e-5
"""Tolerance of numbers published with four decimals."""


def effectiveness(turns: str, arm: float = ARM) -> np.ndarray:
    """Return lift and the torques about x, y and z per thrust, shape (4, 6)."""
    place, spin = np.deg2rad(60 * np.arange(6)), [1 if turn == "P" else -1 for turn in turns]
    return np.array([np.ones(6), -arm * np.sin(place), arm * np.cos(place), DRAG * np.array(spin)])


def distances(
    B: np.ndarray, wrench: np.ndarray, lower: np.ndarray, upper: np.ndarray
) -> np.ndarray:
    """Return distances of a wrench (m,) from all faces of {B u}, negative beyond.

    Each face is parallel to m - 1 columns.
    """
    m, n = B.shape
    middle, half = (upper + lower) / 2, (upper - lower) / 2
    result = []
    for columns in combinations(range(n), m - 1):
        U, sigma, _ = np.linalg.svd(B[:, columns])
        if sigma[-1] > 1e-9:
            along = U[:, -1] @ B
            result.append(abs(along) @ half - abs(along @ middle - U[:, -1] @ wrench))
    return np.array(result)
