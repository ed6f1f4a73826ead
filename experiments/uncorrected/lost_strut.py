"""What a lost strut costs any linear loop that is fast beside the spiral."""

import mujoco
import numpy as np

from experiments.hexapod.mapping import StrutMapping
from experiments.uncorrected.candidate import STRUT
from experiments.uncorrected.machine import EQUAL
from sim import NOMINAL, Array, hexapod


def remaining_gain(model: mujoco.MjModel) -> Array:
    """True per demanded (alpha, beta) of W_a's mapping while strut 1 stands still, shape (2, 2)."""
    geometry = hexapod(model)
    J_m = np.linalg.inv(geometry.inverse_jacobian(NOMINAL))[:2]
    mapping = StrutMapping(geometry, EQUAL, "constant").pointing_gain()
    mapping[STRUT] = 0.0
    return J_m @ mapping


def fast_loop_ratio(gain: Array) -> Array:
    """RMS errors over those of the sound machine, for any linear compensators, shape (2,).

    With G the gain that is left and L = diag(L_alpha, L_beta) the sound loops, the error is
    e = (I + G L)^-1 r, since each compensator sees its own angle alone. Where |L| >> 1 this is
    L^-1 G^-1 r, and the sound error L^-1 r: each angle passes the same filter in both, which
    cancels from the ratio. The spiral has as much of alpha as of beta at every frequency, a quarter
    turn apart; so what is left are the norms of the rows of G^-1, whatever the compensators are.

    Args:
        gain: G, shape (2, 2).
    """
    return np.linalg.norm(np.linalg.inv(gain), axis=1)
