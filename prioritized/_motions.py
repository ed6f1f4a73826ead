"""The few motions that the loops of a mechanism leave, under many failure conditions at once."""

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
    """The few motions theta_dot = B x that the loops leave, under each condition.

    Attributes:
        B: Orthonormal basis, shape (N, d).
        driven: Motion per active rate, shape (C, d, n); failed actuators have zero columns.
        adrift: Orthogonal projector on the motions with every active joint held, shape (C, d, d).
        moving: Passive and free joints that are not stuck, shape (C, N).
        bound: Number of active rates that the loops forbid, shape (C,).
        internal: Number of internal forces, shape (C,).
        gap: Smallest gap so far, shape (C,).
    """

    B: Array
    driven: Array
    adrift: Array
    moving: Mask
    bound: NDArray[np.intp]
    internal: NDArray[np.intp]
    gap: Array


def motions_under(system: ConstrainedSystem, locked: Mask, active: Mask) -> Motions:
    """Eliminate the loops once, then the locked and held joints of each condition, (C, n) each."""
    tolerance = system.rank_tolerance
    loops = ranked_svd(system.J_C, frobenius(system.J_C), tolerance, full=True)
    B = loops.Vt[int(loops.rank) :].T
    actuated, stuck = B[system.active], B[sorted(system.failures.locked_passive)]
    conditions = len(locked)
    still = np.concatenate(
        [locked[..., None] * actuated, np.broadcast_to(stuck, (conditions, *stuck.shape))], axis=1
    )
    # B is orthonormal: what the rows of it leave is decided against one.
    held = ranked_svd(still, 1.0, tolerance)
    possible = held.null_projector()
    rates = ranked_svd(active[..., None] * actuated @ possible, 1.0, tolerance)

    moving = np.ones((conditions, len(B)), dtype=bool)
    moving[:, sorted(system.failures.locked_passive)] = False
    moving[:, system.active] = ~locked & ~active
    adrift = B.shape[1] - held.rank - rates.rank
    return Motions(
        B=B,
        driven=possible @ rates.pseudo_inverse(),
        adrift=possible @ rates.null_projector(),
        moving=moving,
        bound=active.sum(axis=1) - rates.rank,
        # Rows of J_C less the rank of its columns of moving passive joints.
        internal=len(system.J_C) - (moving.sum(axis=1) - adrift),
        gap=np.minimum.reduce([np.broadcast_to(loops.gap, conditions), held.gap, rates.gap]),
    )


def sprung(motions: Motions, stiffness: Array, tolerance: float) -> Motions:
    """Motion that was adrift goes where theta^T K theta is least."""
    F, B_m = motions.adrift, motions.moving[..., None] * motions.B
    scale = np.sqrt(np.einsum("ci,ij,cj->c", motions.moving, stiffness**2, motions.moving))
    # Springs of joints that are held must not weigh in, not even by the round-off of F.
    K_m = transposed(B_m) @ stiffness
    held = ranked_svd(F @ K_m @ B_m @ F, scale, tolerance)
    return dataclasses.replace(
        motions,
        driven=motions.driven - held.pseudo_inverse() @ (K_m @ motions.B) @ motions.driven,
        adrift=F @ held.null_projector(),
        gap=np.minimum(motions.gap, held.gap),
    )
