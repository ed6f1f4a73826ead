"""Random problems of bounded lexicographic least squares."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from hypothesis import strategies as st

from tests.lexicographic_oracles import Rows


@dataclass(frozen=True)
class Problem:
    """Levels, bounds, and rows or None."""

    levels: tuple[tuple[np.ndarray, np.ndarray], ...]
    lower: np.ndarray
    upper: np.ndarray
    rows: Rows | None = None


KINDS = ("any rank", "redundant rows", "dependent levels", "nearly singular", "zero")


def random_problem(
    rng: np.random.Generator,
    n: int,
    kinds: Sequence[str] = ("any rank", "any rank"),
    bounds: str = "mixed",
    extent: float = 1.0,
    rows: int = 0,
) -> Problem:
    """Return a feasible problem in n unknowns with one level of each kind.

    Args:
        rng: Random generator.
        n: Number of unknowns.
        kinds: Kind of each level, from `KINDS`. "any rank" has singular values from 0.5 to 2 and
            zeros; "nearly singular" has one of 1e-4; "redundant rows" repeats combinations of rows;
            "dependent levels" repeats combinations of earlier rows, in part; "zero" is A = 0.
        bounds: "mixed": finite, infinite on one side or both, equal; "finite" or "none".
        extent: Distance of targets relative to the bounds: below 1, each level is attainable alone;
            above, limits restrict most levels, and every other b is unattainable.
        rows: Number of rows G, which a point within the bounds satisfies.
    """
    lower, upper = -rng.uniform(0.1, 1.0, n), rng.uniform(0.1, 1.0, n)
    if bounds != "finite":
        chance = rng.random(n) if bounds == "mixed" else np.full(n, 0.3)
        lower[(chance > 0.2) & (chance < 0.5)] = -np.inf
        upper[(chance > 0.2) & (chance < 0.35)] = np.inf
        upper[(chance > 0.5) & (chance < 0.6)] = np.inf
        same = chance > 0.92
        lower[same] = upper[same]
    inside = np.clip(rng.uniform(-0.1, 0.1, n), lower, upper)
    levels: list[tuple[np.ndarray, np.ndarray]] = []
    for kind in kinds:
        A = _level(rng, kind, n, [A for A, _ in levels])
        goal = extent * (rng.uniform(-1, 1, n) if extent < 1 else rng.normal(size=n))
        b = A @ (np.clip(goal, lower, upper) if extent < 1 else goal)
        if extent >= 1:
            b = b + extent * rng.normal(size=len(b)) * rng.integers(0, 2)  # infeasible or feasible
        levels.append((A, b))
    if not rows:
        return Problem(tuple(levels), lower, upper)
    G = rng.normal(size=(rows, n))
    margin = rng.uniform(0.05, 0.5, (2, rows))
    margin[0, rng.random(rows) < 0.3] = np.inf
    return Problem(tuple(levels), lower, upper, (G, G @ inside - margin[0], G @ inside + margin[1]))


@st.composite
def problems(draw: st.DrawFn, most: int = 6) -> Problem:
    """Sample any :func:`random_problem`; n plus the number of rows is at most `most`."""
    n = draw(st.integers(1, most))
    kinds = draw(st.lists(st.sampled_from(KINDS), min_size=1, max_size=3))
    bounds = draw(st.sampled_from(["finite", "none", "mixed"]))
    extent = draw(st.sampled_from([0.3, 0.9, 3.0, 100.0]))
    rows = draw(st.integers(0, min(2, most - n)))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    return random_problem(rng, n, kinds, bounds, extent, rows)


def _level(rng: np.random.Generator, kind: str, n: int, earlier: list[np.ndarray]) -> np.ndarray:
    m = int(rng.integers(1, n + 2))
    if kind == "zero":
        return np.zeros((m, n))
    rank = int(rng.integers(1, min(m, n) + 1))
    sigma = rng.uniform(0.5, 2.0, rank)
    if kind == "nearly singular":
        sigma[-1] = 1e-4
    U = np.linalg.qr(rng.normal(size=(m, m)))[0][:, :rank]
    V = np.linalg.qr(rng.normal(size=(n, n)))[0][:rank]
    A = U * sigma @ V
    if kind == "redundant rows":
        A = np.vstack([A, rng.integers(-2, 3, (2, m)) @ A])
    if kind == "dependent levels" and earlier:
        before = np.vstack(earlier)
        A = np.vstack([A[: m // 2], rng.normal(size=(m, len(before))) @ before])
    return A
