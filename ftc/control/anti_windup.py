"""Anti-windup from the achieved major task, and the stability of a loop under limits.

Where limits hold the demand u back, u_a is achieved. The compensators observe what is achieved:

    x' = A x + B e + L (u_a - u)

This is back-calculation (Astrom and Hagglund, Advanced PID Control, 2006, section 3.5) in its
observer form. L is the gain of the stationary Kalman filter of x that measures u_a, error and
measurement being equally uncertain. A - L C is then stable for every compensator, an integrator
loses its excess in about the inverse of its own gain, and nothing has to be tuned. If u_a were
taken as exact, this would be Hanus' conditioning, whose poles are the zeros of the compensator. A
roll-off that is sampled by Tustin's rule has its zeros at -1: its states would oscillate undamped.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy.linalg

import argument_checks as check
from argument_checks import Array
from ftc.control.compensator import Channel
from ftc.control.frequency_response import SampledSystem, channels, frequency_response, sampled

SLOWNESS = 1e-6, 1e6
"""From and to."""


def tracking_gain(channel: Channel, slowness: float = 1.0) -> Array:
    """Gain L of one compensator, shape (order,); empty for a compensator without states.

    `slowness` multiplies the tracking time, in which an integrator of gain K loses its excess, 1/K:
    what is achieved counts as that many times more uncertain than the error.

    Raises:
        ValueError, TypeError: Not one channel, or a slowness that is not from 1e-6 to 1e6.
    """
    sampled("channel", channel, 1, 1)
    check.within("slowness", slowness, *SLOWNESS)
    A, B, C, D = (np.asarray(part) for part in (channel.A, channel.B, channel.C, channel.D))
    if not len(A):
        return np.zeros(0)
    noise, both = D @ D.T + slowness**2, B @ D.T
    P = scipy.linalg.solve_discrete_are(A.T, C.T, B @ B.T, noise, s=both)
    return ((A @ P @ C.T + both) / (C @ P @ C.T + noise))[:, 0]


def circle_margin(
    plant: SampledSystem, compensators: Sequence[Channel], *, anti_windup: bool
) -> float:
    """Margin of the circle criterion for limits of the demand; a positive one proves stability.

    Limits that are met with least error project the demand on a convex set. For any two demands,
    (u - w) . (u_a - w_a) >= |u_a - w_a|^2. With u = -H u_a around the loop it is therefore
    sufficient that I + H is strictly positive real: whatever the limits are, all responses to one
    reference then converge to each other (Khalil, Nonlinear Systems, 2002, section 7.1, for the
    difference of two responses). If the direction is kept instead ("scaled"), the inequality holds
    for w = 0 alone, and with it stability about the point from which demands are scaled.

    Args:
        plant: Sampled and stable, from the major task achieved to the one measured, (m1, m1). It is
            assumed that displacements that leave the major task alone are not measured.
        compensators: One for each output.
        anti_windup: Whether the compensators observe what is achieved. Without, H has the poles of
            the integrators: responses stay bounded, but need not converge.

    Raises:
        ValueError, TypeError: Of another kind or shape than that.

    Returns:
        Smallest eigenvalue of the Hermitian part of I + H over frequency.
    """
    channels("compensators", compensators)
    sampled("plant", plant, len(compensators), len(compensators))
    check.flag("anti_windup", anti_windup)
    w = 2 * np.pi * np.geomspace(1e-2, 0.499 / plant.dt, 4000)
    P, K = frequency_response(plant, w), _diagonal([frequency_response(k, w) for k in compensators])
    M = np.zeros_like(K)
    if anti_windup:
        M = _diagonal([frequency_response(_correction(each), w) for each in compensators])
    one = np.eye(len(compensators))
    around = np.linalg.solve(one + M, one + K @ P)
    hermitian = (around + around.conj().swapaxes(1, 2)) / 2
    return float(np.linalg.eigvalsh(hermitian).min())


class _Correction(NamedTuple):
    """From u - u_a to what L takes off the demand of one compensator."""

    A: Array
    B: Array
    C: Array
    D: Array
    dt: float


def _correction(channel: Channel) -> _Correction:
    L = tracking_gain(channel)[:, None]
    return _Correction(channel.A, L, channel.C, np.zeros((1, 1)), channel.dt)


def _diagonal(responses: Sequence[Array]) -> Array:
    """Response (F, m, m) of m channels beside each other, from that of each, (F, 1, 1)."""
    return np.concatenate(responses, axis=1) * np.eye(len(responses))
