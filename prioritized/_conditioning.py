"""Where singular values are clearly not zero, so that no SVD is needed."""

ROUND_OFF = 1e-12
"""Fraction of the scale below which a triangle's singular values may be round-off."""


def well_conditioned_above(tolerance: float) -> float:
    """Fraction of the scale above which a singular value is clearly not zero.

    Below it the SVD decides, at the tolerance itself.
    """
    return max(2.0 * tolerance, ROUND_OFF)
