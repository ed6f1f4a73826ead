"""Distances between linear models: which of them a diagnosis can distinguish, for any input.

:func:`output_distance` counts standard deviations of the sensors' noise, as
:func:`.isolability` does for one sequence of commands. :func:`nu_gap` lies
between 0 and 1 and says whether one feedback loop serves both models.
"""

from typing import TYPE_CHECKING

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

import argument_checks as check
from argument_checks import Array

if TYPE_CHECKING:
    import control

_ACCURACY = 1e-9  # of a peak, relative


def output_distance(
    first: "control.StateSpace", second: "control.StateSpace", noise: ArrayLike
) -> float:
    """Largest distance d of the outputs of two models, per root of the input's energy.

    d is in standard deviations of the noise; d^2 / 2 is the Kullback-Leibler divergence of the two
    explanations, and they are confused with probability Phi(-d / 2). For an input u from rest, d is
    at most the returned number times the root of the integral of |u|^2; a long sine of the worst
    frequency comes as near to this bound as one likes. It is the H-infinity norm of the whitened
    difference: the peak over w of sigma_max(diag(1 / noise) (G_1(jw) - G_2(jw))).

    Args:
        first: Continuous and stable, with m inputs and p outputs.
        second: Likewise.
        noise: Of each output: root of the white noise's density, shape (p,). With one
            sample each T seconds of standard deviation sigma it is sigma sqrt(T).

    Raises:
        ValueError, TypeError: Of another shape or kind than that.
    """
    _check_pair(first, second)
    sigma = check.all_positive("noise", noise, first.noutputs)
    for name, model in (("first", first), ("second", second)):
        if not _is_stable(model.A):
            raise ValueError(f"{name} must be stable, got poles {check.shown(model.poles())}")
    A = scipy.linalg.block_diag(first.A, second.A)
    B, C = np.vstack([first.B, second.B]), np.hstack([first.C, -second.C])
    W = 1 / sigma[:, None]
    return _peak_gain(A, B, W * C, W * (first.D - second.D))


def nu_gap(first: "control.StateSpace", second: "control.StateSpace") -> float:
    """Distance of two models in the nu-gap metric, 0 to 1.

    The peak over frequency of the chordal distance
    sigma_max((I + G_2 G_2*)^-1/2 (G_1 - G_2) (I + G_1* G_1)^-1/2), if the winding number of
    det(I + G_2* G_1) fits the unstable poles, else 1: Vinnicombe, IEEE Trans. Automatic Control 38
    (1993); Zhou and Doyle, Essentials of Robust Control (1998), section 17.2. The units of inputs
    and outputs matter: it compares models in a loop with gains of about one.

    Args:
        first: Continuous, with m inputs and p outputs; modes that do not decay are reached from the
            inputs and seen in the outputs.
        second: Likewise.

    Raises:
        ValueError, TypeError: Of another shape or kind than that.
    """
    _check_pair(first, second)
    A1, B1, C1, D1 = _normalized_factors("first", first.A, first.B, first.C, first.D)
    dual = _normalized_factors("second", second.A.T, second.C.T, second.B.T, second.D.T)
    A2, C2, B2, D2 = (part.T for part in dual)
    if not _winding_number_fits(first, second):
        return 1.0
    # [N2, M2] of the left factors times [M1; -N1] of the right ones, in series.
    m, p = first.ninputs, first.noutputs
    turn = np.block([[np.zeros((m, p)), np.eye(m)], [-np.eye(p), np.zeros((p, m))]])
    A = np.block([[A1, np.zeros((len(A1), len(A2)))], [B2 @ turn @ C1, A2]])
    B, C = np.vstack([B1, B2 @ turn @ D1]), np.hstack([D2 @ turn @ C1, C2])
    return min(_peak_gain(A, B, C, D2 @ turn @ D1), 1.0)


def _check_pair(first: "control.StateSpace", second: "control.StateSpace") -> None:
    import control  # late, as in ftc.compensator

    for name, model in (("first", first), ("second", second)):
        if not check.instance(name, model, control.StateSpace).isctime():
            raise ValueError(f"{name} must be continuous, got dt {check.shown(model.dt)}")
    if (first.noutputs, first.ninputs) != (second.noutputs, second.ninputs):
        raise ValueError(
            f"second must have as many inputs and outputs as first, {first.ninputs} and "
            f"{first.noutputs}, got {second.ninputs} and {second.noutputs}"
        )


def _is_stable(A: Array) -> bool:
    return bool((np.linalg.eigvals(A).real < 0).all())


def _normalized_factors(
    name: str, A: Array, B: Array, C: Array, D: Array
) -> tuple[Array, Array, Array, Array]:
    """State space of [N; M] with G = N M^-1, stable, and N* N + M* M = I on the axis."""
    weight = np.eye(B.shape[1]) + D.T @ D
    F = np.zeros((B.shape[1], len(A)))
    try:
        if len(A):
            X = scipy.linalg.solve_continuous_are(A, B, C.T @ C, weight, s=C.T @ D)
            F = -np.linalg.solve(weight, B.T @ X + D.T @ C)
        solved = _is_stable(A + B @ F)
    except np.linalg.LinAlgError:
        solved = False
    if not solved:
        raise ValueError(
            f"{name} must be reached by its inputs and seen by its outputs in all modes that do "
            f"not decay, got modes {check.shown(np.linalg.eigvals(A))}"
        )
    root = np.linalg.inv(np.linalg.cholesky(weight)).T
    return A + B @ F, B @ root, np.vstack([C + D @ F, F]), np.vstack([D, np.eye(len(D.T))]) @ root


def _winding_number_fits(first: "control.StateSpace", second: "control.StateSpace") -> bool:
    """Whether det(I + G_2* G_1) winds as often as the unstable poles ask for.

    Its zeros are the poles of the loop of G_1 and G_2*. With normalized coprime factors, the
    determinant of N_2* N_1 + M_2* M_1 has these zeros, and its unstable poles are as many as
    G_2 has states: it winds not at all if as many zeros lie in the right half plane.
    """
    A1, B1, C1, D1 = first.A, first.B, first.C, first.D
    A2, B2, C2, D2 = -second.A.T, -second.C.T, second.B.T, second.D.T
    shared = np.linalg.inv(np.eye(first.ninputs) + D2 @ D1)  # regular, or the gap is 1 at infinity
    u = -shared @ np.hstack([D2 @ C1, C2])
    y = np.hstack([C1, np.zeros((len(C1), len(A2)))]) + D1 @ u
    A = scipy.linalg.block_diag(A1, A2) + np.vstack([B1 @ u, B2 @ y])
    return int((np.linalg.eigvals(A).real > 0).sum()) == second.nstates


def _peak_gain(A: Array, B: Array, C: Array, D: Array) -> float:
    """Largest singular value of D + C (jw I - A)^-1 B over all frequencies w, A without axis poles.

    Bruinsma and Steinbuch, Systems and Control Letters 14 (1990): a level is crossed where a
    Hamiltonian matrix has imaginary eigenvalues; the next level is the best between crossings.
    """

    # python-control's `system_norm` fails with more outputs than inputs unless slycot is there.
    def gain(w: float) -> float:
        return float(np.linalg.norm(C @ np.linalg.solve(1j * w * np.eye(len(A)) - A, B) + D, 2))

    best = max([float(np.linalg.norm(D, 2)), *map(gain, [0.0, *np.abs(np.linalg.eigvals(A))])])
    while best > 0:
        level = best * (1 + _ACCURACY)
        R = np.linalg.inv(np.eye(D.shape[1]) - D.T @ D / level**2)
        upper = A + B @ R @ D.T @ C / level**2
        lower = C.T @ (np.eye(len(D)) + D @ R @ D.T / level**2) @ C / level
        hamiltonian = np.block([[upper, B @ R @ B.T / level], [-lower, -upper.T]])
        poles = np.linalg.eigvals(hamiltonian)
        near = np.abs(poles.real) <= 1e-6 * np.abs(poles)  # too many cost time only
        crossings = np.sort(np.abs(poles[near].imag))
        between = (crossings[1:] + crossings[:-1]) / 2
        higher = max(map(gain, [*crossings, *between]), default=0.0)
        if higher <= level:
            break
        best = higher
    return best
