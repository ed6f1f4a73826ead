"""Frequency responses of sampled systems, at all frequencies at once.

The state matrix is brought to triangular form once; a frequency then costs a back-substitution, as
in Laub, IEEE Trans. Automatic Control 26 (1981), with the Schur form in place of the Hessenberg
form. A solution of its own for each frequency takes twenty times as long. Eigenvectors would not
do, since masses that no spring holds have double poles.
"""

from collections.abc import Callable, Sequence
from typing import Any, Protocol

import numpy as np
import scipy.linalg

import argument_checks as check
from argument_checks import Array


class SampledSystem(Protocol):
    """x' = A x + B u, y = C x + D u from tick to tick; `dt` is the period, as in python-control."""

    @property
    def A(self) -> Any:
        """State matrix, shape (s, s)."""
        ...

    @property
    def B(self) -> Any:
        """Shape (s, m)."""
        ...

    @property
    def C(self) -> Any:
        """Shape (p, s)."""
        ...

    @property
    def D(self) -> Any:
        """Shape (p, m)."""
        ...

    @property
    def dt(self) -> Any:
        """Sampling period [s]."""
        ...


def sampled(name: str, system: SampledSystem, inputs: int, outputs: int) -> SampledSystem:
    """The system itself, which has so many inputs and outputs, finite numbers and a period.

    Raises:
        ValueError, TypeError: It has not.
    """
    check.attributes(name, system, "A", "B", "C", "D", "dt")
    s = len(check.batch(f"{name}.A", system.A))
    for part, shape in {"A": (s, s), "B": (s, inputs), "C": (outputs, s)}.items():
        check.exactly(f"{name}.{part}", getattr(system, part), *shape)
    check.exactly(f"{name}.D", system.D, outputs, inputs)
    check.duration(f"{name}.dt", system.dt)
    return system


def channels(
    name: str, loops: Sequence[SampledSystem], count: int | None = None
) -> tuple[SampledSystem, ...]:
    """So many channels, or any number, one after the other; all of one period.

    Raises:
        ValueError, TypeError: They are not.
    """
    if not isinstance(loops, list | tuple) or len(loops) != (count or len(loops)):
        expected = "channels" if count is None else f"{count} channels, one for each major row"
        raise ValueError(f"{name} must be a list of {expected}, got {check.shown(loops)}")
    for each in loops:
        if sampled(name, each, 1, 1).dt != loops[0].dt:
            raise ValueError(f"{name} must have one period, got {each.dt} and {loops[0].dt} s")
    return tuple(loops)


def balanced(A: Array) -> tuple[Array, Array]:
    """A state matrix (s, s) of states in units that make it even, and these units, shape (s,)."""
    with np.errstate(invalid="ignore"):  # scipy makes integers of them, which nobody asks for
        A, (units, _) = scipy.linalg.matrix_balance(A, permute=False, separate=True)
    return A, units


def frequency_response(system: SampledSystem, frequency_rad_s: Array) -> Array:
    """C (z I - A)^-1 B + D at z = exp(i w dt), complex, shape (F, p, m).

    Args:
        system: With s states, m inputs and p outputs.
        frequency_rad_s: Frequencies w, shape (F,), none of them that of an undamped mode.
    """
    return response_of(system)(frequency_rad_s)


def response_of(system: SampledSystem) -> Callable[[Array], Array]:
    """The same as a function of the frequencies, for whoever asks for some after others."""
    # A loop in series has states of very different sizes, which an orthogonal U alone would mix.
    A, scale = balanced(system.A)
    T, U = scipy.linalg.schur(A, output="complex")
    B, C = U.conj().T @ (system.B / scale[:, None]), (system.C * scale) @ U
    D, period_s = system.D, system.dt

    def at(frequency_rad_s: Array) -> Array:
        z = np.exp(1j * frequency_rad_s * period_s)
        states = np.empty((*B.shape, len(z)), dtype=complex)
        for k in reversed(range(len(T))):
            others = np.tensordot(T[k, k + 1 :], states[k + 1 :], axes=1)
            states[k] = (B[k, :, None] + others) / (z - T[k, k])
        return np.moveaxis(np.tensordot(C, states, axes=1), -1, 0) + D

    return at
