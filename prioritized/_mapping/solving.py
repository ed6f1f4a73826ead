"""Solutions of Problem 1: gains by the SVD; rates alone without it where ranks are clearly full."""

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

import argument_checks as check
from argument_checks import Array
from kernels import ffi, lib, pointer
from prioritized._mapping.levels import lexicographic, velocity_levels
from prioritized._mapping.limited import Optimum
from prioritized._mapping.problem import Problem, exact_part
from prioritized._mechanism.conditioning import well_conditioned_above
from prioritized._solver.arrays import none, on_axes, read_only, workspace
from prioritized._solver.packed import Packed, Point, active_of, ends_of, point_of, solve
from prioritized._solver.rank import RankedSvd, norm

_LARGEST = 1e50
"""Norm of weights up to which their products with J and its inverse stay finite."""
_FLOAT64 = np.dtype(np.float64)
_CLEAR, _REFUSED = lib.CLEAR, lib.REFUSED
"""As they are looked up faster."""
Sizes = tuple[int, int, int, int, int, int]
"""p, m, n, k1, k2, m2, as in kernels.h."""
Target = tuple[Any, Any, Any]
"""v_m (p,), rates_d (n,) and v_sd (m2,), as C takes them."""
_NAMES = "v_major", "joint_velocity", "secondary_velocity"


class Factors:
    """What is made of a J and its weights where all ranks are clearly full, shared by threads.

    Attributes:
        F: The numbers, read-only; C writes them once, when they are made.
        sizes: Of the problem.
        given: The sizes and F, as C takes them.
        work: How many numbers a call for one target works on.
    """

    __slots__ = ("F", "given", "sizes", "work")

    def __init__(self, F: Array, sizes: Sizes) -> None:
        struct, self.work = _struct(sizes)
        self.F, self.sizes, self.given = read_only(F), sizes, (struct, pointer(F))

    def __reduce__(self) -> tuple[type["Factors"], tuple[Array, Sizes]]:
        # Pointers are no use elsewhere.
        return Factors, (self.F, self.sizes)


@lru_cache
def _struct(sizes: Sizes) -> tuple[Any, int]:
    return ffi.new("single_sizes *", sizes)[0], lib.single_work(sizes)


@lru_cache
def room(*sizes: int) -> int:
    """How many numbers the factors of a problem of these sizes take."""
    return lib.single_room(sizes)


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
    made = Factors(np.empty(room(*sizes)), sizes)
    (struct, F), given = made.given, map(_at, (J, S_m, S_s, W1, W2))
    fractions = float(problem.scale), *thresholds(problem.tolerance)
    code = lib.single_factor(struct, *given, *fractions, F)
    return made if code == _CLEAR else None


class Selected(NamedTuple):
    """What :func:`factors_of_diagonals` needs of the sizes of a problem, and of its tasks."""

    S_m: Array
    S_s: Array
    sizes: Sizes
    room: int
    clear: float
    exact: float
    metric: Array | None
    given: tuple[Any, Any]

    @staticmethod
    def of(
        S_m: Array, S_s: Array, sizes: Sizes, clear: float, exact: float, metric: Array | None
    ) -> "Selected":
        """With what follows from these: the room, and `given`, the tasks as C takes them."""
        given = _at(S_m), _at(S_s)
        return Selected(S_m, S_s, sizes, room(*sizes), clear, exact, metric, given)

    def __reduce__(self) -> tuple[Any, ...]:
        # Pointers are no use elsewhere.
        S_m, S_s, sizes, _, *rest, _ = self
        return Selected.of, (S_m, S_s, sizes, *rest)


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
    selected = Selected.of(S_m, S_s, sizes, *fractions, metric)
    return Simple(selected, (w1, w2))


def _is_diagonal(W: Array) -> bool:
    return W.shape[0] == W.shape[1] and not (W - np.diag(W.diagonal())).any()


def factors_of_diagonals(
    J: Array, w1: Array, w2: Array, scale: float, selected: Selected
) -> Factors | None:
    """The same for weights given by their diagonals, (0,) for none, without a Problem.

    A negative `scale` is the norm of J. None is also for what the checks must complain about.
    """
    _, _, sizes, numbers, clear, exact, _, tasks = selected
    _, m, n, k1, k2, m2 = sizes
    if not (
        J.dtype is w1.dtype is w2.dtype is _FLOAT64
        and (J.shape, w1.shape, w2.shape) == ((m, n), (k1,), (k2,))
        and (k1 == 0 or k1 == n)
        and (k2 == 0 or k2 == m2)
    ):
        return None
    made, rest = Factors(np.empty(numbers), sizes), (_at(w1), _at(w2), scale, clear, exact)
    struct, F = made.given
    code = lib.single_factor_diagonals(struct, _at(J), *tasks, *rest, F)
    return made if code == _CLEAR else None


def problem_of(factors: Factors, selected: Selected, scale: float, tolerance: float) -> Problem:
    """The Problem 1 that was made of factors."""
    _, m, n, k1, k2, m2 = factors.sizes
    first, given = lib.single_arguments(factors.sizes), []
    for rows, columns in ((k1, n), (k2, m2), (m, n)):
        given.append(factors.F[first : first + rows * columns].reshape(rows, columns))
        first += rows * columns
    W1, W2, J = given
    size = norm(J) if scale < 0.0 else scale
    rest = selected.metric, none((0, n)), np.asarray(size), tolerance, ()
    return Problem(J, *selected[:2], W1, W2, none((0, n)), none((m, 0)), *rest)


def rates_by(factors: Factors, target: Target, box: Array | None = None) -> Array | None:
    """Optimal rates (n,) for one target, within these limits; None where another way is needed.

    That is where the target is a batch, or where the optimum within limits is not beyond doubt.

    Raises:
        ValueError: A velocity that is not finite, by its name.
    """
    if None in target:
        return None
    p, _, n, _, _, m2 = factors.sizes
    rates = np.empty(n)
    last = workspace(factors.work), pointer(rates)
    if box is None:
        code = lib.single_apply(*factors.given, *target, *last)
    else:
        code = lib.single_apply_within(*factors.given, *target, pointer(box), *last)
    if code == _REFUSED:
        for name, numbers, size in zip(_NAMES, target, (p, n, m2), strict=True):
            check.vector(name, ffi.unpack(numbers, size), size)
    return rates if code == _CLEAR else None


def target_of(
    factors: Factors,
    v_major: ArrayLike,
    joint_velocity: ArrayLike | None,
    secondary_velocity: ArrayLike | None,
) -> Target:
    """The vectors of one target, zero where none is given; None in place of a batch.

    Raises:
        ValueError: A velocity of the wrong shape or not finite, by its name; the numbers of a
            vector of floats are left to :func:`rates_by`.
    """
    p, _, n, _, _, m2 = factors.sizes
    major, joint, secondary = _NAMES
    return (
        _vector(major, v_major, p),
        _zeros(n) if joint_velocity is None else _vector(joint, joint_velocity, n),
        _zeros(m2) if secondary_velocity is None else _vector(secondary, secondary_velocity, m2),
    )


def _vector(name: str, value: ArrayLike, size: int) -> Any:
    # A call of the argument checks would take as long as the arithmetic.
    if type(value) is np.ndarray and value.dtype is _FLOAT64 and value.shape == (size,):
        return pointer(value) if value.flags.c_contiguous else _at(value)
    v = check.vector(name, value, size)
    return _at(v) if v.ndim == 1 else None


@lru_cache
def _zeros(size: int) -> Any:
    return pointer(none((size,)))


def _at(A: Array) -> Any:
    return pointer(np.ascontiguousarray(A))


def rates_within(
    factors: Factors,
    target: Target,
    rates: Array,
    box: Array,
    tolerance: float,
    metric: Array | None,
    start: Point | None,
) -> Optimum:
    """The optimum within limits for a target, for which :func:`rates_by` gave `rates` without.

    The error of the major task is least in its metric; None is the identity.
    """
    p, _, n, k1, k2, _ = factors.sizes
    rows, lower, upper = p + k1 + k2 + n, box[0][None], box[1][None]
    A, b, scales = np.empty((1, rows, n)), np.empty((1, rows)), np.empty((1, 3))
    exact = thresholds(tolerance)[1]
    last = exact, pointer(A), pointer(b), pointer(scales)
    lib.single_levels(*factors.given, *target, *last)
    if metric is not None:
        M = metric if len(metric) == p else np.linalg.qr(metric, mode="r")
        weighed = M @ A[0, :p]
        scales[0, 0] *= norm(weighed) / norm(A[0, :p])
        A[0, :p], b[0, :p] = weighed, M @ b[0, :p]
    packed = Packed(A, b, ends_of(p, k1 + k2, n), scales, tolerance, lower, upper)
    x, active = rates.copy(), active_of(start, (1, n))
    rooms = workspace(factors.work), pointer(x), pointer(active)
    steps = lib.single_within(*factors.given, _at(box), *rooms)
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
    rates, clear, scale = np.empty((count, n)), np.empty(count, dtype=bool), np.ravel(flat.scale)
    given = *thresholds(problem.tolerance), *map(_at, targets)
    last, S_m, S_s = (pointer(rates), pointer(clear)), flat.S_m, flat.S_s
    sizes = p, m, n, W1.shape[1], W2.shape[1], m2
    if count == len(J) >= lib.LANES and len(W1) == len(W2) == 1 and _is_moderate(W1[0], W2[0]):
        matrices = map(_at, (J, S_m, W2[0] @ S_s, W1[0].diagonal(), W2, scale))
        each, work = int(len(scale) > 1), workspace(lib.batch_work(sizes))
        lib.batch_solve_each(sizes, count, *matrices, each, *given, work, *last)
    else:
        each = [A[0].size if len(A) > 1 else 0 for A in (J, W1, W2, scale)]
        matrices, F = map(_at, (J, S_m, S_s, W1, W2, scale)), workspace(room(*sizes))
        lib.single_solve_each(sizes, count, each, *matrices, *given, F, *last)
    if not clear.all():
        X, _ = velocity_gains(flat.part(~clear))
        rates[~clear] = np.einsum("bij,bj->bi", X, np.hstack(targets)[~clear])
    return rates.reshape(*problem.lead, n)


def _is_moderate(W1: Array, W2: Array) -> bool:
    """Whether W1 is diagonal, and rates can be scaled by it without loss of digits."""
    if not _is_diagonal(W1) or not len(W1) or norm(W2) > _LARGEST:
        return False
    sizes = np.abs(W1.diagonal())
    return bool(1.0 / _LARGEST < sizes.max() < lib.SPREAD * sizes.min())


def _or_zero(name: str, value: ArrayLike | None, size: int) -> Array:
    return np.zeros(size) if value is None else check.vector(name, value, size)
