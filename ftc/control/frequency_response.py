"""Frequency responses of sampled systems, and the margins of the loops that they close."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import scipy.linalg

import argument_checks as check
from argument_checks import Array
from argument_checks.ties import least

_SLOWEST, _SLOW, _FASTEST = 1e-7, 1e-4, 0.4999
"""Frequencies at which loops are looked at, in parts of the sampling frequency: few up to the
second, where there are no modes."""

ROUND_OFF = 1e-13
"""Part of a response."""


class SampledSystem(Protocol):
    """x' = A x + B u, y = C x + D u from tick to tick, as python-control's discrete systems."""

    @property
    def A(self) -> Any:
        """Shape (s, s)."""

    @property
    def B(self) -> Any:
        """Shape (s, m)."""

    @property
    def C(self) -> Any:
        """Shape (p, s)."""

    @property
    def D(self) -> Any:
        """Shape (p, m)."""

    @property
    def dt(self) -> Any:
        """Sampling period [s]."""


def sampled(name: str, system: SampledSystem, inputs: int, outputs: int) -> SampledSystem:
    """Check that a system has so many inputs and outputs, finite numbers and a period."""
    check.attributes(name, system, "A", "B", "C", "D", "dt")
    s = len(check.array(f"{name}.A", system.A, ..., None, None))
    shapes = {"A": (s, s), "B": (s, inputs), "C": (outputs, s), "D": (outputs, inputs)}
    for part, shape in shapes.items():
        check.array(f"{name}.{part}", getattr(system, part), *shape)
    check.number(f"{name}.dt", system.dt, *check.SECONDS)
    return system


def channels(
    name: str, loops: Sequence[SampledSystem], count: int | None = None
) -> tuple[SampledSystem, ...]:
    """Check channels, so many unless `count` is None, that all have one period."""
    if not isinstance(loops, list | tuple) or len(loops) != (count or len(loops)):
        expected = "channels" if count is None else f"{count} channels, one for each major row"
        raise ValueError(f"{name} must be a list of {expected}, got {check.short_repr(loops)}")
    for each in loops:
        if sampled(name, each, 1, 1).dt != loops[0].dt:
            raise ValueError(f"{name} must have one period, got {each.dt} and {loops[0].dt} s")
    return tuple(loops)


def balanced(A: Array) -> tuple[Array, Array]:
    """A state matrix (s, s) of states in units that make it even, and these units, shape (s,)."""
    with np.errstate(invalid="ignore"):  # scipy makes integers of them, which nobody asks for
        A, (units, _) = scipy.linalg.matrix_balance(A, permute=False, separate=True)
    return A, units


def frequency_response(system: SampledSystem) -> Callable[[Array], Array]:
    """The function of frequencies w (F,) [rad/s] that is C (z I - A)^-1 B + D at z = exp(i w dt).

    Complex, shape (F, p, m). None of the frequencies may be that of an undamped mode. By
    back-substitution after Laub, IEEE Trans. Automatic Control 26 (1981), in the Schur form:
    eigenvectors would not do, since masses that no spring holds have double poles.
    """
    # A loop in series has states of very different sizes, which an orthogonal U alone would mix.
    A, scale = balanced(system.A)
    T, U = scipy.linalg.schur(A, output="complex")
    B, C = U.conj().T @ (system.B / scale[:, None]), (system.C * scale) @ U

    def at(frequency_rad_s: Array) -> Array:
        z = np.exp(1j * frequency_rad_s * system.dt)
        states = np.empty((*B.shape, len(z)), dtype=complex)
        for k in reversed(range(len(T))):
            others = np.tensordot(T[k, k + 1 :], states[k + 1 :], axes=1)
            states[k] = (B[k, :, None] + others) / (z - T[k, k])
        return np.moveaxis(np.tensordot(C, states, axes=1), -1, 0) + system.D

    return at


def _frequencies(period_s: float, fastest: float, count: int) -> Array:
    """Up to a part of the sampling frequency, [rad]/[s], so many of them above the slow ones."""
    slow = np.geomspace(_SLOWEST, _SLOW, count // 16, endpoint=False)
    return 2 * np.pi / period_s * np.append(slow, np.geomspace(_SLOW, fastest, count))


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


def margins(L: SampledSystem) -> Margins:
    """The margins of a sampled open loop with one input and one output.

    Of several crossovers those with the smallest margins. They are looked for from 1e-7 of the
    sampling frequency up to half of it; where there is none, the margin is infinite and the
    crossover NaN.
    """
    from scipy.optimize import brentq  # late: only the design needs it

    # python-control's margins lose their digits on a dozen states, by polynomials, or six of them,
    # by splines.
    response = frequency_response(sampled("L", L, 1, 1))
    frequencies = _frequencies(L.dt, _FASTEST, 8000)
    curve = response(frequencies)[:, 0, 0]

    def at(frequency_rad_s: float) -> complex:
        return complex(response(np.array([frequency_rad_s]))[0, 0, 0])

    def crossings(of: Callable[[Any], Any]) -> Iterator[float]:
        for k in np.flatnonzero(np.diff(np.sign(of(curve)))):
            if abs(of(curve[k])) <= ROUND_OFF * abs(curve[k]):  # it is there, whatever its sign
                yield float(frequencies[k])
                continue
            ends = frequencies[k : k + 2]
            # Of many frequencies at once the last bits are others than of one.
            if of(at(ends[0])) * of(at(ends[1])) <= 0.0:
                yield brentq(lambda w: of(at(w)), *ends)

    turned, crossed = crossings(np.imag), crossings(lambda z: abs(z) - 1)
    gains = [(1 / abs(at(w)), w) for w in turned if at(w).real < 0] or [(np.inf, np.nan)]
    phases = [(float(np.angle(at(w), deg=True)) % 360 - 180, w) for w in crossed]
    phases = phases or [(np.inf, np.nan)]
    gain, at_phase = gains[least([abs(np.log(gain)) for gain, _ in gains])]
    phase, at_gain = phases[least([abs(phase) for phase, _ in phases])]
    hz = 1 / (2 * np.pi)
    return Margins(at_gain * hz, 20 * np.log10(gain), float(phase), at_phase * hz)


def sensitivity_peak(L: SampledSystem) -> float:
    """Peak over frequency of the sensitivity S = (I + L)^-1 of all channels, L a sampled open loop.

    Measured by the gain and phase that each channel may lose, all at once and independently: an
    upper bound of the structured singular value of S, the less of its largest singular value and of
    the Perron root of its absolute values (Doyle, IEE Proc. D 129 (1982); Skogestad and
    Postlethwaite, Multivariable Feedback Control, 2005, section 8.8). One channel that disturbs
    another without being disturbed by it endangers nothing. The inverse is the distance of the
    loops from instability; a well-damped single loop has less than 2.
    """
    channels = len(np.atleast_1d(getattr(L, "D", 0.0)))
    sampled("L", L, channels, channels)
    response = frequency_response(L)(_frequencies(L.dt, 0.45, 3000))
    S = np.linalg.inv(np.eye(channels) + response)
    largest = np.linalg.norm(S, 2, axis=(1, 2))
    perron = np.abs(np.linalg.eigvals(np.abs(S))).max(axis=1)
    return float(np.minimum(largest, perron).max())
