"""The one rank decision of the library."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg.blas import dnrm2
from scipy.linalg.lapack import dgesdd

from argument_checks import Array, Indices, Mask, is_moderate

RANK_TOLERANCE = 1e-10
"""Singular values below this fraction of the scale of the inputs count as zero."""


NOTHING = 1e-200
"""Singular values below it are zero at any scale: products with their inverse overflow."""

ERROR_MARGIN = 2.0
"""Threshold per error of a singular value, which is of first order."""
ROUND_OFF = 1e-15
"""Part of the scale below which the size of a singular value means nothing."""


@dataclass(frozen=True, eq=False)
class RankedSvd:
    """A = U diag(sigma) V^T with its rank decided; leading axes are batch axes.

    Attributes:
        U: Left singular vectors, shape (..., m, min(m, n)), or (m, m) when full.
        sigma: Singular values, those that count first, descending, shape (..., min(m, n)).
        Vt: Right singular vectors as rows, shape (..., min(m, n), n), or (n, n) when full.
        threshold: What counts as zero, shape (..., min(m, n)), or (..., 1) for all alike.
        kept: Which singular values count, shape (..., min(m, n)).
        round_off: What is no more than round-off, shape (..., 1).
    """

    U: Array
    sigma: Array
    Vt: Array
    threshold: Array
    significant: Mask
    round_off: Array

    @property
    def rank(self) -> Indices:
        """Number of singular values that count, shape (...)."""
        return self.significant.sum(axis=-1)

    @property
    def gap(self) -> Array:
        """Factor by which the threshold could change, up or down, before the rank would, (...).

        At least 1, and infinite where no threshold would change it.
        """
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            ratio = self.sigma / self.threshold
            ratio = np.where(self.significant, ratio, 1.0 / ratio)
        return np.min(np.where(np.isnan(ratio), np.inf, ratio), axis=-1, initial=np.inf)

    @property
    def uncertainty(self) -> float:
        """Relative error that the least singular value that counts may have, of one matrix.

        At most 0.5, where another one would have counted as zero; 0 if none counts.
        """
        with np.errstate(divide="ignore"):
            ratio = self.threshold / (ERROR_MARGIN * self.sigma)
        return float(np.max(ratio, initial=0.0, where=self.significant))

    def pseudo_inverse(self, damping: float = 0.0) -> Array:
        """Moore-Penrose inverse on the decided rank, shape (..., n, m).

        Damping lambda turns 1 / sigma into sigma / (sigma^2 + lambda^2).
        """
        reciprocal = np.zeros_like(self.sigma)
        # Divided twice: sigma^2 of a tiny sigma would underflow.
        np.divide(1.0, self.sigma, out=reciprocal, where=self.significant)
        if damping:
            reciprocal /= 1.0 + (damping * reciprocal) ** 2
        k = self.sigma.shape[-1]
        V = np.swapaxes(self.Vt[..., :k, :], -1, -2)
        return (V * reciprocal[..., None, :]) @ np.swapaxes(self.U[..., :k], -1, -2)

    @property
    def null(self) -> Array:
        """Orthonormal basis of the null space of one A, (n, .); needs the full SVD."""
        return self.Vt[int(self.rank) :].T

    def null_projector(self) -> Array:
        """Orthogonal projector onto the null space of A, shape (..., n, n)."""
        Vt = self.Vt[..., : self.sigma.shape[-1], :]
        return (
            np.eye(Vt.shape[-1]) - (np.swapaxes(Vt, -1, -2) * self.significant[..., None, :]) @ Vt
        )


def norm(A: Array) -> float:
    """Frobenius norm of one matrix."""
    return dnrm2(A.ravel()) if A.size else 0.0


def frobenius(A: Array) -> Array:
    """Frobenius norm of each matrix, shape (...): an upper bound of the 2-norm without an SVD."""
    if A.ndim == 2:
        return np.asarray(norm(A))
    return np.sqrt(np.einsum("...ij,...ij->...", A, A))


def largest(A: Array) -> Array:
    """Largest singular value of each matrix, shape (...): the 2-norm; zero without elements."""
    if not A.size:
        return np.zeros(A.shape[:-2])
    return np.asarray(np.linalg.svd(A, compute_uv=False)[..., 0], dtype=float)


def basis_scale(basis: Array) -> Array:
    """Scale of products with a basis, whose columns have unit size: at least one, even if empty."""
    return np.maximum(1.0, frobenius(basis))


def whole_svd(A: Array, *, full: bool = True) -> tuple[Array, Array, Array]:
    """U, sigma and V^T of one finite matrix (m, n)."""
    if not A.size:
        return np.eye(len(A)), np.zeros(0), np.eye(A.shape[1])
    U, sigma, Vt, failed = dgesdd(A, full_matrices=full)  # numpy takes longer for small matrices
    if failed:
        raise np.linalg.LinAlgError("SVD did not converge")
    return U, sigma, Vt


def singular_values(A: Array) -> Array:
    """Of one finite matrix, descending."""
    return dgesdd(A, compute_uv=False)[1] if A.size else np.zeros(0)


def ranked_svd(
    A: Array,
    scale: Array | float,
    tolerance: float,
    *,
    full: bool = False,
    error: Array | None = None,
) -> RankedSvd:
    """Singular value decomposition with the rank decided against the scale of the inputs.

    `scale` is the norm of the matrices that A was made from, never of A itself: a product that
    cancels to round-off must count as zero. Where the entries of A have larger errors, a singular
    value is zero if these explain it: an error D changes sigma_k by u_k^T D v_k to first order, by
    no more than |u_k|^T |D| |v_k| (Stewart, Sun, "Matrix Perturbation Theory", 1990, th. IV.2.3).

    Args:
        A: Matrix or batch of matrices, shape (..., m, n).
        scale: Norm of the inputs, shape (...).
        tolerance: Fraction of `scale` below which a singular value is zero.
        full: Return square U and V.
        error: Bound of the error of each entry of A, shape (..., m, n); None is round-off alone.

    Raises:
        ValueError: A has a number that is not finite, because products of the inputs overflowed.
    """
    if not (is_moderate(A) or np.isfinite(A).all()):  # LAPACK may not return
        raise ValueError("J, weights and metrics must have finite products, got an overflow")
    if A.ndim == 2 and (A.size or full):
        U, sigma, Vt = whole_svd(A, full=full)
    elif A.size or full:
        U, sigma, Vt = np.linalg.svd(A, full_matrices=full)
    else:  # without elements LAPACK would be slow
        *lead, m, n = A.shape
        U, sigma, Vt = np.zeros((*lead, m, 0)), np.zeros((*lead, 0)), np.zeros((*lead, 0, n))
    sigma = np.abs(sigma)  # LAPACK may return -0.0, whose inverse would be a negative gap
    scale = np.asarray(scale)[..., None]
    threshold, round_off = np.maximum(tolerance * scale, NOTHING), ROUND_OFF * scale
    if error is None or not sigma.size:
        return RankedSvd(U, sigma, Vt, threshold, sigma > threshold, round_off)
    k = sigma.shape[-1]
    of_left = np.swapaxes(np.abs(U[..., :k]), -1, -2) @ error
    explained = ERROR_MARGIN * (of_left * np.abs(Vt[..., :k, :])).sum(axis=-1)
    threshold = np.maximum(threshold, explained)
    return _significant_first(RankedSvd(U, sigma, Vt, threshold, sigma > threshold, round_off))


def _significant_first(svd: RankedSvd) -> RankedSvd:
    """The same with the singular values that count before those that do not."""
    U, sigma, Vt, threshold, significant, round_off = vars(svd).values()
    if not (significant[..., 1:] & ~significant[..., :-1]).any():
        return svd
    order = np.argsort(~significant, axis=-1, kind="stable")  # noqa: TID251 - truth values
    k = sigma.shape[-1]
    U, Vt = np.array(U), np.array(Vt)
    U[..., :k] = np.take_along_axis(U[..., :k], order[..., None, :], axis=-1)
    Vt[..., :k, :] = np.take_along_axis(Vt[..., :k, :], order[..., :, None], axis=-2)
    sigma, threshold, significant = (
        np.take_along_axis(array, order, axis=-1) for array in (sigma, threshold, significant)
    )
    return RankedSvd(U, sigma, Vt, threshold, significant, round_off)
