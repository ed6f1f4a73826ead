"""Maps from rates to major velocities and from torques to major forces, with their constraints.

Leading axes are batch axes; in batches constraints are projectors instead of bases.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from argument_checks import Array, Indices
from prioritized._mapping.levels import forces_of
from prioritized._mapping.problem import Problem, checked
from prioritized._solver.arrays import transposed
from prioritized._solver.rank import basis_scale, frobenius, ranked_svd


class MajorMap(NamedTuple):
    """Map v_m = gain @ x + free z for all x with constraint @ x = 0, and for any z.

    Attributes:
        gain: Shape (..., m1, n).
        constraint: Shape (..., r, n).
        free: Basis scaled to the size of `gain`, columns of zeros last, shape (..., m1, l).
        dimension: Number of the columns of `free` that are not zero, shape (...).
        scale: Size of the matrices that `gain` was computed from, shape (...).
    """

    gain: Array
    constraint: Array
    free: Array
    dimension: Indices
    scale: Array


def unweighted(
    J: Array,
    major: Sequence[int] | ArrayLike,
    active_constraint: Array,
    self_motion: Array,
    scale: Array | float,
) -> Problem:
    """Return Problems 1 and 6 without weights, after checking their arguments."""
    return checked(
        J, major, None, active_constraint=active_constraint, self_motion=self_motion, scale=scale
    )


def of_rates(problem: Problem) -> MajorMap:
    """Return the map from active rates to major velocities, v_m = J_m rates with C rates = 0."""
    G, S_m = problem.major_jacobian, problem.S_m
    empty = np.zeros((*G.shape[:-1], 0))
    dimension = np.zeros(G.shape[:-2], dtype=np.intp)
    return MajorMap(G, problem.active_constraint, empty, dimension, frobenius(S_m) * problem.scale)


def of_torques(problem: Problem) -> MajorMap:
    """Return the map from active torques to major forces, eqs. (13) and (16).

    torques = J^T f + C^T eta with Q^T f = 0; the constraint is that the torques have this form.
    `free` are major forces without any torque.
    """
    Q, tolerance, m1 = problem.self_motion, problem.tolerance, len(problem.S_m)
    units, others = (np.linalg.norm(S, axis=1)[:, None] for S in (problem.S_m, problem.S_s))
    problem = problem._replace(S_m=problem.S_m / units, S_s=problem.S_s / others)
    size = np.where(problem.scale > 0.0, problem.scale, 1.0)[..., None, None]
    # Any multiple of C spans the same internal forces; this one has the unit and size of J.
    forces = forces_of(problem._replace(active_constraint=size * problem.active_constraint))
    balance = transposed(Q) @ forces.task
    admissible = ranked_svd(balance, forces.task_scale * basis_scale(Q), tolerance).null_projector()
    torques = ranked_svd(forces.torques @ admissible, forces.torque_scale, tolerance)
    major = np.eye(m1, forces.task.shape[1]) @ admissible
    inverse = torques.pseudo_inverse()
    range_of = torques.U * torques.significant[..., None, :]
    borne = ranked_svd(major @ torques.null_projector(), np.sqrt(m1), tolerance)
    gain = major @ inverse / units
    scale = frobenius(1.0 / units) * frobenius(inverse)
    scale = np.where(scale > 0.0, scale, 1.0)
    return MajorMap(
        gain=gain,
        constraint=np.eye(gain.shape[-1]) - range_of @ transposed(range_of),
        free=scale[..., None, None] * _unit(borne.U / units) * borne.significant[..., None, :],
        dimension=borne.rank,
        scale=scale,
    )


def _unit(columns: Array) -> Array:
    """Scale columns to unit norm."""
    sizes = np.linalg.norm(columns, axis=-2, keepdims=True)
    return columns / np.where(sizes > 0.0, sizes, 1.0)


def with_free(
    of: MajorMap, lower: Array, upper: Array, dimension: int
) -> tuple[Array, Array, Array, Array]:
    """Return gain, constraint, lower and upper limits of [x; z] with unlimited z.

    Limits of x are (..., n); `dimension` is the number of columns of `free` in all maps.
    """
    empty = np.zeros((*of.constraint.shape[:-1], dimension))
    endless = np.full((*lower.shape[:-1], dimension), np.inf)
    return (
        np.concatenate([of.gain, of.free[..., :dimension]], axis=-1),
        np.concatenate([of.constraint, empty], axis=-1),
        np.concatenate([lower, -endless], axis=-1),
        np.concatenate([upper, endless], axis=-1),
    )
