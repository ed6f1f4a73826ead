"""Frequency responses of sampled systems, at all frequencies at once.

The state matrix is brought to triangular form once; a frequency then costs a back-substitution, as
in Laub, IEEE Trans. Automatic Control 26 (1981), with the Schur form in place of the Hessenberg
form. A solution of its own for each frequency takes twenty times as long. Eigenvectors would not
do, since masses that no spring holds have double poles.
"""

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
import scipy.linalg

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
    (A, (scale, _)) = scipy.linalg.matrix_balance(system.A, permute=False, separate=True)
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
