"""Thresholds above which singular values are certainly non-zero, so that no SVD is needed."""

from math import ceil, inf, isfinite, log2, sqrt

from argument_checks import Array
from prioritized._mechanism.geometry import Geometry
from prioritized._solver.rank import ERROR_MARGIN, ROUND_OFF, norm


def well_conditioned_above(tolerance: float) -> float:
    """Return the fraction of the scale above which a singular value is certainly not zero.

    Below it the SVD decides, at the tolerance itself.
    """
    return max(2.0 * tolerance, 1e3 * ROUND_OFF)


def loop_threshold(geometry: Geometry) -> float:
    """Return the fraction of |J_C| above which a singular value of J_Cp is certainly not zero."""
    A, threshold = geometry.closure, well_conditioned_above(geometry.rank_tolerance)
    errors = sqrt(A.size) * geometry.error_bound
    return max(threshold, ERROR_MARGIN * errors / (norm(A) or 1.0))


def task_threshold(geometry: Geometry, scale: float, gain: Array, closing: Array) -> float:
    """Return the fraction of its scale above which a singular value of J is certainly not zero.

    `scale` is that of J, eq. (14), `gain` (p, n) passive rates per active rate, `closing` J_Cp^-1.
    """
    threshold, bound = well_conditioned_above(geometry.rank_tolerance), geometry.error_bound
    if not bound:
        return threshold
    # Errors of the loops reach the task through the passive joints.
    errors = sqrt(geometry.J_T.size) + geometry.size * norm(closing) * sqrt(geometry.J_C.size)
    errors *= bound * (1.0 + norm(gain))
    if not isfinite(errors):
        return inf
    # Rounded to a power of two, because results that depend on it are cached.
    return 2.0 ** ceil(log2(max(threshold, ERROR_MARGIN * errors / (scale or 1.0))))
