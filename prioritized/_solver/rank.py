"""Rank decision of the whole library: SVD with a threshold relative to the inputs' scale."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg.blas import dnrm2
from scipy.linalg.lapack import dgesdd

from argument_checks import Array, Indices, Mask, is_moderate

RANK_TOLERANCE = 1e-10
"""Fraction of the scale of the inputs below which a singular value counts as zero."""


NOTHING = 1e-200
"""Magnitude below which a singular value counts as zero, since its inverse could overflow."""

ERROR_MARGIN = 2.0
"""Factor from the first-order error of a singular value to the threshold."""
ROUND_OFF = 1e-15
"""Relative round-off: smaller fractions of the scale contain no information."""


@dataclass(frozen=True, eq=False)
class RankedSvd:
    """Singular value decomposition A = U diag(sigma) V^T with a rank decision; batch axes lead.

    Attributes:
        U: Left singular vectors, shape (..., m, min(m, n)), or (m, m) when full.
        sigma: Singular values, significant ones first, descending, shape (..., min(m, n)).
        Vt: Right singular vectors as rows, shape (..., min(m, n), n), or (n, n) when full.
        threshold: Value up to which a singular value is zero, shape (..., min(m, n)), or (..., 1)
            for one common threshold.
        significant: Mask of singular values above the threshold, shape (..., min(m, n)).
        round_off: Bound on the singular values of pure round-off, shape (..., 1).
    """

    U: Array
    sigma: Array
    Vt: Array
    threshold: Array
    significant: Mask
    round_off: Array

    @property
    def rank(self) -> Indices:
        """Number of significant singular values, shape (...)."""
        return self.significant.sum(axis=-1)

    @property
    def gap(self) -> Array:
        """Factor by which the threshold could change, up or down, without changing the rank, (...).

        At least 1; infinite if no threshold would change the rank.
        """
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            ratio = self.sigma / self.threshold
            ratio = np.where(self.significant, ratio, 1.0 / ratio)
        return np.min(np.where(np.isnan(ratio), np.inf, ratio), axis=-1, initial=np.inf)

    @property
    def uncertainty(self) -> float:
        """Relative error that the least significant singular value of one matrix may have.

        At most 0.5, because with a larger one the value counts as zero; 0 if the rank is zero.
        """
        with np.errstate(divide="ignore"):
            ratio = self.threshold / (ERROR_MARGIN * self.sigma)
        return float(np.max(ratio, initial=0.0, where=self.significant))

    def pseudo_inverse(self, damping: float = 0.0) -> Array:
        """Return the Moore-Penrose inverse on the decided rank, shape (..., n, m).

        Damping lambda replaces 1 / sigma by sigma / (sigma^2 + lambda^2).
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
        """Orthonormal basis of the null space of one matrix A, (n, .); requires the full SVD."""
        return self.Vt[int(self.rank) :].T

    def null_projector(self) -> Array:
        """Return the orthogonal projector onto the null space of A, shape (..., n, n)."""
        Vt = self.Vt[..., : self.sigma.shape[-1], :]
        V = np.swapaxes(Vt, -1, -2) * self.significant[..., None, :]
        return np.eye(Vt.shape[-1]) - V @ Vt


def norm(A: Array) -> float:
    """Return the Frobenius norm of one matrix."""
    return dnrm2(A.ravel()) if A.size else 0.0


def frobenius(A: Array) -> Array:
    """Return the Frobenius norm of each matrix, (...): an upper bound of the 2-norm without SVD."""
    if A.ndim == 2:
        return np.asarray(norm(A))
    return np.sqrt(np.einsum("...ij,...ij->...", A, A))


def largest(A: Array) -> Array:
    """Return the 2-norm (largest singular value) of each matrix, (...); zero without elements."""
    if not A.size:
        return np.zeros(A.shape[:-2])
    return np.asarray(np.linalg.svd(A, compute_uv=False)[..., 0], dtype=float)


def basis_scale(basis: Array) -> Array:
    """Return the scale of products with an orthonormal basis: its norm, but at least 1."""
    return np.maximum(1.0, frobenius(basis))


def whole_svd(A: Array, *, full: bool = True) -> tuple[Array, Array, Array]:
    """Return U, sigma and V^T of one finite matrix (m, n)."""
    if not A.size:
        return np.eye(len(A)), np.zeros(0), np.eye(A.shape[1])
    U, sigma, Vt, failed = dgesdd(A, full_matrices=full)  # numpy takes longer for small matrices
    if failed:
        raise np.linalg.LinAlgError("the singular value decomposition did not converge")
    return U, sigma, Vt


def singular_values(A: Array) -> Array:
    """Return the singular values of one finite matrix, descending."""
    return dgesdd(A, compute_uv=False)[1] if A.size else np.zeros(0)


def ranked_svd(
    A: Array,
    scale: Array | float,
    tolerance: float,
    *,
    full: bool = False,
    error: Array | None = None,
) -> RankedSvd:
    """Return the singular value decomposition with the rank decided at the scale of the inputs.

    `scale` is the norm of the matrices that A was computed from, never of A itself: a product that
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
        ValueError: A is not finite, because products of the inputs overflowed.
    """
    if not (is_moderate(A) or np.isfinite(A).all()):  # LAPACK may not return
        raise ValueError("J, weights and metrics must be smaller, got products that overflow")
    if A.ndim == 2 and (A.size or full):
        U, sigma, Vt = whole_svd(A, full=full)
    elif A.size or full:
        U, sigma, Vt = np.linalg.svd(A, full_matrices=full)
    else:  # LAPACK is slow without elements
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
    """Return the decomposition with significant singular values sorted before all others."""
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
