"""Arguments of a velocity mapping, checked, or used directly if they are plain arrays."""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

import argument_checks as check
from argument_checks import Array
from kernels import Struct
from prioritized._mapping.limited import WhenLimited, limiting
from prioritized._mapping.plain import Plain, shape_of
from prioritized._mapping.problem import checked
from prioritized._mapping.task import are_rows, task_selection
from prioritized._mapping.velocity import VelocityMapping
from prioritized._solver.arrays import none
from prioritized._solver.rank import RANK_TOLERANCE


def velocity_mapping(
    J: ArrayLike,
    major: Sequence[int] | ArrayLike,
    secondary: Sequence[int] | ArrayLike | None = None,
    joint_weight: ArrayLike | None = None,
    secondary_weight: ArrayLike | None = None,
    active_constraint: ArrayLike | None = None,
    self_motion: ArrayLike | None = None,
    *,
    major_metric: ArrayLike | None = None,
    tie_metric: ArrayLike | None = None,
    damping: float = 0.0,
    scale: ArrayLike | None = None,
    rank_tolerance: float = RANK_TOLERANCE,
    rate_limits: tuple[ArrayLike, ArrayLike] | None = None,
    rate_rows: tuple[ArrayLike, ArrayLike, ArrayLike] | None = None,
    when_limited: WhenLimited = "least_squares",
) -> VelocityMapping:
    """Return the mapping from a major velocity to the optimal active joint rates.

    It minimizes |W1 (rates - rates_d)|^2 + |W2 (v_s - v_sd)|^2 at the given major velocity, by
    lexicographic least squares: each level is solved without changing those before it.

    1. C rates = 0                          (constrained active joints, eq. 17)
    2. |M (J_m rates - v_m)|   smallest     (zero where reachable, eq. 23)
    3. the weighted sum above  smallest     (eq. 24)
    4. |T rates|, then |rates| smallest     (ties)

    Theorems 3, 4 and 5 of Chen, McInroy, Yi (2003) are the cases of W1, W2 both nonsingular,
    W2 = 0, and W1 = 0; here the weights may be any matrices.

    Args:
        J: Task Jacobian, eq. (14), shape (..., m, n).
        major: Task rows of the major task, or a matrix of directions (m1, m).
        secondary: Task rows, or directions (m2, m), of the secondary task; by default the
            remaining rows in ascending order (for directions: their orthogonal complement).
        joint_weight: W1, diagonal (n,) or matrix (..., k, n); None is zero.
        secondary_weight: W2, diagonal (m2,) or matrix (..., k, m2); None is zero.
        active_constraint: C, shape (..., r, n).
        self_motion: Task motion with every actuator locked, shape (..., m, k), columns of unit
            size; it affects the status only.
        major_metric: M, diagonal (m1,) or matrix (..., k, m1); None is the identity. It affects the
            rates where the major task is out of reach or damped.
        tie_metric: T, diagonal (n,) or matrix (..., k, n); None is zero. It affects the rates where
            the weights do not determine them.
        damping: Tikhonov damping of level 2, in units of the singular values of M J_m. It keeps
            the part of the rates that moves the major task below |M v_m| / (2 damping) and makes
            that task inexact. Secondary goals are not damped: use joint_weight.
        scale: Size of J that ranks are decided against, shape (...); None is the norm of J. For a J
            that is a difference of large terms specify their size.
        rank_tolerance: Singular values below this fraction of the scale count as zero. Those of W1
            and T, whose accuracy does not depend on J, are compared with at most 1e-10: no joint
            can be weighted 1e10 times another.
        rate_limits: Lower and upper limits of the rates, each (n,) or one number, also infinite;
            they hold exactly and have priority over all levels. None is no limit.
        rate_rows: (R, lower, upper) with R (r, n): lower <= R rates <= upper has the next priority;
            sides as in `rate_limits`.
        when_limited: Treatment of a major task beyond the limits: "least_squares", the least error
            |M (J_m rates - v_m)|, or "scaled", the fastest motion in the same direction.
    """
    if (
        active_constraint is self_motion is major_metric is tie_metric is None
        and rate_rows is None
        and damping == 0
    ):
        mapping = of_plain_arrays(
            J, major, secondary, joint_weight, secondary_weight, scale, rank_tolerance,
            rate_limits, when_limited,
        )  # fmt: skip
        if mapping is not None:
            return mapping
    args = checked(
        J,
        major,
        secondary,
        weight_name="joint_weight",
        weight=joint_weight,
        secondary_weight=secondary_weight,
        active_constraint=active_constraint,
        self_motion=self_motion,
        major_metric=major_metric,
        tie_metric=tie_metric,
        scale=scale,
        rank_tolerance=rank_tolerance,
    )
    n = args.J.shape[-1]
    limited = limiting(n, "rate_limits", rate_limits, {"rate_rows": rate_rows}, when_limited)
    return VelocityMapping(args, check.number("damping", damping, 0.0), limited)


def of_plain_arrays(
    J: Any,
    major: Any,
    secondary: Any,
    joint_weight: Any,
    secondary_weight: Any,
    scale: Any,
    rank_tolerance: Any,
    box: Any,
    when_limited: WhenLimited,
) -> VelocityMapping | None:
    """Return the mapping of one J with diagonal weights if all arguments are plain, else None."""
    w1 = _NOTHING if joint_weight is None else joint_weight
    w2 = _NOTHING if secondary_weight is None else secondary_weight
    size, others = 1.0 if scale is None else scale, () if secondary is None else secondary
    # Calls of the argument checks would take as long as the arithmetic.
    if not (
        type(J) is type(w1) is type(w2) is np.ndarray
        and type(size) is type(rank_tolerance) is float
        and 0.0 < size < check.LARGEST
        and (type(major) is list or type(major) is tuple)
        and (type(others) is list or type(others) is tuple)
    ):
        return None
    has = rank_tolerance, joint_weight is not None, secondary_weight is not None
    try:
        selected = _selected(J.shape, has, len(major), secondary is None, *major, *others)
    except TypeError:  # directions
        return None
    if selected is None or not (
        J.dtype is w1.dtype is w2.dtype is _FLOAT64
        and w1.shape == (J.shape[1:] if joint_weight is not None else (0,))
        and w2.shape == ((len(selected[0][1]),) if secondary_weight is not None else (0,))
    ):
        return None
    directions, S, struct = selected
    weights = w1.copy() if has[1] else None, w2.copy() if has[2] else None
    sizes = None if scale is None else np.array([size])
    m1 = len(directions[0])
    plain = Plain(J.copy(), S, m1, weights, None, sizes, rank_tolerance, shape=struct)
    if not plain.is_moderate:
        return None
    limited = limiting(J.shape[1], "rate_limits", box, {}, when_limited)
    return VelocityMapping._of_plain(plain, directions, limited)


# typed: row 1 is not True
@lru_cache(maxsize=1024, typed=True)
def _selected(
    shape: tuple[int, ...], has: tuple[float, bool, bool], p: int, complement: bool, *rows: Any
) -> tuple[tuple[Array, Array], Array, tuple[Struct, int]] | None:
    """Return both tasks, all directions, and the kernel's description of the problem.

    `has` is the rank tolerance, and whether rates and secondary task have weights. `rows` are those
    of both tasks, the first p of the major one; `complement` adds all other rows.
    """
    tolerance, has_rates, has_secondary = has
    if not (len(shape) == 2 and 0.0 < tolerance < 1.0 and are_rows(rows)):
        return None
    S_m, S_s = task_selection(rows[:p], None if complement else rows[p:], shape[0])
    S = check.frozen(np.concatenate([S_m, S_s]))
    struct = shape_of(S, len(S_m), shape[1], (has_rates, has_secondary), tolerance)
    return (S_m, S_s), S, struct


_FLOAT64 = np.dtype(np.float64)
_NOTHING = none((0,))
