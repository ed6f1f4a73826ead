"""Equality-constrained least squares without an SVD, where a cheap bound shows full ranks."""

import numpy as np
from scipy.linalg import lapack

from argument_checks import Array, Mask

ROUND_OFF = 1e-12
"""Fraction of the scale below which a triangle's singular values may be round-off."""


def well_conditioned_above(tolerance: float) -> float:
    """Fraction of the scale above which a singular value is clearly not zero.

    Below it the SVD decides, at the tolerance itself.
    """
    return max(2.0 * tolerance, ROUND_OFF)


def is_determined(p: int, n: int, k: int) -> bool:
    """Whether p > 0 equations and k > 0 rows of least squares can determine n unknowns."""
    return 0 < p <= n <= p + k and k > 0


def well_conditioned_inverse(A: Array, least: float) -> Array | None:
    """A^-1 of a square A, or None unless all its singular values are shown to exceed `least`."""
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
    """The x (n,) that minimizes |G x - c| subject to A x = b, by LAPACK's dgglse.

    Args:
        A: Shape (p, n).
        b: Shape (p,).
        G: Shape (k, n), best in Fortran's order; overwritten.
        c: Shape (k,); overwritten.
        least_A: What all singular values of A must exceed.
        least_G: What those of G on the null space of A must exceed.

    Returns:
        None unless the singular values are shown to exceed these bounds: x is then unique.
    """
    p, n = A.shape
    if not is_determined(p, n, len(G)):
        return None
    T, R, _, x, singular = lapack.dgglse(G, A, c, b, overwrite_a=True, overwrite_c=True)
    if singular or not _exceeds(R[:, n - p :], least_A):
        return None
    return x if _exceeds(T[: n - p, : n - p], least_G) else None


def _exceeds(triangle: Array, least: float) -> bool:
    """Whether the smallest singular value exceeds `least`: it is at least 1 / |triangle^-1|."""
    if not triangle.size:
        return True
    inverse, singular = lapack.dtrtri(triangle)
    return not singular and lapack.dlantr("f", inverse) * least < 1.0


def equality_constrained_batch(
    A: Array, b: Array, G: Array, c: Array, least_A: Array, least_G: Array
) -> tuple[Array, Mask]:
    """The x (n, B) of a batch of small problems, and which of them are well conditioned (B,).

    By Householder reflections, each one array operation over all problems, whose axis is therefore
    the last. Bounds as in :func:`equality_constrained`; the x of other problems is not to be used.

    Args:
        A: Shape (p, n, B), 0 < p <= n; overwritten, as are the next three.
        b: Shape (p, B).
        G: Shape (k, n, B), k >= n - p.
        c: Shape (k, B).
        least_A: Shape (B,) or one number for all.
        least_G: Likewise.
    """
    p, n = A.shape[:2]
    free = n - p
    with np.errstate(all="ignore"):  # singular problems come out ill-conditioned
        # A Q = [L 0]: the equations decide the first p coordinates of Q^T x.
        reflections = []
        for i in range(p):
            reflection = _reflection(A[i, i:])
            reflections.append(reflection)
            _apply(A[i + 1 :, i:].swapaxes(0, 1), reflection)
            _apply(G[:, i:].swapaxes(0, 1), reflection)
        y = _back_substituted(A[::-1, p - 1 :: -1], b[::-1])[::-1]
        c -= np.einsum("kib,ib->kb", G[:, :p], y)
        G = G[:, p:]
        for j in range(free):
            reflection = _reflection(G[j:, j])
            _apply(G[j:, j + 1 :], reflection)
            _apply(c[j:, None], reflection)
        x = np.concatenate([y, _back_substituted(G[:free], c[:free])])
        for i in reversed(range(p)):
            _apply(x[i:, None], reflections[i])
        well_conditioned = _inverse_norm(A[::-1, p - 1 :: -1]) * least_A < 1.0
        well_conditioned &= _inverse_norm(G[:free]) * least_G < 1.0
    return x, well_conditioned


def _reflection(x: Array) -> tuple[Array, Array]:
    """Vector v and factor beta of I - beta v v^T, which reflects x (q, B) to a multiple of e_1.

    x[0] is overwritten with that multiple.
    """
    v = x.copy()
    norm = np.sqrt(np.einsum("qb,qb->b", v, v))
    first = np.copysign(norm, v[0])
    v[0] += first
    x[0] = -first
    return v, 1.0 / (norm * np.abs(v[0]))


def _apply(M: Array, reflection: tuple[Array, Array]) -> None:
    """Reflect the columns of M (q, r, B) in place."""
    v, beta = reflection
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
