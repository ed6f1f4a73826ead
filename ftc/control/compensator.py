"""Loop-shaping design of compensators of single channels at a common crossover.

G(s) = K / s * w^2 / (s^2 + 2 zeta w s + w^2): an integrator against slow errors, and a roll-off
that keeps the loop gain low at the plant's modes above the crossover. K is chosen so that
|G P| = 1 at the crossover.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy.linalg

import argument_checks as check
from argument_checks import Array
from ftc.control.frequency_response import ROUND_OFF, SampledSystem, balanced, sensitivity_peak

if TYPE_CHECKING:  # imported late: it takes a second, and running controllers need no design
    import control

_MODERATE = 1e-12, 1e6
"""Smallest and largest number in a loop shape [Hz] or [1]; `_SLOWEST` bounds the crossovers."""

LARGEST_PEAK = 1.7
"""Largest peak of the sensitivity: gain margin of at least 7.7 dB, phase margin of 34 degrees."""
_ROLL_OFF, _ROLL_OFF_DAMPING = 3.0, 0.7
"""Corner frequency of the low-pass in crossovers, as on the hexapod, and its damping ratio."""
_FASTEST, _SLOW, _SLOWEST = 1 / 50, 1e-5, 1e-8
"""Range of crossovers searched, times the control period: to the second, else to the last."""
_HALVINGS = 12
"""Bisections of the logarithmic range of crossovers: accuracy of 0.2 % or 0.5 %."""

_DECAYS = 1e-6
"""Decay rate, relative to the norm of the state matrix, above which a motion certainly decays, and
coupling below which a motion that does not decay drives no other."""
_NO_GAIN = 1e-4
"""Gain of a motion, relative to all inputs or outputs, below which it is uncontrollable or
unobservable."""

Channel = SampledSystem
"""Sampled compensator with one input and one output; `dt` is its period [s]."""


class UnstableLoop(ValueError):
    """Error raised if the loop of a channel would be unstable."""


class NoResponse(ValueError):
    """Error raised if a channel does not respond at the chosen crossover."""


@dataclass(frozen=True)
class LoopShape:
    """Gain crossover of one channel, and corner and damping ratio of its second-order low-pass.

    Each number lies between 1e-12 and 1e6.
    """

    crossover_hz: float
    roll_off_hz: float
    roll_off_damping: float

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            check.number(name, value, *_MODERATE)


@dataclass(frozen=True)
class Compensator:
    """Compensator of one channel as plain arrays, which can be pickled, unlike a StateSpace.

    Attributes:
        numerator: Numerator of G(s), highest power first; `denominator` in the same order.
        A: State matrix of the Tustin discretization, with `B`, `C`, `D`.
        period_s: Sampling period [s].
    """

    numerator: Array
    denominator: Array
    A: Array
    B: Array
    C: Array
    D: Array
    period_s: float

    @property
    def dt(self) -> float:
        """Sampling period [s] under the name that python-control uses."""
        return self.period_s

    @property
    def discrete(self) -> "control.StateSpace":
        """Sampled compensator as a python-control system."""
        import control  # late, as above

        return control.ss(self.A, self.B, self.C, self.D, self.period_s)


def compensator(plant: "control.StateSpace", shape: LoopShape, period_s: float) -> Compensator:
    """Design the compensator that gives one channel the chosen loop shape.

    The channel is continuous, with one input and one output; the crossover must be below half the
    sampling frequency.

    Raises:
        UnstableLoop: The sampled loop would be unstable.
        NoResponse: The plant's gain at the crossover is zero, infinite or not a number.
    """
    import control  # late, as above

    channel = check.instance("plant", plant, control.StateSpace)
    if not channel.issiso() or not channel.isctime():
        raise ValueError(
            f"plant must be continuous, with one input and output, got {check.short_repr(plant)}"
        )
    check.instance("shape", shape, LoopShape)
    if shape.crossover_hz >= 0.5 / check.number("period_s", period_s, *check.SECONDS):
        raise ValueError(
            f"shape must have a crossover below half the sampling frequency, {0.5 / period_s:g} Hz,"
            f" got crossover_hz = {shape.crossover_hz:g}"
        )
    w, zeta = 2 * np.pi * shape.roll_off_hz, shape.roll_off_damping
    crossover = 2 * np.pi * shape.crossover_hz
    unscaled = control.tf([w**2], [1, 2 * zeta * w, w**2, 0])
    response = abs(unscaled(1j * crossover) * plant(1j * crossover))
    if not 0 < response < w**2 / ROUND_OFF:
        raise NoResponse(f"plant must respond at {shape.crossover_hz:g} Hz, got gain {response:g}")
    G = unscaled * (1 / response)
    G_d = control.c2d(control.ss(G), period_s, "tustin", prewarp_frequency=crossover)
    sampled_plant = control.c2d(plant, period_s, method="zoh")
    if not check.is_moderate(sampled_plant.A):
        raise NoResponse(f"plant must move by less than {check.LARGEST:g} in a period, got more")
    L = sampled_plant * G_d
    if np.abs(control.feedback(L, 1).poles()).max() >= 1:
        raise UnstableLoop(
            f"crossover_hz must leave the loop stable, got {shape.crossover_hz:g} Hz: lower it"
        )
    return Compensator(G.num[0][0], G.den[0][0], G_d.A, G_d.B, G_d.C, G_d.D, period_s)


def compensators(
    plant: "control.StateSpace", period_s: float, crossover_hz: float | None = None
) -> tuple[Compensator, ...]:
    """Design the compensators of all channels of a continuous plant at a common crossover.

    Without `crossover_hz`, take the highest crossover with a sensitivity peak of at most
    `LARGEST_PEAK`, coupling of the channels included, up to a fiftieth of the sampling frequency.

    Raises:
        UnstableLoop: The loops would be unstable, or exceed the peak at every crossover.
        NoResponse: A channel does not respond at the given crossover.
    """
    if crossover_hz is not None:
        return _at(plant, period_s, check.number("crossover_hz", crossover_hz, check.SMALLEST))[0]
    if loops := _within_peak(plant, period_s, _FASTEST / period_s):
        return loops
    for low, high in ((_SLOW, _FASTEST), (_SLOWEST, _SLOW)):
        for _ in range(_HALVINGS):
            middle = np.sqrt(low * high)
            if candidate := _within_peak(plant, period_s, middle / period_s):
                loops, low = candidate, middle
            else:
                high = middle
        if loops:
            return loops
    raise UnstableLoop(
        f"no crossover from {_SLOWEST / period_s:.2g} Hz on leaves the loops stable with a "
        f"sensitivity peak of at most {LARGEST_PEAK:g}"
    )


def _within_peak(
    plant: "control.StateSpace", period_s: float, hz: float
) -> tuple[Compensator, ...] | None:
    """Return the design at this crossover, or None if it is unstable or its peak is too large."""
    try:
        loops, peak = _at(plant, period_s, hz)
    except (UnstableLoop, NoResponse):
        return None
    return loops if peak <= LARGEST_PEAK else None


def _at(
    plant: "control.StateSpace", period_s: float, hz: float
) -> tuple[tuple[Compensator, ...], float]:
    """Return the design at this crossover and its sensitivity peak."""
    import control  # late, as above

    shape = LoopShape(hz, _ROLL_OFF * hz, _ROLL_OFF_DAMPING)
    loops = tuple(compensator(plant[k, k], shape, period_s) for k in range(plant.noutputs))
    sampled = control.c2d(plant, period_s, method="zoh")
    L = sampled * control.append(*(loop.discrete for loop in loops))
    unity = control.ss([], [], [], np.eye(plant.noutputs), period_s)
    if np.abs(control.feedback(L, unity).poles()).max() >= 1:
        raise UnstableLoop(f"crossover_hz must leave the loops stable together, got {hz:.3g} Hz")
    return loops, sensitivity_peak(L)


def minimal(plant: "control.StateSpace") -> "control.StateSpace":
    """Return the plant without its undamped modes that are uncontrollable or unobservable.

    For example, a rod that spins between two ball joints is a pole at zero that no loop can or has
    to move. The modes that do not decay are split off (ordered Schur form and Sylvester equation:
    Bavely and Stewart, SIAM J. Numer. Anal. 16 (1979)); the staircase algorithm then removes their
    uncontrollable and unobservable parts (Rosenbrock 1970; Van Dooren, IEEE Trans. Automatic
    Control 26 (1981)). Modes that decay stay.
    """
    import control  # late, as above

    A, scale = balanced(plant.A)
    least = _DECAYS * float(np.linalg.norm(A, 2)) if len(A) else 0.0
    T, Z, count = scipy.linalg.schur(A, output="real", sort=lambda re, im: re > -least)
    if not count:
        return plant
    B, C = Z.T @ (plant.B / scale[:, None]), (plant.C * scale) @ Z
    slow, fast = T[:count, :count], T[count:, count:]
    X = scipy.linalg.solve_sylvester(slow, -fast, -T[:count, count:])
    B_slow, C_slow = B[:count] - X @ B[count:], C[:, :count]
    for _ in range(2):  # controllable part, then that of the dual system
        V = _controllable_basis(slow, B_slow, _NO_GAIN * float(np.abs(B).max(initial=0.0)), least)
        slow, B_slow, C_slow = (V.T @ slow @ V).T, (C_slow @ V).T, (V.T @ B_slow).T
        B, C = C.T, B.T
    outputs = np.hstack([C_slow, C[:, :count] @ X + C[:, count:]])
    inputs = np.vstack([B_slow, B[count:]])
    return control.ss(scipy.linalg.block_diag(slow, fast), inputs, outputs, plant.D)


def _controllable_basis(A: Array, B: Array, least_input: float, least_motion: float) -> Array:
    """Return an orthonormal basis of the controllable subspace of (A, B), shape (s, r)."""
    basis, new, least = np.zeros((len(A), 0)), B, least_input
    while new.shape[1]:
        for _ in range(2):  # a single projection leaves round-off
            new = new - basis @ (basis.T @ new)
        U, s, _ = np.linalg.svd(new, full_matrices=False)
        basis = np.hstack([basis, U[:, s > least]])
        new, least = A @ U[:, s > least], least_motion
    return basis
