"""Compensators of all channels of a loop, with anti-windup at limits.

At the limit of its own demand a compensator is held (conditional integration). Where limits of the
actuators reduce the demand u to an achieved u_a, the compensators use back-calculation in observer
form, x' = A x + B e + L (u_a - u) (both: Astrom and Hagglund, Advanced PID Control, 2006, section
3.5).
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
"""Smallest and largest admissible `slowness` of a tracking gain."""


class Compensators:
    """Compensators of m channels as one discrete system with m inputs and outputs."""

    def __init__(self, loops: Sequence[Channel]) -> None:
        """Stack the channels, which the caller has checked."""
        self.A, self.B, self.C, self.D = (
            block_diag(*(getattr(channel, part) for channel in loops)) for part in "ABCD"
        )
        self.order, self.dt = len(self.A), loops[0].dt
        self._channel = np.repeat(np.arange(len(loops)), [len(channel.A) for channel in loops])
        self._M = np.block([[self.A, self.B], [self.C, self.D]])

    def step(self, states: Array, errors: Array) -> tuple[Array, Array]:
        """Return the next states (..., order) and the demands (..., m) for errors (..., m)."""
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
        """Return the next states and the demands clipped to +-`most`.

        Where `holds` is true, a compensator at its limit keeps its states as long as its error
        would drive it further beyond the limit.
        """
        after, demanded = self.step(states, errors)
        demand = demanded.clip(-np.asarray(most), most)
        is_held = holds & (demand != demanded) & (errors * demanded > 0)
        return np.where(is_held[..., self._channel], states, after), demand


def tracking_gain(channel: Channel, slowness: float = 1.0) -> Array:
    """Return the back-calculation gain L of one compensator, shape (order,); empty without states.

    L is the gain of the stationary Kalman filter of x that measures u_a, so A - L C is stable. With
    an exact u_a this would be Hanus' conditioning, whose poles are the zeros of the compensator; a
    roll-off sampled by Tustin's rule has zeros at -1 and would oscillate undamped. `slowness`, from
    1e-6 to 1e6, multiplies the tracking time, in which an integrator of gain K loses its excess,
    1/K: the achieved demand counts as that many times more uncertain than the error.
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
    """Return the back-calculation gains L of all compensators, block diagonal (order, m)."""
    return block_diag(*(tracking_gain(channel, slowness)[:, None] for channel in loops))


def circle_margin(
    plant: SampledSystem, compensators: Sequence[Channel], *, anti_windup: bool
) -> float:
    """Return the margin of the circle criterion under demand limits; positive proves stability.

    Limits that are satisfied with least error project the demand onto a convex set. For any two
    demands, (u - w) . (u_a - w_a) >= |u_a - w_a|^2. With u = -H u_a around the loop it is therefore
    sufficient that I + H is strictly positive real: all responses to one reference then converge to
    each other (Khalil, Nonlinear Systems, 2002, section 7.1). If the demand is scaled instead
    ("scaled"), the inequality and stability hold about w = 0 only.

    Args:
        plant: Sampled stable plant from the achieved to the measured major task, (m1, m1).
            Displacements in the null space of the major task are assumed not to be measured.
        compensators: One compensator for each output.
        anti_windup: Whether the compensators use back-calculation. Without it, H has the poles of
            the integrators: responses stay bounded, but need not converge.

    Returns:
        Smallest eigenvalue of the Hermitian part of I + H over frequency.
    """
    import control  # late, as in ftc.control.compensator

    channels("compensators", compensators)
    sampled("plant", plant, len(compensators), len(compensators))
    stacked, M = Compensators(compensators), 0.0
    w = 2 * np.pi * np.geomspace(1e-2, 0.499 / plant.dt, 4000)
    if check.flag("anti_windup", anti_windup):  # reduction of the demands by L per u - u_a
        gains = tracking_gains(compensators)
        M = frequency_response(control.ss(stacked.A, gains, stacked.C, 0, stacked.dt))(w)
    one = np.eye(len(compensators))
    H = frequency_response(stacked)(w) @ frequency_response(plant)(w)
    around = np.linalg.solve(one + M, one + H)
    return float(np.linalg.eigvalsh((around + around.conj().swapaxes(1, 2)) / 2).min())
