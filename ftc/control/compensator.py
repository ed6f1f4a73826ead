"""Design of the compensators of single channels, all at one crossover, by loop shaping.

G(s) = K / s * w^2 / (s^2 + 2 zeta w s + w^2): an integrator, so that the error falls with
frequency, and a roll-off, so that the plant's modes above the crossover do not close the loop. K
puts |G P| = 1 at the chosen crossover.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy.linalg

import argument_checks as check
from argument_checks import Array
from ftc.control.frequency_response import ROUND_OFF, SampledSystem, balanced, sensitivity_peak

if TYPE_CHECKING:  # imported by what needs it: it takes a second, and controllers need no design
    import control

_MODERATE = 1e-12, 1e6
"""Of crossovers; the slowest that are tried are 1e-8 of the control frequency."""

LARGEST_PEAK = 1.7
"""Of the sensitivity: a gain margin of at least 7.7 dB, a phase margin of at least 34 degrees."""
_ROLL_OFF, _ROLL_OFF_DAMPING = 3.0, 0.7
"""Corner of the low-pass, in crossovers, as on the hexapod, and its damping ratio."""
_FASTEST, _SLOW, _SLOWEST = 1 / 50, 1e-5, 1e-8
"""Crossovers that are tried, times the control period: to the second, else to the last."""
_HALVINGS = 12
"""Of the logarithm of the range in which a crossover is sought: 0.2 % of it, or 0.5 %."""

_DECAYS = 1e-6
"""Part of the size of the state matrix by which a motion must decay to do so for certain, and below
which one motion that does not decay drives no other."""
_SEEN = 1e-4
"""Part of all inputs or outputs below which a motion is not excited, or not seen."""

Channel = SampledSystem
"""A sampled compensator with one input and one output, `dt` its period."""


class UnstableLoop(ValueError):
    """The loop of a channel would be unstable."""


class NoResponse(ValueError):
    """A channel does not respond at the chosen crossover."""


@dataclass(frozen=True)
class LoopShape:
    """One channel's gain crossover, and corner and damping ratio of its second-order low-pass.

    Numbers from 1e-12 to 1e6.
    """

    crossover_hz: float
    roll_off_hz: float
    roll_off_damping: float

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            check.number(name, value, *_MODERATE)


@dataclass(frozen=True)
class Compensator:
    """One channel's compensator as plain arrays: python-control's systems cannot be pickled.

    Attributes:
        numerator: Of G(s), highest power first; `denominator` alike.
        A: State matrix of the Tustin discretization; `B`, `C`, `D` alike.
        period_s: Sampling period.
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
        """The sampling period, by python-control's name for it."""
        return self.period_s

    @property
    def discrete(self) -> "control.StateSpace":
        """The sampled compensator."""
        import control  # late, as above

        return control.ss(self.A, self.B, self.C, self.D, self.period_s)


def compensator(plant: "control.StateSpace", shape: LoopShape, period_s: float) -> Compensator:
    """The compensator that gives one channel the chosen loop at a sampling period.

    The channel is continuous, with one input and one output; the crossover is below half the
    sampling frequency.

    Raises:
        UnstableLoop: The sampled loop would be unstable.
        NoResponse: The plant's gain at the crossover is zero or no moderate number.
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
        raise NoResponse(f"plant must respond at {shape.crossover_hz} Hz, got a gain of {response}")
    G = unscaled * (1 / response)
    G_d = control.c2d(control.ss(G), period_s, "tustin", prewarp_frequency=crossover)
    sampled_plant = control.c2d(plant, period_s, method="zoh")
    if not check.is_moderate(sampled_plant.A):
        raise NoResponse("plant must move by moderate numbers in a period, got more")
    L = sampled_plant * G_d
    if np.abs(control.feedback(L, 1).poles()).max() >= 1:
        raise UnstableLoop(
            f"shape must leave the loop stable, got a crossover of {shape.crossover_hz} Hz"
        )
    return Compensator(G.num[0][0], G.den[0][0], G_d.A, G_d.B, G_d.C, G_d.D, period_s)


def compensators(
    plant: "control.StateSpace", period_s: float, crossover_hz: float | None = None
) -> tuple[Compensator, ...]:
    """The compensators of all channels of a continuous plant at one crossover.

    Unless it is given, the crossover is the highest at which the sensitivity peak, coupling of the
    channels included, is at most `LARGEST_PEAK`, and at most a fiftieth of the sampling frequency.

    Raises:
        UnstableLoop: The loops would be unstable, or have a larger peak at every crossover.
        NoResponse: A channel has no moderate gain at the crossover that is given.
    """
    if crossover_hz is not None:
        return _at(plant, period_s, check.number("crossover_hz", crossover_hz, check.SMALLEST))[0]
    if found := _within_peak(plant, period_s, _FASTEST / period_s):
        return found
    for low, high in ((_SLOW, _FASTEST), (_SLOWEST, _SLOW)):
        for _ in range(_HALVINGS):
            middle = np.sqrt(low * high)
            if tried := _within_peak(plant, period_s, middle / period_s):
                found, low = tried, middle
            else:
                high = middle
        if found:
            return found
    raise UnstableLoop(
        f"no crossover from {_SLOWEST / period_s:.2g} Hz on leaves the loops stable with a "
        f"sensitivity peak of at most {LARGEST_PEAK:g}"
    )


def _within_peak(
    plant: "control.StateSpace", period_s: float, hz: float
) -> tuple[Compensator, ...] | None:
    """The design at this crossover; None where the peak is larger than allowed."""
    try:
        loops, peak = _at(plant, period_s, hz)
    except (UnstableLoop, NoResponse):
        return None
    return loops if peak <= LARGEST_PEAK else None


def _at(
    plant: "control.StateSpace", period_s: float, hz: float
) -> tuple[tuple[Compensator, ...], float]:
    """The design at this crossover, and the sensitivity peak that it leaves."""
    import control  # late, as above

    shape = LoopShape(hz, _ROLL_OFF * hz, _ROLL_OFF_DAMPING)
    loops = tuple(compensator(plant[k, k], shape, period_s) for k in range(plant.noutputs))
    sampled = control.c2d(plant, period_s, method="zoh")
    L = sampled * control.append(*(loop.discrete for loop in loops))
    unity = control.ss([], [], [], np.eye(plant.noutputs), period_s)
    if np.abs(control.feedback(L, unity).poles()).max() >= 1:
        raise UnstableLoop(f"shape must leave the loops stable together, got {hz:.3g} Hz")
    return loops, sensitivity_peak(L)


def minimal(plant: "control.StateSpace") -> "control.StateSpace":
    """A plant without those motions that do not decay and that no input excites or no output sees.

    A rod that spins between two ball joints is a pole at zero that no loop could move and none has
    to. The motions that do not decay are split off (ordered Schur form, Sylvester equation: Bavely
    and Stewart, SIAM J. Numer. Anal. 16 (1979)), and of these what no input excites and then what
    no output sees is taken out, by the staircase algorithm (Rosenbrock 1970; Van Dooren, IEEE
    Trans. Automatic Control 26 (1981)). Motions that decay stay, whether seen or not.
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
    for _ in range(2):  # what is excited, then of the dual what is seen
        V = _reached(slow, B_slow, _SEEN * float(np.abs(B).max(initial=0.0)), least)
        slow, B_slow, C_slow = (V.T @ slow @ V).T, (C_slow @ V).T, (V.T @ B_slow).T
        B, C = C.T, B.T
    outputs = np.hstack([C_slow, C[:, :count] @ X + C[:, count:]])
    inputs = np.vstack([B_slow, B[count:]])
    return control.ss(scipy.linalg.block_diag(slow, fast), inputs, outputs, plant.D)


def _reached(A: Array, B: Array, least_input: float, least_motion: float) -> Array:
    """Orthonormal basis of what B drives through A, shape (s, r)."""
    found, new, least = np.zeros((len(A), 0)), B, least_input
    while new.shape[1]:
        for _ in range(2):  # once leaves round-off of what is taken off
            new = new - found @ (found.T @ new)
        U, s, _ = np.linalg.svd(new, full_matrices=False)
        found = np.hstack([found, U[:, s > least]])
        new, least = A @ U[:, s > least], least_motion
    return found
