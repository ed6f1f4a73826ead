"""Conditioning shown by a cheap bound, where no SVD is needed."""

import numpy as np
from scipy.linalg import lapack

from argument_checks import Array

ROUND_OFF = 1e-12
"""Fraction of the scale below which a triangle's singular values may be round-off."""


def well_conditioned_above(tolerance: float) -> float:
    """Fraction of the scale above which a singular value is clearly not zero.

    Below it the SVD decides, at the tolerance itself.
    """
    return max(2.0 * tolerance, ROUND_OFF)


def well_conditioned_inverse(A: Array, least: float) -> Array | None:
    """A^-1 of a square A, or None unless all its singular values are shown to exceed `least`."""
    if not A.size:
        return np.zeros_like(A)
    factors, pivots, singular = lapack.dgetrf(A)
    if singular:
        return None
    inverse, _ = lapack.dgetri(factors, pivots, overwrite_lu=True)
    return inverse if lapack.dlange("f", inverse) * least < 1.0 else None
