"""Motions of the hexapod that pointing does not see while all struts work."""

import numpy as np

from ftc.fdi.dither import Dither
from sim import Array

HEAVE = (1.0,) * 6
"""All six struts lengthen and shorten together: the payload heaves along the line of sight.

The columns of J_m of the six struts add up to zero, statically and, by the threefold symmetry of
the machine, at any frequency. A strut that does not follow leaves its own column uncancelled: six
directions in the plane of (alpha, beta), 60 degrees apart, and each strut has one to itself.
"""

STILL = Dither(0.0, 0.0, HEAVE)

EXCITATION = (
    Dither(10e-6, 3.0, direction=(1.0, 0.0, 0.0, 1.0, 0.0, 0.0)),
    Dither(10e-6, 5.0, direction=(0.0, 1.0, 0.0, 0.0, 1.0, 0.0)),
    Dither(10e-6, 7.0, direction=(0.0, 0.0, 1.0, 0.0, 0.0, 1.0)),
    Dither(10e-6, 11.0, direction=(1.0, -1.0, 1.0, -1.0, 1.0, -1.0)),
)
"""Of a commissioning run: every direction in the null space of J_m, each at its frequency.
Pointing alone shows two combinations of the six gains, and these the other four."""


def excitation(time_s: float) -> Array:
    """Desired strut displacements of a commissioning run, shape (6,)."""
    return np.sum([dither.at(time_s) for dither in EXCITATION], axis=0)
