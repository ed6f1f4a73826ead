"""The constraints that the loops put on the active rates, eq. (17)."""

from typing import NamedTuple

from argument_checks import Array
from prioritized._mechanism.elimination import Partition
from prioritized._solver.arrays import none
from prioritized._solver.canonical import canonical
from prioritized._solver.rank import whole_svd


class ActiveConstraint(NamedTuple):
    """J~_Cp^T J_Ca on its decided rank r', in natural units.

    Attributes:
        rows: Orthonormal rows; admissible rates are their null space, shape (r', n - q).
        inverse: Pseudo-inverse of J~_Cp^T J_Ca, shape (n - q, r).
    """

    rows: Array
    inverse: Array


def active_constraint(system: Partition, left_null: Array) -> ActiveConstraint:
    """The constraints on the active rates, for J~_Cp^T (r, c)."""
    active = system.joints.active
    n = len(active)
    if not len(left_null):
        return ActiveConstraint(none((0, n)), none((n, 0)))
    rates = system.rigid.rates
    rows = rates.U[:, int(rates.rank) :].T
    U, sigma, Vt = whole_svd((left_null @ system.J_C.take(active, 1) @ rows.T) @ rows)
    rank = len(rows)
    inverse = (Vt[:rank].T / sigma[:rank]) @ U[:, :rank].T
    return ActiveConstraint(canonical(Vt[:rank].T).T, inverse)
