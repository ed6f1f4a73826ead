"""The constraints that the loops put on the active rates, eq. (17), and their rank decision."""

from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_triangular

from argument_checks import Array, Indices
from prioritized._arrays import none
from prioritized._canonical import canonical
from prioritized._elimination import Loops
from prioritized._rank import ranked_svd


class ActiveConstraint(NamedTuple):
    """J~_Cp^T J_Ca on its decided rank r'.

    Attributes:
        rows: Orthonormal rows; admissible rates are their null space, shape (r', n - q).
        inverse: Pseudo-inverse of J~_Cp^T J_Ca, shape (n - q, r).
        gap: Of the rank.
    """

    rows: Array
    inverse: Array
    gap: float


def active_constraint(loops: Loops, J_C: Array, active: Indices) -> ActiveConstraint:
    """The constraints on the rates of these joints.

    The rank is decided on the closure error per norm of the whole motion, active and passive: where
    passive joints move fast, errors of J_C show in proportion.
    """
    n = len(active)
    if not len(loops.left_null):
        return ActiveConstraint(none((0, n)), none((n, 0)), np.inf)
    J_Ca = J_C[:, active]
    left = loops.left_null @ J_Ca
    # |R rates| is the norm of the rates and of the passive rates that follow them.
    R = np.linalg.qr(np.vstack([np.eye(n), loops.closing @ J_Ca]), mode="r")
    per_motion = solve_triangular(R, left.T, trans="T").T
    decided = ranked_svd(per_motion, loops.scale, loops.rank_tolerance)
    r = int(decided.rank)
    Q, T = np.linalg.qr((decided.Vt[:r] @ R).T)
    inverse = solve_triangular(T, (decided.U[:, :r] / decided.sigma[:r]).T, trans="T")
    return ActiveConstraint(canonical(Q).T, Q @ inverse, float(decided.gap))
