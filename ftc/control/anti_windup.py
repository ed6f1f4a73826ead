"""The compensators of all channels in a loop, and what keeps them from winding up at limits.

At a limit of their own demand they are held (conditional integration). Where limits of the
actuators hold the demand u back, u_a is achieved, and the compensators observe that, as in
x' = A x + B e + L (u_a - u): back-calculation in its observer form (both: Astrom and Hagglund,
Advanced PID Control, 2006, section 3.5).
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import block_diag, solve_discrete_are

import argument_checks as check
from argument_checks import Array
from ftc.control.compensator import Channel
from ftc.control.frequency_response import SampledSystem, channels, frequency_response, sampled
from kernels import lib, pointer

SLOWNESS = 1e-6, 1e6
"""Least and largest slowness of a tracking gain."""


class Compensators:
    """The compensators of m channels as one system with m inputs and outputs, to be stepped."""

    def __init__(self, loops: Sequence[Channel]) -> None:
        """Stack the channels, which were checked."""
        self.A, self.B, self.C, self.D = (
            block_diag(*(getattr(channel, part) for channel in loops)) for part in "ABCD"
        )
        self.order, self.dt = len(self.A), loops[0].dt
        self._channel = np.repeat(np.arange(len(loops)), [len(channel.A) for channel in loops])
        self._M = np.block([[self.A, self.B], [self.C, self.D]])

    def step(self, states: Array, errors: Array) -> tuple[Array, Array]:
        """Next states (..., order) and demands (..., m) of states and errors (..., m)."""
        if states.ndim == 1:  # compiled, for every tick
            after = np.empty(len(self._M))
            arguments = pointer(states), pointer(errors), pointer(after)
            lib.compensate(pointer(self._M), len(after), self.order, len(errors), *arguments)
            return after[: self.order], after[self.order :]
        after = np.concatenate([states, errors], axis=-1) @ self._M.T
        return after[..., : self.order], after[..., self.order :]

    def limited(
        self, states: Array, errors: Array, most: ArrayLike, holds: ArrayLike
    ) -> tuple[Array, Array]:
        """Next states and demands that are at most `most` either way.

        Where `holds`, a compensator at its limit keeps its states while its error would drive it
        further.
        """
        after, demanded = self.step(states, errors)
        demand = demanded.clip(-np.asarray(most), most)
        is_held = holds & (demand != demanded) & (errors * demanded > 0)
        return np.where(is_held[..., self._channel], states, after), demand


def tracking_gain(channel: Channel, slowness: float = 1.0) -> Array:
    """Gain L of one compensator, shape (order,); empty for a compensator without states.

    That of the stationary Kalman filter of x that measures u_a: A - L C is stable. Were u_a exact,
    this would be Hanus' conditioning, whose poles are the zeros of the compensator; a roll-off that
    is sampled by Tustin's rule has them at -1, and would oscillate undamped. `slowness`, from 1e-6
    to 1e6, multiplies the tracking time, in which an integrator of gain K loses its excess, 1/K:
    what is achieved counts as that many times more uncertain than the error.
    """
    sampled("channel", channel, 1, 1)
    check.number("slowness", slowness, *SLOWNESS)
    A, B, C, D = (np.asarray(part) for part in (channel.A, channel.B, channel.C, channel.D))
    if not len(A):
        return np.zeros(0)
    noise, both = D @ D.T + slowness**2, B @ D.T
    P = solve_discrete_are(A.T, C.T, B @ B.T, noise, s=both)
    return ((A @ P @ C.T + both) / (C @ P @ C.T + noise))[:, 0]


def tracking_gains(loops: Sequence[Channel], slowness: float = 1.0) -> Array:
    """Gains L of all compensators, block diagonal, shape (order, m)."""
    return block_diag(*(tracking_gain(channel, slowness)[:, None] for channel in loops))


def circle_margin(
    plant: SampledSystem, compensators: Sequence[Channel], *, anti_windup: bool
) -> float:
    """Margin of the circle criterion for limits of the demand; a positive one proves stability.

    Limits that are met with least error project the demand on a convex set. For any two demands,
    (u - w) . (u_a - w_a) >= |u_a - w_a|^2. With u = -H u_a around the loop it is therefore
    sufficient that I + H is strictly positive real: all responses to one reference then converge to
    each other (Khalil, Nonlinear Systems, 2002, section 7.1). If the direction is kept instead
    ("scaled"), the inequality holds for w = 0 alone, and with it stability about that point.

    Args:
        plant: Sampled and stable, from the major task achieved to the one measured, (m1, m1). It is
            assumed that displacements that leave the major task alone are not measured.
        compensators: One for each output.
        anti_windup: Whether the compensators observe what is achieved. Without, H has the poles of
            the integrators: responses stay bounded, but need not converge.

    Returns:
        Smallest eigenvalue of the Hermitian part of I + H over frequency.
    """
    import control  # late, as in ftc.control.compensator

    channels("compensators", compensators)
    sampled("plant", plant, len(compensators), len(compensators))
    stacked, M = Compensators(compensators), 0.0
    w = 2 * np.pi * np.geomspace(1e-2, 0.499 / plant.dt, 4000)
    if check.flag("anti_windup", anti_windup):  # what L takes off the demands per u - u_a
        M = frequency_response(
            control.ss(stacked.A, tracking_gains(compensators), stacked.C, 0, stacked.dt)
        )(w)
    one = np.eye(len(compensators))
    H = frequency_response(stacked)(w) @ frequency_response(plant)(w)
    around = np.linalg.solve(one + M, one + H)
    hermitian = (around + around.conj().swapaxes(1, 2)) / 2
    return float(np.linalg.eigvalsh(hermitian).min())
