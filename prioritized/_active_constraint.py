"""The constraints that the loops put on the active rates, eq. (17)."""

from typing import NamedTuple

import numpy as np

from argument_checks import Array
from prioritized._arrays import none
from prioritized._canonical import canonical
from prioritized._elimination import Partition


class ActiveConstraint(NamedTuple):
    """J~_Cp^T J_Ca on its decided rank r'.

    Attributes:
        rows: Orthonormal rows; admissible rates are their null space, shape (r', n - q).
        inverse: Pseudo-inverse of J~_Cp^T J_Ca, shape (n - q, r).
    """

    rows: Array
    inverse: Array


def active_constraint(system: Partition, left_null: Array) -> ActiveConstraint:
    """The constraints on the rates of the active joints, for rows J~_Cp^T (r, c)."""
    active = system.joints.active
    n = len(active)
    if not len(left_null):
        return ActiveConstraint(none((0, n)), none((n, 0)))
    units, motions = system.geometry.velocity_units[active], system.rigid
    k = int(motions.rates.rank)
    admissible = units[:, None] * motions.rates.U[:, :k]
    rows = canonical(np.linalg.qr(admissible, mode="complete")[0][:, k:]).T
    X = left_null @ system.J_C[:, active] @ rows.T
    return ActiveConstraint(rows, rows.T @ np.linalg.pinv(X))
