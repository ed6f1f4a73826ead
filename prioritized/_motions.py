"""The motions that the loops of a mechanism admit, under many failure conditions at once."""

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from argument_checks import Array, Mask
from prioritized._arrays import transposed
from prioritized._rank import frobenius, ranked_svd
from prioritized._system import ConstrainedSystem


@dataclass(frozen=True)
class Motions:
    """The motions theta_dot = B x that the loops admit, under each of C conditions.

    Attributes:
        B: Orthonormal basis, shape (N, d).
        driven: Motion x per active rate, shape (C, d, n); failed actuators have zero columns.
        self_motion: Orthogonal projector on the x with every active joint locked, (C, d, d).
        forbidden: Orthogonal projector on the rates that the loops do not admit, eq. (17); failed
            actuators have none at all. Shape (C, n, n).
        moving: Passive and free joints that are not stuck, shape (C, N).
        constraints: Number of constraints on the active rates, eq. (17), shape (C,).
        internal: Dimension of the internal force, shape (C,).
        gap: Smallest gap of the rank decisions, shape (C,).
    """

    B: Array
    driven: Array
    self_motion: Array
    forbidden: Array
    moving: Mask
    constraints: NDArray[np.intp]
    internal: NDArray[np.intp]
    gap: Array


def motions_under(system: ConstrainedSystem, locked: Mask, active: Mask) -> Motions:
    """The motions under each condition, given which actuators are locked and active, (C, n) each.

    The loops are eliminated once, then each condition in the coordinates x.
    """
    tolerance = system.rank_tolerance
    loops = ranked_svd(system.J_C, frobenius(system.J_C), tolerance, full=True)
    B = loops.Vt[int(loops.rank) :].T
    actuated, stuck = B[system.active], B[sorted(system.failures.locked_passive)]
    conditions = len(locked)
    locked_rows = np.concatenate(
        [locked[..., None] * actuated, np.broadcast_to(stuck, (conditions, *stuck.shape))], axis=1
    )
    # B is orthonormal, so that ranks of its rows are decided against one.
    held = ranked_svd(locked_rows, 1.0, tolerance)
    possible = held.null_projector()
    rates = ranked_svd(active[..., None] * actuated @ possible, 1.0, tolerance)

    moving = np.ones((conditions, len(B)), dtype=bool)
    moving[:, sorted(system.failures.locked_passive)] = False
    moving[:, system.active] = ~locked & ~active
    admissible = rates.U * rates.kept[:, None, :]
    dimension = B.shape[1] - held.rank - rates.rank
    return Motions(
        B=B,
        driven=possible @ rates.pseudo_inverse(),
        self_motion=possible @ rates.null_projector(),
        forbidden=np.eye(active.shape[1]) - admissible @ transposed(admissible),
        moving=moving,
        constraints=active.sum(axis=1) - rates.rank,
        # Rows of J_C less the rank of its columns of moving joints.
        internal=len(system.J_C) - (moving.sum(axis=1) - dimension),
        gap=np.minimum.reduce([np.broadcast_to(loops.gap, conditions), held.gap, rates.gap]),
    )


def with_stiffness(motions: Motions, stiffness: Array, tolerance: float) -> Motions:
    """The motions once self-motion minimizes theta^T K theta."""
    F, B_m = motions.self_motion, motions.moving[..., None] * motions.B
    # As in _elimination: against all forces on the moving joints.
    scale = np.sqrt(motions.moving @ (stiffness**2).sum(axis=1))
    # B_m and not B: springs of locked joints must not count, not even by the round-off of F.
    K_m = transposed(B_m) @ stiffness
    held = ranked_svd(F @ K_m @ B_m @ F, scale, tolerance)
    return dataclasses.replace(
        motions,
        driven=motions.driven - held.pseudo_inverse() @ (K_m @ motions.B) @ motions.driven,
        self_motion=F @ held.null_projector(),
        gap=np.minimum(motions.gap, held.gap),
    )
