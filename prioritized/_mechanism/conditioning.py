"""Where singular values are clearly not zero, so that no SVD is needed."""

from math import ceil, inf, isfinite, log2, sqrt

import numpy as np

from argument_checks import Array
from prioritized._mechanism.geometry import Geometry
from prioritized._solver.rank import norm

ROUND_OFF = 1e-12
"""Fraction of the scale below which a triangle's singular values may be round-off."""
NOTHING = 1e-13
"""Fraction of the scale below which a singular value is zero at any tolerance."""
_MARGIN = 4.0
"""Of bounds of errors, which are of first order."""


def well_conditioned_above(tolerance: float) -> float:
    """Fraction of the scale above which a singular value is clearly not zero.

    Below it the SVD decides, at the tolerance itself.
    """
    return max(2.0 * tolerance, ROUND_OFF)


def certain_rank(sigma: Array, scale: float, clear: float) -> int | None:
    """Number of singular values above `clear` parts of the scale, if all others are round-off.

    They descend.
    """
    if len(sigma) and sigma[-1] > clear * scale:  # the common case
        return len(sigma)
    count = int(np.count_nonzero(sigma > clear * scale))
    return None if (sigma[count:] > NOTHING * scale).any() else count


def clear_loops(geometry: Geometry) -> float:
    """The same of the closure J_Cp, as a fraction of |J_C|, for errors of its entries."""
    A, clear = geometry.closure, well_conditioned_above(geometry.rank_tolerance)
    return max(clear, _MARGIN * sqrt(A.size) * geometry.error_bound / (norm(A) or 1.0))


def clear_of_errors(geometry: Geometry, scale: float, gain: Array, closing: Array) -> float:
    """The same of the task Jacobian J of this scale, eq. (14).

    Args:
        geometry: J_T and J_C.
        scale: Of J.
        gain: Passive rates per active rate, (p, n).
        closing: J_Cp^-1, (p, p).
    """
    clear = well_conditioned_above(geometry.rank_tolerance)
    bound = geometry.error_bound
    if not bound:
        return clear
    # Errors of the loops reach the task through the passive joints.
    errors = sqrt(geometry.J_T.size) + geometry.size * norm(closing) * sqrt(geometry.J_C.size)
    errors *= bound * (1.0 + norm(gain))
    if not isfinite(errors):
        return inf
    # Few different numbers: what depends on them is looked up.
    return 2.0 ** ceil(log2(max(clear, _MARGIN * errors / (scale or 1.0))))
