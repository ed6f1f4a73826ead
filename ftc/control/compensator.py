"""Compensators of single channels by loop shaping, and the stability margins of a loop.

G(s) = K / s * w^2 / (s^2 + 2 zeta w s + w^2): an integrator, so that the error falls with
frequency, and a roll-off, so that the plant's modes above the crossover do not close the loop. K
puts |G P| = 1 at the chosen crossover.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

import argument_checks as check
from argument_checks import Array
from argument_checks.ties import least
from ftc.control.frequency_response import (
    SampledSystem,
    frequency_response,
    response_of,
    sampled,
)

if TYPE_CHECKING:  # imported by what needs it: it takes a second, and controllers need no design
    import control

_SLOWEST, _SLOW, _FASTEST = 1e-7, 1e-4, 0.4999
"""Frequencies at which loops are looked at, in parts of the sampling frequency: few up to the
second, where there are no modes."""


_ROUND_OFF = 1e-13
"""Part of a response."""


_MODERATE = 1e-12, 1e6
"""Of crossovers; the slowest loops of :mod:`ftc.tracking` have 1e-8 of the control frequency."""


class UnstableLoop(ValueError):
    """The loop of a channel would be unstable."""


class NoResponse(ValueError):
    """A channel does not respond at the chosen crossover."""


@dataclass(frozen=True)
class LoopShape:
    """Specification of one channel's loop.

    Attributes:
        crossover_hz: Gain crossover.
        roll_off_hz: Corner of the second-order low-pass.
        roll_off_damping: Damping ratio of the low-pass.

    Raises:
        ValueError: Not numbers from 1e-12 to 1e6.
    """

    crossover_hz: float
    roll_off_hz: float
    roll_off_damping: float

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            check.within(name, value, *_MODERATE)


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


Channel = SampledSystem
"""A sampled compensator with one input and one output, `dt` its period."""


@dataclass(frozen=True)
class Margins:
    """Stability margins of one sampled loop.

    Attributes:
        crossover_hz: Gain crossover.
        gain_margin_db: At `phase_crossover_hz`.
        phase_margin_deg: At `crossover_hz`.
        phase_crossover_hz: Where the phase passes -180 degrees.
    """

    crossover_hz: float
    gain_margin_db: float
    phase_margin_deg: float
    phase_crossover_hz: float

    def __str__(self) -> str:
        return (
            f"crossover {self.crossover_hz:.2f} Hz, "
            f"gain margin {self.gain_margin_db:.1f} dB at {self.phase_crossover_hz:.1f} Hz, "
            f"phase margin {self.phase_margin_deg:.1f} deg"
        )


def compensator(plant: "control.StateSpace", shape: LoopShape, period_s: float) -> Compensator:
    """The compensator that gives one channel the chosen loop.

    Args:
        plant: The channel, continuous, one input and one output.
        shape: Crossover and roll-off.
        period_s: Sampling period.

    Raises:
        UnstableLoop: The sampled loop would be unstable.
        NoResponse: The plant's gain at the crossover is zero or no moderate number.
        ValueError, TypeError: Not one continuous channel, no shape, a period longer than a day, or
            a crossover that is not below half the sampling frequency.
    """
    import control  # late, as above

    channel = check.instance("plant", plant, control.StateSpace)
    if not channel.issiso() or not channel.isctime():
        raise ValueError(
            f"plant must be continuous, with one input and output, got {check.shown(plant)}"
        )
    check.instance("shape", shape, LoopShape)
    if shape.crossover_hz >= 0.5 / check.duration("period_s", period_s):
        raise ValueError(
            f"shape must have a crossover below half the sampling frequency, {0.5 / period_s:g} Hz,"
            f" got crossover_hz = {shape.crossover_hz:g}"
        )
    w, zeta = 2 * np.pi * shape.roll_off_hz, shape.roll_off_damping
    crossover = 2 * np.pi * shape.crossover_hz
    unscaled = control.tf([w**2], [1, 2 * zeta * w, w**2, 0])
    response = abs(unscaled(1j * crossover) * plant(1j * crossover))
    if not 0 < response < w**2 / _ROUND_OFF:
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


def margins(L: SampledSystem) -> Margins:
    """The margins of a sampled open loop with one input and one output.

    Of several crossovers those with the smallest margins. They are looked for from 1e-7 of the
    sampling frequency up to half of it; where there is none, the margin is infinite and the
    crossover NaN.

    Raises:
        ValueError, TypeError: Of another kind than that.
    """
    from scipy.optimize import brentq  # late: only the design needs it

    # On the frequency response: the polynomial method loses its digits on a dozen plant states.
    response = response_of(sampled("L", L, 1, 1))
    frequencies = _frequencies(L.dt, _FASTEST, 8000)
    curve = response(frequencies)[:, 0, 0]

    def at(frequency_rad_s: float) -> complex:
        return complex(response(np.array([frequency_rad_s]))[0, 0, 0])

    def crossings(of: Callable[[Any], Any]) -> Iterator[float]:
        for k in np.flatnonzero(np.diff(np.sign(of(curve)))):
            if abs(of(curve[k])) <= _ROUND_OFF * abs(curve[k]):  # it is there, whatever its sign
                yield float(frequencies[k])
                continue
            ends = frequencies[k : k + 2]
            # Of many frequencies at once the last bits are others than of one.
            if of(at(ends[0])) * of(at(ends[1])) <= 0.0:
                yield brentq(lambda w: of(at(w)), *ends)

    gains = [(1 / abs(at(w)), w) for w in crossings(np.imag) if at(w).real < 0]
    phases = [
        (float(np.angle(at(w), deg=True)) % 360 - 180, w) for w in crossings(lambda z: abs(z) - 1)
    ]
    gain, at_phase, phase, at_gain = np.inf, np.nan, np.inf, np.nan
    if gains:
        gain, at_phase = gains[least([abs(np.log(gain)) for gain, _ in gains])]
    if phases:
        phase, at_gain = phases[least([abs(phase) for phase, _ in phases])]
    return Margins(
        crossover_hz=at_gain / (2 * np.pi),
        gain_margin_db=20 * np.log10(gain),
        phase_margin_deg=float(phase),
        phase_crossover_hz=at_phase / (2 * np.pi),
    )


def sensitivity_peak(L: SampledSystem) -> float:
    """Peak over frequency of the sensitivity of all channels together, L a sampled open loop.

    S = (I + L)^-1, measured by the gain and phase that each channel may lose, all at once and
    independently of one another: an upper bound of the structured singular value of S, the less of
    its largest singular value and of the Perron root of its absolute values (Doyle, IEE Proc. D
    129 (1982); Skogestad and Postlethwaite, Multivariable Feedback Control, 2005, section 8.8). One
    channel that disturbs another without being disturbed by it endangers nothing, however much. The
    inverse is the distance of the loops from instability; a well-damped single loop has less
    than 2.

    Raises:
        ValueError, TypeError: Not a sampled system with as many inputs as outputs.
    """
    channels = len(np.atleast_1d(getattr(L, "D", 0.0)))
    sampled("L", L, channels, channels)
    response = frequency_response(L, _frequencies(L.dt, 0.45, 3000))
    S = np.linalg.inv(np.eye(len(response[0])) + response)
    largest = np.linalg.norm(S, 2, axis=(1, 2))
    perron = np.abs(np.linalg.eigvals(np.abs(S))).max(axis=1)
    return float(np.minimum(largest, perron).max())


def _frequencies(period_s: float, fastest: float, count: int) -> Array:
    """Up to a part of the sampling frequency, [rad]/[s], so many of them above the slow ones."""
    slow = np.geomspace(_SLOWEST, _SLOW, count // 16, endpoint=False)
    return 2 * np.pi / period_s * np.append(slow, np.geomspace(_SLOW, fastest, count))
