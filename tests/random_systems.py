"""Random mechanisms of sampled ranks, and oracles without elimination.

Sizes and ranks are sampled integers, which shrink; entries come from a seed. Singular values that
are not zero by rank are between 0.5 and 2, so that 1e-8 separates them from zero.
"""

from dataclasses import dataclass

import numpy as np
from hypothesis import strategies as st

from prioritized import ConstrainedSystem

SEEDS = st.integers(0, 2**32 - 1)
ZERO = 1e-8


def bits(rng: np.random.Generator, A: np.ndarray) -> np.ndarray:
    """Perturb the last bits of numbers, as another processor might."""
    return A * (1 + 4e-16 * rng.integers(-3, 4, size=np.shape(A)))


def orthogonal(rng: np.random.Generator, size: int) -> np.ndarray:
    return np.linalg.qr(rng.normal(size=(size, size)))[0]


def of_rank(rng: np.random.Generator, rows: int, columns: int, rank: int) -> np.ndarray:
    """Return a matrix with `rank` singular values between 0.5 and 2, and no others."""
    U, V = orthogonal(rng, rows)[:, :rank], orthogonal(rng, columns)[:rank]
    return U * rng.uniform(0.5, 2.0, size=rank) @ V


@dataclass(frozen=True)
class RandomSystem:
    """Random system with the ranks that it was constructed from, and a generator for the test."""

    system: ConstrainedSystem
    reachable: int  # dimension of the task velocities that the actuators reach
    bound: int  # number of active rates that the loops constrain
    internal: int  # dimension of the internal forces
    self_motion: int  # dimension of the task motion with active joints fixed
    unobservable: int  # dimension of the passive motion without effect on the task
    rng: np.random.Generator


@st.composite
def systems(
    draw: st.DrawFn,
    *,
    actives: tuple[int, int] = (1, 4),
    tasks: tuple[int, int] = (1, 6),
    self_motion: bool = True,
) -> RandomSystem:
    """Sample redundant rows, self-motion, unobservable joints, tied actuators, lost directions."""
    n, m = draw(st.integers(*actives)), draw(st.integers(*tasks))
    fixed = draw(st.integers(0, 3))
    moved = draw(st.integers(0, min(m, 2))) if self_motion else 0
    unobservable = draw(st.integers(0, 1)) if self_motion else 0
    p = fixed + moved + unobservable
    bound, redundant = draw(st.integers(0, min(n, 2))), draw(st.integers(0, 2))
    lost = draw(st.integers(0, min(m, n - bound, 2)))
    rng = np.random.default_rng(draw(SEEDS))

    c = fixed + bound + redundant
    U, V = orthogonal(rng, c), orthogonal(rng, p)
    J_Cp = U[:, :fixed] * rng.uniform(0.5, 2.0, size=fixed) @ V[:, :fixed].T
    forbidden = of_rank(rng, bound, n, bound)
    J_Ca = U[:, :fixed] @ rng.normal(size=(fixed, n)) + U[:, fixed : fixed + bound] @ forbidden
    J_Tp = rng.normal(size=(m, fixed)) @ V[:, :fixed].T
    J_Tp += of_rank(rng, m, p - fixed, moved) @ V[:, fixed:].T
    Z = np.linalg.svd(forbidden)[2][bound:].T
    reachable = min(m, n - bound) - lost
    J = of_rank(rng, m, n - bound, reachable) @ Z.T + rng.normal(size=(m, bound)) @ forbidden
    J_Ta = J + J_Tp @ np.linalg.pinv(J_Cp, rcond=ZERO) @ J_Ca

    order = rng.permutation(n + p)
    J_T, J_C = np.empty((m, n + p)), np.empty((c, n + p))
    J_T[:, order], J_C[:, order] = np.hstack([J_Ta, J_Tp]), np.hstack([J_Ca, J_Cp])
    system = ConstrainedSystem(J_T, J_C, order[:n])
    return RandomSystem(system, reachable, bound, bound + redundant, moved, unobservable, rng)


@st.composite
def failures(draw: st.DrawFn, system: ConstrainedSystem) -> ConstrainedSystem:
    """Sample each actuator healthy, locked or free, and perhaps a stuck passive joint."""
    n, N = len(system.active), system.J_T.shape[1]
    codes = draw(st.lists(st.integers(0, 2), min_size=n, max_size=n))
    passive = sorted(set(range(N)) - set(system.active.tolist()))
    stuck = draw(st.sets(st.sampled_from(passive), max_size=1)) if passive else set()
    locked, free = ([k for k in range(n) if codes[k] == code] for code in (1, 2))
    return system.with_failures(locked, free, stuck)


@st.composite
def springs(draw: st.DrawFn, N: int, rng: np.random.Generator) -> np.ndarray:
    """Sample R of K = R^T R: springs on some joints, or between joints, of any rank."""
    if draw(st.booleans()):
        on = draw(st.lists(st.booleans(), min_size=N, max_size=N))
        return np.diag(rng.uniform(0.5, 2.0, size=N) * on)
    return of_rank(rng, N, N, draw(st.integers(0, N)))


def with_stiffness(system: ConstrainedSystem, K: np.ndarray) -> ConstrainedSystem:
    """Return the same mechanism with springs and the same failures."""
    known = system.failures
    made = ConstrainedSystem(system.J_T, system.J_C, system.active, stiffness=K)
    return made.with_failures(known.locked, known.free, known.locked_passive)


def rows_of(data: st.DataObject, m: int) -> list[int]:
    """Sample major rows, at least one."""
    return data.draw(st.lists(st.integers(0, m - 1), min_size=1, unique=True))


def major_and_secondary(data: st.DataObject, m: int) -> tuple[list[int], list[int]]:
    """Sample major rows, at least one; return also the others, in ascending order."""
    major = rows_of(data, m)
    return major, sorted(set(range(m)) - set(major))


@st.composite
def weights(draw: st.DrawFn, size: int, rng: np.random.Generator) -> np.ndarray | None:
    """Sample None, a diagonal with zeros in it, or a matrix of any height and rank."""
    kind = draw(st.sampled_from(["none", "diagonal", "matrix"]))
    if kind == "none":
        return None
    if kind == "diagonal":
        on = draw(st.lists(st.booleans(), min_size=size, max_size=size))
        return rng.uniform(0.5, 2.0, size=size) * on
    rows = draw(st.integers(1, size + 2))
    return of_rank(rng, rows, size, draw(st.integers(0, min(rows, size))))


def as_matrix(W: np.ndarray | None, size: int) -> np.ndarray:
    if W is None:
        return np.zeros((0, size))
    return np.diag(W) if W.ndim == 1 else W


@st.composite
def pairs(draw: st.DrawFn, n: int, *, infinite: bool = True) -> tuple[np.ndarray, np.ndarray]:
    """Sample limits of n actuators: around zero, one-sided, on zero, equal, off zero, infinite."""
    rng = np.random.default_rng(draw(SEEDS))
    lower, upper = -rng.uniform(0.5, 2.0, size=n), rng.uniform(0.5, 2.0, size=n)
    kinds = ["two-sided", "two-sided", "pull", "lock", "jam", "off zero"]
    kinds += ["no lower", "no limits"] if infinite else []
    for i, kind in enumerate(draw(st.lists(st.sampled_from(kinds), min_size=n, max_size=n))):
        if kind in ("pull", "lock"):
            lower[i] = 0.0
        if kind in ("lock", "jam"):
            upper[i] = lower[i]
        if kind == "off zero":
            lower[i] = 0.25
        if kind in ("no lower", "no limits"):
            lower[i] = -np.inf
        if kind == "no limits":
            upper[i] = np.inf
    return lower, upper
