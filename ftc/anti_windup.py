"""Anti-windup from the achieved major task, and the stability of a loop whose demand is limited.

Where limits hold the major task back, u_a = P(u) is achieved of the demand u. The compensators then
observe what is achieved: x' = A x + B e + L (u_a - u), the back-calculation of Astrom and Hagglund
(Advanced PID Control, 2006, section 3.5) in its observer form.

L is the gain of the stationary Kalman filter of x with u_a as its measurement, the error and the
measurement equally uncertain: A - L C is stable for every compensator that has a state-space
realization, integrators lose their excess in about the time of the crossover, and nothing is left
to tune. With an exact measurement it would be Hanus' conditioning, whose poles A - B D^-1 C are the
zeros of the compensator; a roll-off sampled by Tustin's rule has its zeros at -1, so that the states
would ring for ever.
"""

from collections.abc import Sequence

import control
import numpy as np
import scipy.linalg

from argument_checks import Array
from ftc.compensator import Channel


def tracking_gain(channel: Channel) -> Array:
    """Gain L of one compensator, shape (order,); empty for a compensator without states."""
    A, B, C, D = (np.asarray(part) for part in (channel.A, channel.B, channel.C, channel.D))
    if not len(A):
        return np.zeros(0)
    noise, both = D @ D.T + 1.0, B @ D.T
    P = scipy.linalg.solve_discrete_are(A.T, C.T, B @ B.T, noise, s=both)
    return ((A @ P @ C.T + both) / (C @ P @ C.T + noise))[:, 0]


def circle_margin(
    plant: control.StateSpace, compensators: Sequence[Channel], *, anti_windup: bool
) -> float:
    """Margin of the circle criterion for limits on the demand; the loop is stable if positive.

    Limits that are met with least squares project the demand on the convex set of what is
    attainable; scaling shortens it. Both satisfy u_a . (u - u_a) >= 0, if the set contains zero.
    With u = -H u_a around the loop, I + H strictly positive real is sufficient for a stable loop
    whatever the limits are (Khalil, Nonlinear Systems, 2002, section 7.1).

    Args:
        plant: Sampled, from the major task achieved to the one measured, (m1, m1). What limits
            change in the displacements beside the major task must not be measurable.
        compensators: One for each output.
        anti_windup: Whether the compensators observe what is achieved.

    Returns:
        Smallest eigenvalue of the Hermitian part of I + H over frequency; 1 without a loop.
    """
    zero = control.ss([], [], [], [[0.0]], plant.dt)
    back = control.append(*(_back(each) if anti_windup else zero for each in compensators))
    loop = plant
    frequency_rad_s = 2 * np.pi * np.geomspace(1e-2, 0.499 / plant.dt, 4000)
    forward = control.append(*(control.ss(c.A, c.B, c.C, c.D, plant.dt) for c in compensators))
    G, K, M = (
        np.moveaxis(control.frequency_response(each, frequency_rad_s).frdata, -1, 0)
        for each in (loop, forward, back)
    )
    one = np.eye(plant.noutputs)
    H = np.linalg.solve(one + M, one + K @ G)
    return float(np.linalg.eigvalsh((H + H.conj().swapaxes(1, 2)) / 2).min())


def _back(channel: Channel) -> control.StateSpace:
    """From u - u_a, through the tracking gain, to what it takes off the demand."""
    if not len(channel.A):
        return control.ss([], [], [], [[0.0]], channel.dt)
    L = tracking_gain(channel)[:, None]
    return control.ss(channel.A, L, channel.C, 0, channel.dt)
