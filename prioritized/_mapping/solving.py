"""Solutions of Problem 1: gains by the SVD; rates alone without it where ranks are clearly full."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

import argument_checks as check
from argument_checks import Array
from prioritized._mapping.levels import lexicographic, velocity_levels
from prioritized._mapping.limited import Optimum
from prioritized._mapping.problem import Problem, exact_part
from prioritized._mechanism.conditioning import well_conditioned_above
from prioritized._solver.arrays import none, on_axes, read_only
from prioritized._solver.compiled import batch, unlimited
from prioritized._solver.limits import Limits
from prioritized._solver.packed import Packed, Point, active_of, ends_of, point_of, solve
from prioritized._solver.rank import RankedSvd, norm

_LARGEST = 1e50
"""Norm of weights up to which their products with J and its inverse stay finite."""
Factors = tuple[Array, int, int, int, int, int, int]
"""What the compiled solver made of J and its weights, and their sizes: p, m, n, k1, k2, m2."""


@lru_cache
def room(*sizes: int) -> int:
    """How many numbers the factors of a problem of these sizes take."""
    return unlimited().room(unlimited().Sizes(*sizes))


@lru_cache
def thresholds(tolerance: float) -> tuple[float, float]:
    """Part of the scale above which singular values are clearly not zero, and of that for weights.

    The second is :attr:`Problem.exact`.
    """
    return well_conditioned_above(tolerance), exact_part(tolerance)


def velocity_gains(problem: Problem, damping: float = 0.0) -> tuple[Array, list[RankedSvd]]:
    """Gains of p = [v_m; rates_d; v_sd], shape (..., n, m1 + n + m2), and each rank decision."""
    X, decisions = lexicographic(velocity_levels(problem, damping), problem.tolerance)
    return on_axes(X, problem.lead), decisions


def factors_of(problem: Problem) -> Factors | None:
    """Factors of one problem without constraints, with which :func:`rates_by` solves it.

    Returns:
        None where the gains must decide: the major Jacobian or the weights on its null space are
        not clearly of full rank.
    """
    J, S_m, S_s, W1, W2 = problem[:5]
    sizes = len(S_m), *J.shape, len(W1), len(W2), len(S_s)
    F, solver, fractions = np.empty(room(*sizes)), unlimited(), thresholds(problem.tolerance)
    state = solver.factor(J, S_m, S_s, W1, W2, float(problem.scale), *fractions, F)
    return (F, *sizes) if state == solver.CLEAR else None


class Selected(NamedTuple):
    """What :func:`factors_of_diagonals` needs of the sizes of a problem, and of its tasks."""

    S_m: Array
    S_s: Array
    sizes: tuple[int, int, int, int, int, int]
    room: int
    clear: float
    exact: float
    metric: Array | None = None


class Simple(NamedTuple):
    """Tasks of a problem, and its weights by their diagonals, (0,) for none."""

    selected: Selected
    weights: tuple[Array, Array]


def simple(problem: Problem) -> Simple | None:
    """One problem with diagonal weights and nothing else but J; None for any other."""
    J, S_m, S_s, *weights = problem[:5]
    alone = not problem.tie_metric.size and not problem.lead
    if not alone or any(len(W) and not _is_diagonal(W) for W in weights):
        return None
    w1, w2 = (read_only(W.diagonal().copy() if len(W) else np.zeros(0)) for W in weights)
    sizes = len(S_m), *J.shape, len(w1), len(w2), len(S_s)
    fractions, metric = thresholds(problem.tolerance), problem.major_metric
    selected = Selected(S_m, S_s, sizes, room(*sizes), *fractions, metric)
    return Simple(selected, (w1, w2))


def _is_diagonal(W: Array) -> bool:
    return W.shape[0] == W.shape[1] and not (W - np.diag(W.diagonal())).any()


def factors_of_diagonals(
    J: Array, w1: Array, w2: Array, scale: float, selected: Selected
) -> Factors | None:
    """The same for weights given by their diagonals, (0,) for none, without a Problem.

    A negative `scale` is the norm of J. None is also for what the checks must complain about.
    """
    S_m, S_s, sizes, numbers, clear, exact, _ = selected
    F, solver = np.empty(numbers), unlimited()
    try:
        state = solver.factor_diagonals(J, S_m, S_s, w1, w2, scale, clear, exact, F)
    except TypeError:  # no vectors, or not of floats
        return None
    return (F, *sizes) if state == solver.CLEAR else None


def problem_of(factors: Factors, selected: Selected, scale: float, tolerance: float) -> Problem:
    """The Problem 1 that was made of factors."""
    J, W1, W2 = unlimited().arguments(*factors)
    m, n = J.shape
    size = norm(J) if scale < 0.0 else scale
    rest = selected.metric, none((0, n)), np.asarray(size), tolerance, ()
    return Problem(J, *selected[:2], W1, W2, none((0, n)), none((m, 0)), *rest)


def rates_by(
    factors: Factors,
    v_major: ArrayLike,
    joint_velocity: ArrayLike | None,
    secondary_velocity: ArrayLike | None,
    box: Limits | None = None,
) -> Array | None:
    """Optimal rates (n,) for one target, within these limits; None where another way is needed.

    That is where the target is a batch, or where the optimum within limits is not beyond doubt.

    Raises:
        ValueError: A velocity of the wrong shape or not finite, by its name.
    """
    n, m2, solver = factors[3], factors[6], unlimited()
    solve, last = (solver.apply, ()) if box is None else (solver.apply_within, (box,))
    joint = none((n,)) if joint_velocity is None else joint_velocity
    secondary = none((m2,)) if secondary_velocity is None else secondary_velocity
    rates = np.empty(n)
    # Calls of the argument checks would take as long as the arithmetic.
    if type(v_major) is type(joint) is type(secondary) is np.ndarray:
        try:
            code = solve(*factors, v_major, joint, secondary, *last, rates)
            if code != solver.REFUSED:
                return rates if code == solver.CLEAR else None
        except TypeError:  # no vectors, or not of floats
            pass
    names, sizes = ("v_major", "joint_velocity", "secondary_velocity"), (factors[1], n, m2)
    given = list(map(check.vector, names, (v_major, joint, secondary), sizes))
    if any(v.ndim > 1 for v in given):
        return None
    return rates if solve(*factors, *given, *last, rates) == solver.CLEAR else None


def rates_within(
    factors: Factors,
    rates: Array,
    box: Limits,
    tolerance: float,
    metric: Array | None,
    start: Point | None,
) -> Optimum:
    """The optimum within limits for the target of the last :func:`rates_by`, which gave `rates`.

    The error of the major task is least in its metric; None is the identity.
    """
    _, p, _, n, k1, k2, _ = factors
    rows, lower, upper = p + k1 + k2 + n, box[0][None], box[1][None]
    A, b, scales = np.empty((1, rows, n)), np.empty((1, rows)), np.empty((1, 3))
    exact = thresholds(tolerance)[1]
    unlimited().levels(*factors, exact, A, b, scales)
    if metric is not None:
        M = metric if len(metric) == p else np.linalg.qr(metric, mode="r")
        weighed = M @ A[0, :p]
        scales[0, 0] *= norm(weighed) / norm(A[0, :p])
        A[0, :p], b[0, :p] = weighed, M @ b[0, :p]
    packed = Packed(A, b, ends_of(p, k1 + k2, n), scales, tolerance, lower, upper)
    x, active = rates.copy(), active_of(start, (1, n))
    steps = unlimited().within(*factors, box, x, active[0])
    found = solve(packed, rates, start) if steps < 0 else point_of(x[None], active, steps)
    return Optimum(packed, found, n, 0, False, ())


def batched_rates(
    problem: Problem,
    v_major: ArrayLike,
    joint_velocity: ArrayLike | None,
    secondary_velocity: ArrayLike | None,
) -> Array | None:
    """Optimal rates (..., n) of a batch of unconstrained problems; gains only where ranks need it.

    Returns:
        None where velocities have more batch axes than the problems.

    Raises:
        ValueError: A velocity of the wrong shape or not finite, by its name.
    """
    p, m, n, m2 = len(problem.S_m), *problem.J.shape[-2:], len(problem.S_s)
    given = {
        "v_major": check.vector("v_major", v_major, p),
        "joint_velocity": _or_zero("joint_velocity", joint_velocity, n),
        "secondary_velocity": _or_zero("secondary_velocity", secondary_velocity, m2),
    }
    axes = {name: velocity.shape[:-1] for name, velocity in given.items()}
    if check.common_axes({"the mapping": problem.lead, **axes}) != problem.lead:
        return None
    flat = problem.flat()
    count = flat.lead[0]
    targets = [
        np.broadcast_to(velocity, (*problem.lead, size)).reshape(count, size)
        for velocity, size in zip(given.values(), (p, n, m2), strict=True)
    ]
    J, W1, W2 = (
        A[None] if A.ndim == 2 else A for A in (flat.J, flat.weight, flat.secondary_weight)
    )
    rates, clear = np.empty((count, n)), np.empty(count, dtype=bool)
    rest = np.ravel(flat.scale), *thresholds(problem.tolerance), *targets
    if count == len(J) >= batch().LANES and len(W1) == len(W2) == 1 and _is_moderate(W1[0], W2[0]):
        w, weighed = W1[0].diagonal(), W2[0] @ flat.S_s
        batch().solve_each(J, flat.S_m, weighed, w, W2[0], *rest, rates, clear)
    else:
        F = np.empty(room(p, m, n, W1.shape[1], W2.shape[1], m2))
        unlimited().solve_each(J, flat.S_m, flat.S_s, W1, W2, *rest, F, rates, clear)
    if not clear.all():
        X, _ = velocity_gains(flat.part(~clear))
        rates[~clear] = np.einsum("bij,bj->bi", X, np.hstack(targets)[~clear])
    return rates.reshape(*problem.lead, n)


def _is_moderate(W1: Array, W2: Array) -> bool:
    """Whether W1 is diagonal, and rates can be scaled by it without loss of digits."""
    if not _is_diagonal(W1) or not len(W1) or norm(W2) > _LARGEST:
        return False
    sizes = np.abs(W1.diagonal())
    return bool(1.0 / _LARGEST < sizes.max() < unlimited().SPREAD * sizes.min())


def _or_zero(name: str, value: ArrayLike | None, size: int) -> Array:
    return np.zeros(size) if value is None else check.vector(name, value, size)
