"""Least squares under linear equations, without an SVD where ranks are full beyond doubt."""

import numpy as np
from scipy.linalg import lapack

from argument_checks import Array, Mask

ROUND_OFF = 1e-12
"""Fraction of the scale below which a triangle's singular values may be round-off."""


def certain(tolerance: float) -> float:
    """Fraction of the scale that singular values must pass to be no zeros beyond doubt.

    Below it the SVD decides, at the tolerance itself.
    """
    return max(2.0 * tolerance, ROUND_OFF)


def can_be_decided(p: int, n: int, k: int) -> bool:
    """Whether p equations and k rows of least squares, some of each, can determine n unknowns."""
    return 0 < p <= n <= p + k and k > 0


def certain_inverse(A: Array, least: float) -> Array | None:
    """A^-1 of a square A, or None where its singular values do not all pass beyond doubt."""
    if not A.size:
        return np.zeros_like(A)
    factors, pivots, singular = lapack.dgetrf(A)
    if singular:
        return None
    inverse, _ = lapack.dgetri(factors, pivots, overwrite_lu=True)
    return inverse if lapack.dlange("f", inverse) * least < 1.0 else None


def equality_constrained(
    A: Array, b: Array, G: Array, c: Array, least_A: float, least_G: float
) -> Array | None:
    """The x that minimizes |G x - c| subject to A x = b, by LAPACK's dgglse.

    Args:
        A: Shape (p, n).
        b: Shape (p,).
        G: Shape (k, n), best in Fortran's order; it is used up.
        c: Shape (k,); it is used up.
        least_A: What the singular values of A must pass.
        least_G: What those of G on the null space of A must pass.

    Returns:
        Shape (n,), or None where it is in doubt that the rows of A are independent and that G
        decides all that they leave free.
    """
    p, n = A.shape
    if not can_be_decided(p, n, len(G)):
        return None
    T, R, _, x, singular = lapack.dgglse(G, A, c, b, overwrite_a=True, overwrite_c=True)
    if singular or not _passes(R[:, n - p :], least_A) or not _passes(T[: n - p, : n - p], least_G):
        return None
    return x


def _passes(triangle: Array, least: float) -> bool:
    """Whether the least singular value passes: it is at least 1 / |triangle^-1|."""
    if not triangle.size:
        return True
    inverse, singular = lapack.dtrtri(triangle)
    return not singular and lapack.dlantr("f", inverse) * least < 1.0


def equality_constrained_batch(
    A: Array, b: Array, G: Array, c: Array, least_A: Array, least_G: Array
) -> tuple[Array, Mask]:
    """The same for many small problems side by side, and which are beyond doubt.

    Householder reflections, each one array operation over all problems; hence their axis is the
    last. The arguments are used up.

    Args:
        A: Shape (p, n, B), 0 < p <= n.
        b: Shape (p, B).
        G: Shape (k, n, B), k >= n - p.
        c: Shape (k, B).
        least_A: As there, shape (B,) or one for all.
        least_G: Likewise.

    Returns:
        Shapes (n, B) and (B,).
    """
    p, n = A.shape[:2]
    free = n - p
    with np.errstate(all="ignore"):  # what is singular comes out in doubt
        # A Q = [L 0]: the first p coordinates of Q^T x are decided.
        turns = []
        for i in range(p):
            turn = _reflect(A[i, i:])
            turns.append(turn)
            _turn(A[i + 1 :, i:].swapaxes(0, 1), turn)
            _turn(G[:, i:].swapaxes(0, 1), turn)
        y = _back_substituted(A[::-1, p - 1 :: -1], b[::-1])[::-1]
        c -= np.einsum("kib,ib->kb", G[:, :p], y)
        G = G[:, p:]
        for j in range(free):
            turn = _reflect(G[j:, j])
            _turn(G[j:, j + 1 :], turn)
            _turn(c[j:, None], turn)
        x = np.concatenate([y, _back_substituted(G[:free], c[:free])])
        for i in reversed(range(p)):
            _turn(x[i:, None], turns[i])
        doubtless = _inverse_norm(A[::-1, p - 1 :: -1]) * least_A < 1.0
        doubtless &= _inverse_norm(G[:free]) * least_G < 1.0
    return x, doubtless


def _reflect(x: Array) -> tuple[Array, Array]:
    """The reflection I - beta v v^T that turns x (q, B) into a multiple of the first axis.

    That multiple is left in x[0].
    """
    v = x.copy()
    norm = np.sqrt(np.einsum("qb,qb->b", v, v))
    first = np.copysign(norm, v[0])
    v[0] += first
    x[0] = -first
    return v, 1.0 / (norm * np.abs(v[0]))


def _turn(M: Array, turn: tuple[Array, Array]) -> None:
    """Reflect the columns of M (q, r, B) in place."""
    v, beta = turn
    M -= v[:, None] * (beta * np.einsum("qb,qrb->rb", v, M))


def _back_substituted(R: Array, y: Array) -> Array:
    """R^-1 y of upper triangles R (q, q, B), y (q, B)."""
    x = np.empty_like(y)
    for i in reversed(range(len(y))):
        x[i] = (y[i] - np.einsum("jb,jb->b", R[i, i + 1 :], x[i + 1 :])) / R[i, i]
    return x


def _inverse_norm(R: Array) -> Array:
    """Frobenius norm of the inverses of upper triangles R (q, q, B), shape (B,)."""
    q = len(R)
    square = np.zeros(R.shape[2])
    for k in range(q):  # column k of the inverse has k + 1 entries
        unit = np.zeros((k + 1, R.shape[2]))
        unit[k] = 1.0
        column = _back_substituted(R[: k + 1, : k + 1], unit)
        square += np.einsum("ib,ib->b", column, column)
    return np.sqrt(square)
