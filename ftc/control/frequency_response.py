"""Frequency responses and stability margins of sampled systems."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import scipy.linalg

import argument_checks as check
from argument_checks import Array
from argument_checks.ties import least

_SLOWEST, _SLOW, _FASTEST = 1e-7, 1e-4, 0.4999
"""Frequency grid in fractions of the sampling frequency: coarse up to the second number, below all
modes."""

ROUND_OFF = 1e-13
"""Relative round-off of a frequency response."""


class SampledSystem(Protocol):
    """Discrete system x' = A x + B u, y = C x + D u, such as python-control's."""

    @property
    def A(self) -> Any:
        """State matrix, shape (s, s)."""

    @property
    def B(self) -> Any:
        """Input matrix, shape (s, m)."""

    @property
    def C(self) -> Any:
        """Output matrix, shape (p, s)."""

    @property
    def D(self) -> Any:
        """Feedthrough matrix, shape (p, m)."""

    @property
    def dt(self) -> Any:
        """Sampling period [s]."""


def sampled(name: str, system: SampledSystem, inputs: int, outputs: int) -> SampledSystem:
    """Check the numbers of inputs and outputs, the entries and the period of a sampled system."""
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
    """Check that a list holds `count` channels (None: any number) with a common period."""
    if not isinstance(loops, list | tuple) or len(loops) != (count or len(loops)):
        expected = "channels" if count is None else f"{count} channels, one for each major row"
        raise ValueError(f"{name} must be a list of {expected}, got {check.short_repr(loops)}")
    for loop in loops:
        if sampled(name, loop, 1, 1).dt != loops[0].dt:
            raise ValueError(f"{name} must have one period, got {loop.dt} and {loops[0].dt} s")
    return tuple(loops)


def balanced(A: Array) -> tuple[Array, Array]:
    """Balance a state matrix (s, s); return it and the units of its states, shape (s,)."""
    with np.errstate(invalid="ignore"):  # scipy also converts the units to integers
        A, (units, _) = scipy.linalg.matrix_balance(A, permute=False, separate=True)
    return A, units


def frequency_response(system: SampledSystem) -> Callable[[Array], Array]:
    """Return the function of w (F,) [rad/s] that evaluates C (z I - A)^-1 B + D, z = exp(i w dt).

    Its result is complex, shape (F, p, m). No frequency may be that of an undamped mode. It uses
    back-substitution in the Schur form (Laub, IEEE Trans. Automatic Control 26 (1981)), because
    unconstrained masses have double poles, for which eigenvectors fail.
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
    """Return the frequency grid [rad/s]: `count` points above `_SLOW` and a sixteenth below."""
    slow = np.geomspace(_SLOWEST, _SLOW, count // 16, endpoint=False)
    return 2 * np.pi / period_s * np.append(slow, np.geomspace(_SLOW, fastest, count))


@dataclass(frozen=True)
class Margins:
    """Stability margins of one sampled loop.

    Attributes:
        crossover_hz: Gain crossover.
        gain_margin_db: Gain margin at `phase_crossover_hz`.
        phase_margin_deg: Phase margin at `crossover_hz`.
        phase_crossover_hz: Frequency at which the phase passes -180 degrees.
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
    """Return the stability margins of a sampled open loop with one input and one output.

    Of several crossovers the one with the smallest margin counts. The search covers 1e-7 to 0.5 of
    the sampling frequency; without a crossover the margin is infinite and the frequency NaN.
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
            if abs(of(curve[k])) <= ROUND_OFF * abs(curve[k]):  # zero to within round-off
                yield float(frequencies[k])
                continue
            ends = frequencies[k : k + 2]
            # A batch and a single frequency differ in their last bits.
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
    """Return the peak over frequency of the sensitivity S = (I + L)^-1 of a sampled open loop L.

    Its inverse bounds the gain and phase that the channels may lose independently at the same time:
    it is an upper bound of the structured singular value of S, the smaller of its largest singular
    value and the Perron root of its absolute values (Doyle, IEE Proc. D 129 (1982); Skogestad and
    Postlethwaite, Multivariable Feedback Control, 2005, section 8.8), so one-way coupling does not
    count. A well-damped single loop has less than 2.
    """
    channels = len(np.atleast_1d(getattr(L, "D", 0.0)))
    sampled("L", L, channels, channels)
    response = frequency_response(L)(_frequencies(L.dt, 0.45, 3000))
    S = np.linalg.inv(np.eye(channels) + response)
    largest = np.linalg.norm(S, 2, axis=(1, 2))
    perron = np.abs(np.linalg.eigvals(np.abs(S))).max(axis=1)
    return float(np.minimum(largest, perron).max())
