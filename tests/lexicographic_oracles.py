"""Oracles of bounded lexicographic least squares: simple, slow, and independent of the library.

Given levels (A_1, b_1), (A_2, b_2), ..., bounds lower <= x <= upper, and perhaps rows G with
lo <= G x <= hi: among the x within bounds and rows, minimize |A_1 x - b_1|; among the minimizers,
|A_2 x - b_2|; and so on; finally |x|. Bounds may be infinite or equal. The solution x and A_k x of
each level are unique, other quantities are not.

Ranks are decided at `RANK` relative to each level's own A: nearly singular problems must be well
above, singular ones at round-off. Bounds and x should be of size one, as tolerances are relative
to 1 + |x|.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

Levels = Sequence[tuple[np.ndarray, np.ndarray]]
Rows = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Inequality rows G (r, n), lo (r,), hi (r,)."""

RANK = 1e-11
FEASIBLE = 1e-11
"""Tolerance of limits and equations, relative to 1 + |x|, of a feasible candidate."""


def _norm(A: np.ndarray) -> float:
    return float(np.linalg.norm(A))


def _svd(A: np.ndarray, scale: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return U, sigma, V of singular values above RANK times the scale, and a null-space basis."""
    U, sigma, Vt = np.linalg.svd(A)
    rank = np.count_nonzero(sigma > RANK * scale)
    return U[:, :rank], sigma[:rank], Vt[:rank].T, Vt[rank:].T


def _solution(A: np.ndarray, b: np.ndarray, scale: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the least-norm least-squares solution of A x = b, and a null-space basis of A."""
    U, sigma, V, Z = _svd(A, scale)
    return V @ ((U.T @ b) / sigma), Z


def _minimizer(E: np.ndarray, e: np.ndarray, A: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the least-norm minimizer of |A x - b| with E x = e."""
    x, Z = _solution(E, e, scale=1.0)
    # Ranks are relative to A: where A Z is round-off, E determines A x.
    y, _ = _solution(A @ Z, b - A @ x, _norm(A))
    return x + Z @ y


class _Former:
    """Earlier levels as equations E x = e; each A is scaled to norm one."""

    def __init__(self, n: int) -> None:
        self.E, self.e = np.zeros((0, n)), np.zeros(0)

    def add(self, A: np.ndarray, x: np.ndarray) -> None:
        if size := _norm(A):
            self.E = np.vstack([self.E, A / size])
            self.e = np.append(self.e, A @ x / size)


def _with_least_norm(levels: Levels, n: int) -> list[tuple[np.ndarray, np.ndarray]]:
    return [*levels, (np.eye(n), np.zeros(n))]


def _constraints(lower: np.ndarray, upper: np.ndarray, rows: Rows | None) -> Rows:
    """Return bounds and rows as lo <= G x <= hi, with rows of norm one and without zero rows."""
    G, lo, hi = np.eye(len(lower)), np.asarray(lower, float), np.asarray(upper, float)
    if rows is not None:
        size = np.linalg.norm(rows[0], axis=1)
        retained = size > 0
        G = np.vstack([G, rows[0][retained] / size[retained, None]])
        lo = np.append(lo, rows[1][retained] / size[retained])
        hi = np.append(hi, rows[2][retained] / size[retained])
    return G, lo, hi


def _sides(G: np.ndarray, lo: np.ndarray, hi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return all finite limits as G x <= top."""
    G, top = np.vstack([G, -G]), np.append(hi, -lo)
    return G[np.isfinite(top)], top[np.isfinite(top)]


@dataclass(frozen=True)
class Known:
    """Solutions of B problems: x (B, n), gap of the ranks (zero if none was found), condition."""

    x: np.ndarray
    gap: np.ndarray
    condition: np.ndarray


class _Inverse:
    """Pseudo-inverses of matrices (P, k, n), with singular values up to `least` set to zero."""

    def __init__(self, A: np.ndarray, least: np.ndarray) -> None:
        self.U, sigma, self.Vt = np.linalg.svd(A, full_matrices=False)
        large = sigma > least[:, None]
        self.inverse = np.where(large, 1.0 / np.where(large, sigma, 1.0), 0.0)
        self.Vt = self.Vt * large[..., None]
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = sigma / least[:, None]
            gap = np.where(large, ratio, np.where(sigma > 0, 1 / ratio, np.inf))
        self.gap = gap.min(axis=1, initial=np.inf)
        self.condition = sigma.max(axis=1, initial=0.0) * self.inverse.max(axis=1, initial=0.0)

    def solve(self, b: np.ndarray) -> np.ndarray:
        return times(self.Vt.mT, self.inverse * times(self.U.mT, b))


def times(A: np.ndarray, x: np.ndarray) -> np.ndarray:
    return (A @ x[..., None])[..., 0]


def sizes(A: np.ndarray) -> np.ndarray:
    """Return the norm of each matrix, also if squares underflow."""
    most = abs(A).max(axis=(-2, -1), initial=0.0)
    return most * np.linalg.norm(A / np.where(most > 0, most, 1.0)[:, None, None], axis=(-2, -1))


def enumerated(levels: Levels, lower: np.ndarray, upper: np.ndarray) -> Known:
    """Solve B problems, levels (B, k, n) and (B, k), bounds (B, n), by enumerating active sets.

    Each active set leaves a least-squares problem in the free unknowns, with the earlier levels as
    equations E x = e. The optimum is the best solution within the bounds, as its own set is one.
    """
    count, n = lower.shape
    cases = np.array(list(itertools.product((-1, 0, 1), repeat=n)))
    low, high = lower[:, None], upper[:, None]
    possible = np.where(cases < 0, np.isfinite(low), np.where(cases > 0, np.isfinite(high), True))
    possible &= np.where(low == high, cases < 0, True)
    of, which = np.nonzero(possible.all(axis=2))
    active = cases[which]
    fixed = np.where(active < 0, lower[of], np.where(active > 0, upper[of], 0.0))
    free = active == 0
    E, e = np.zeros((count, 0, n)), np.zeros((count, 0))
    x, gap, condition = np.zeros((count, n)), np.full(count, np.inf), np.ones(count)
    for A, b in [*levels, (np.zeros((count, 0, n)), np.zeros((count, 0)))]:
        size = sizes(A) + (sizes(A) == 0)
        A, b = A / size[:, None, None], b / size[:, None]
        retained = _Inverse(A, np.full(count, RANK)).Vt
        A = A @ retained.mT @ retained  # else small terms determine large x
        earlier = _Inverse(E[of] * free[:, None], np.full(len(of), RANK))
        y = fixed + earlier.solve(e[of] - times(E[of], fixed))
        others = free[:, :, None] * np.eye(n) - earlier.Vt.mT @ earlier.Vt
        level = _Inverse(A[of] @ others, np.full(len(of), RANK))
        y = y + level.solve(b[of] - times(A[of], y))
        slack = FEASIBLE * (1 + np.linalg.norm(y, axis=1))
        retained = np.maximum(lower[of] - y, y - upper[of]).max(axis=1) <= slack
        retained &= np.abs(times(E[of], y) - e[of]).max(axis=1, initial=0.0) <= slack
        value = np.linalg.norm(times(A[of], y) - b[of] if len(b[0]) else y, axis=1)
        value[~retained] = np.inf
        best = np.full(count, np.inf)
        np.minimum.at(best, of, value)
        gap[np.isinf(best)] = 0.0
        # The first of the best sets is used.
        winner = np.nonzero(value <= best[of])[0]
        winner = winner[np.unique(of[winner], return_index=True)[1]]
        x = np.clip(y[winner], lower, upper)
        for each in (earlier, level):
            gap = np.minimum(gap, each.gap[winner])
            condition = np.maximum(condition, each.condition[winner])
        E, e = np.concatenate([E, A], axis=1), np.concatenate([e, times(A, x)], axis=1)
    return Known(x, gap, condition)


def by_active_sets(
    levels: Levels, lower: np.ndarray, upper: np.ndarray, rows: Rows | None = None
) -> np.ndarray:
    """Solve one problem, x (n,), by :func:`enumerated`; for n plus the number of rows up to 6.

    Rows are a first level G x = s of additional unknowns s, minimized in norm after x. The result
    is NaN if round-off leaves no solution within the bounds.
    """
    n = len(lower)
    if rows is not None:
        G, low, high = rows
        none = np.zeros((1, len(G)))
        wide = [(np.hstack([A, np.repeat(none, len(A), 0)]), b) for A, b in levels]
        sides = np.hstack([G, -np.eye(len(G))]), np.zeros(len(G))
        levels = [sides, *wide, (np.eye(n, n + len(G)), np.zeros(n))]
        lower, upper = np.append(lower, low), np.append(upper, high)
    made = [(np.asarray(A, float)[None], np.asarray(b, float)[None]) for A, b in levels]
    known = enumerated(made, np.array(lower, float)[None], np.array(upper, float)[None])
    return np.where(known.gap > 0.0, known.x[0, :n], np.nan)


def by_interior_point(
    levels: Levels, lower: np.ndarray, upper: np.ndarray, rows: Rows | None = None
) -> np.ndarray:
    """Solve one problem, x (n,), by a quadratic program per level: Clarabel, at 1e-12.

    The ratio of slack and multiplier at the solver's approximate point orders the limits. With the
    first 0, 1, 2, ... of them as equations, a level is a least-squares problem; the result is the
    solution that satisfies the conditions of an optimum best (:func:`_kkt`). A limit with a
    multiplier is active in every optimum, hence an equation of the later levels.

    Raises RuntimeError if Clarabel finds no solution.
    """
    G, top = _sides(*_constraints(lower, upper, rows))
    former, x = _Former(len(lower)), np.zeros(len(lower))
    for A, b in _with_least_norm(levels, len(lower)):
        if not A.any():
            continue  # every x is optimal
        near, order = _program(A, b, former, G, top)
        trials = []
        for k in range(len(order) + 1):
            E = np.vstack([former.E, G[order[:k]]])
            e = np.append(former.e, top[order[:k]])
            trials.append(near + _minimizer(E, e - E @ near, A, b - A @ near))
        x = min(trials, key=lambda x: _kkt(A, b, former, G, top, x)[0])
        binds = _kkt(A, b, former, G, top, x)[1] > 1e-9
        former.E = np.vstack([former.E, G[binds]])
        former.e = np.append(former.e, top[binds])
        former.add(A, x)
    return x


def _program(
    A: np.ndarray, b: np.ndarray, former: _Former, G: np.ndarray, top: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Minimize |A x - b| with E x = e and G x <= top; return x and active limits."""
    import clarabel
    from scipy.sparse import csc_array

    x, Z = _solution(former.E, former.e, scale=1.0)
    if not Z.shape[1]:
        return x, np.zeros(0, dtype=int)
    U, sigma, V, V0 = _svd(A @ Z, _norm(A))
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-12
    settings.tol_infeas_abs = settings.tol_infeas_rel = 1e-14  # 1e4 times the bounds proves nothing
    # Unknowns are t in x + Z (V diag(1 / s) t_1 + V_0 t_2), A Z = U diag(sigma) V^T. With s = sigma
    # the objective is well conditioned, with s = 1 the limits are.
    for s in (sigma, np.ones(len(sigma))):
        to_y, slope = np.hstack([V / s, V0]), np.append(sigma / s, np.zeros(V0.shape[1]))
        q = -slope * np.append(U.T @ (b - A @ x), np.zeros(V0.shape[1]))
        solver = clarabel.DefaultSolver(
            csc_array(np.diag(slope**2)),
            q,
            csc_array(G @ Z @ to_y),
            top - G @ x,
            [clarabel.NonnegativeConeT(len(top))],
            settings,
        )
        result = solver.solve()
        if str(result.status) in {"Solved", "AlmostSolved"}:
            ratio = np.array(result.s) / np.maximum(np.array(result.z), 1e-300)
            return x + Z @ to_y @ np.array(result.x), np.argsort(ratio)
    raise RuntimeError(f"Clarabel ended with {result.status}")


def _kkt(
    A: np.ndarray, b: np.ndarray, former: _Former, G: np.ndarray, top: np.ndarray, x: np.ndarray
) -> tuple[float, np.ndarray]:
    """Return the KKT residual of minimizing |A x - b| with E x = e and G x <= top, and multipliers.

    It is the largest of the violation of limits, the gradient that multipliers do not balance, and
    each multiplier times its slack.
    """
    unit, norm = 1 + _norm(x), _norm(A)
    size = norm * (norm * unit + _norm(b)) or 1.0
    distance = top - G @ x
    reached = distance <= 1e-8 * unit
    _, Z = _solution(former.E, former.e, scale=1.0)
    descent = -Z.T @ (A.T @ (A @ x - b)) / size
    multipliers, others = np.zeros(len(top)), float(_norm(descent))
    if reached.any() and len(descent):
        multipliers[reached], others = nnls(Z.T @ G[reached].T, descent)
    off = max(-distance.min(initial=0.0), np.abs(former.E @ x - former.e).max(initial=0.0))
    balance = np.abs(multipliers * distance).max(initial=0.0)
    return max(float(off / unit), float(others), float(balance / unit)), multipliers


def certificate(
    levels: Levels, lower: np.ndarray, upper: np.ndarray, x: np.ndarray, rows: Rows | None = None
) -> float:
    """Return the largest KKT residual of x (n,), level by level, then of |x|.

    Level k is convex with the earlier A_j x as equations: its gradient A^T (A x - b) combines rows
    A_j and, with multipliers of one sign, limits within 1e-8 of 1 + |x|. An error d along a
    singular value s adds s^2 d: small residuals prove values of levels, not the digits of x.
    """
    G, top = _sides(*_constraints(lower, upper, rows))
    former, worst = _Former(len(x)), 0.0
    for A, b in _with_least_norm(levels, len(x)):
        worst = max(worst, _kkt(A, b, former, G, top, x)[0])
        former.add(A, x)
    return worst
