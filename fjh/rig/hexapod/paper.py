"""Numbers printed in Chen, McInroy, Yi (2003), as data."""

import numpy as np

JACOBIAN = np.array(
    [
        [1.740, 1.740, 0.000, -1.740, -1.740, 0.000],
        [1.004, -1.004, -2.009, -1.004, 1.004, 2.009],
        [0.710, -0.710, 0.710, -0.710, 0.710, -0.710],
        [0.354, -0.354, -0.000, 0.354, -0.354, 0.000],
        [0.204, 0.204, -0.408, 0.204, 0.204, -0.408],
        [-0.289, -0.289, -0.289, -0.289, -0.289, -0.289],
    ]
)
"""Jacobian (39), section 4.1: rates of [alpha, beta, gamma, t_x, t_y, t_z] per strut rate."""

CONDITION_NUMBER = 4.92
"""Condition number of eq. (39), section 4.1."""

TABLE_I_URAD = {
    "W_a": (2.4476, 3.0916),
    "W_b": (2.2444, 3.2712),
    "W_c": (2.3115, 3.2528),
    "W_d": (2.3634, 3.5601),
    "W_e": (2.8324, 3.2868),
    "W_a_uncorrected": (9.8167, 4.7903),
}
"""Table I, section 4.2: RMS of desired minus measured (alpha, beta), [urad]."""

JACOBIAN_VARIATION = {"frobenius": 0.0012, "two": 0.0018}
"""Variation e of eq. (40) in the Frobenius and the 2-norm, section 4.1."""

JACOBIAN_VARIATION_TOLERANCE = 5e-5
"""Half a unit of the last printed digit of the variation."""

STROKE_M = 0.000635
"""Largest strut displacement of eq. (40), section 4.1 [m]."""
