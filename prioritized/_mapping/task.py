"""Major and secondary directions of the task, and the status of a mapping."""

from collections.abc import Callable, Mapping, Sequence
from enum import Enum
from functools import lru_cache
from typing import TypeGuard

import numpy as np
from numpy.typing import ArrayLike

import argument_checks as check
from argument_checks import Array
from prioritized._solver.canonical import canonical
from prioritized._solver.rank import RANK_TOLERANCE, frobenius, ranked_svd


class Status(Enum):
    """Quality of the solution of the major task; the value is a sentence that says what to do.

    Of several conditions that hold, the first one in this order is the status.
    """

    UNFINISHED = (
        "the solver reached its bound on steps: the limits hold, but levels may not have their "
        "least residual; start from this solution, or allow more steps"
    )
    INFEASIBLE = (
        "limits and constraints contradict each other: the limits hold, and the constraints are "
        "violated least; widen the limits, or drop constraints"
    )
    SELF_MOTION = (
        "the major task can move with every actuator locked, so no mapping can control it: brake a "
        "joint, drop major rows, or give the system the stiffness that resists this motion"
    )
    SCALED = (
        "limits restrict the major task, whose direction is preserved: see scale and "
        "active_limits, reduce the command, or widen these limits"
    )
    LIMITED = (
        "limits restrict the major task, which is met in the least-squares sense: "
        "see residual and active_limits, reduce the command, or widen these limits"
    )
    LEAST_SQUARES = (
        "part of the major task is unreachable and is met in the least-squares sense: "
        "see the residual, drop major rows, or restore an actuator"
    )
    UNSEEN = (
        "the structure bears part of the major force, which no torque can command: see reaction, "
        "drop major rows, or move away from the singularity"
    )
    DAMPED = "damping makes the major task inexact: see the residual, or set damping=0"
    EXACT = "the major task is met exactly"
    OPTIMAL = "every level has its least residual"


def status_of(conditions: Mapping[Status, Callable[[], object]], otherwise: Status) -> Status:
    """Return the first status, in the order of the class, whose condition holds."""
    holding = (status for status in Status if status in conditions and conditions[status]())
    return next(holding, otherwise)


def task_selection(
    major: Sequence[int] | ArrayLike,
    secondary: Sequence[int] | ArrayLike | None,
    m: int,
    tolerance: float = RANK_TOLERANCE,
) -> tuple[Array, Array]:
    """Return selection matrices S_m (m1, m), S_s (m2, m): v_m = S_m v, v_s = S_s v, eq. (15).

    By the balance of power, f = S_m^T f_m + S_s^T f_s.
    """
    if are_rows(major) and (secondary is None or are_rows(secondary)):
        return _of_rows(tuple(major), None if secondary is None else tuple(secondary), m)
    S_m = rows_of("major", major, m)
    if secondary is not None:
        return S_m, rows_of("secondary", secondary, m)
    if np.ndim(major) == 2:
        full = ranked_svd(S_m, frobenius(S_m), tolerance, full=True)
        return S_m, canonical(full.Vt[int(full.rank) :].T).T
    return S_m, _remaining_rows(S_m)


def are_rows(value: Sequence[int] | ArrayLike) -> TypeGuard[Sequence[int]]:
    """Return whether these are integers in a list, the common case, whose matrices are cached."""
    return (type(value) is list or type(value) is tuple) and _INT.issuperset(map(type, value))


_INT = frozenset({int})


@lru_cache
def _of_rows(
    major: tuple[int, ...], secondary: tuple[int, ...] | None, m: int
) -> tuple[Array, Array]:
    S_m = rows_of("major", major, m)
    S_s = _remaining_rows(S_m) if secondary is None else rows_of("secondary", secondary, m)
    return check.frozen(S_m), check.frozen(S_s)


def _remaining_rows(S_m: Array) -> Array:
    return np.eye(S_m.shape[1])[S_m.sum(axis=0) == 0]


def rows_of(name: str, rows: Sequence[int] | ArrayLike, m: int) -> Array:
    """Convert row numbers or directions to a selection matrix (k, m)."""
    try:
        directions = not check.is_masked(rows) and np.ndim(rows) == 2
    except ValueError:
        raise ValueError(
            f"{name} must be a rectangular array, got rows of different lengths"
        ) from None
    if directions:
        return check.array(name, rows, None, m, copy=True)
    return np.eye(m)[check.indices(name, rows, m)]
