"""Motions that the loops of a mechanism admit, under one failure condition or many at once.

All in natural units. Null spaces are bases for one condition, and projectors for many, whose shape
does not depend on the rank; the axes of the conditions lead.
"""

import dataclasses
from dataclasses import dataclass

import numpy as np

from argument_checks import Array, Indices, Mask
from prioritized._mechanism.geometry import Geometry
from prioritized._solver.arrays import transposed
from prioritized._solver.rank import RankedSvd, ranked_svd


@dataclass(frozen=True)
class Motions:
    """Motions theta_dot = B x that the loops admit, with B of :class:`Geometry`.

    Attributes:
        geometry: J_T and J_C.
        moving: Passive and free joints that are not stuck, shape (..., N).
        rates: Rank decision on the active rates of the motions with every locked joint at rest.
        driven: Motion x per active rate, shape (..., d, n); failed actuators have zero columns.
        self_motion: Motions x with every active joint locked: basis (d, f) or projector (..., d,
            d).
        freedom: Dimension f of the self-motion, shape (...).
        internal: Dimension of the internal force: the rows of J_C less the rank of J_Cp, (...).
        closing: Task motion per closure error, active and locked joints at rest, (..., m, c); None
            if the geometry is exact.
        gap: Smallest gap of the rank decisions, shape (...).
    """

    geometry: Geometry
    moving: Mask
    rates: RankedSvd
    driven: Array
    self_motion: Array
    freedom: Indices
    internal: Indices
    closing: Array | None
    gap: Array

    @property
    def admissible(self) -> Array:
        """Orthonormal basis of the rates that the loops admit, zeros last, shape (..., n, .)."""
        k = self.rates.sigma.shape[-1]
        return self.rates.U[..., :k] * self.rates.significant[..., None, :]

    def constraints(self, actuators: Indices | int) -> Indices:
        """Return the number of constraints on the rates of so many actuators, eq. (17), (...)."""
        return actuators - self.rates.rank


def motions_of(
    geometry: Geometry, actuated: Indices, stuck: Indices, masks: tuple[Mask, Mask] | None = None
) -> Motions:
    """Return the admissible motions, given the roles of the joints by velocity index.

    Args:
        geometry: J_T and J_C.
        actuated: Active joints, or all actuated joints if masks are given.
        stuck: Joints whose rate is zero; if masks are given, in addition to the locked actuators.
        masks: Which actuators are locked and which are active, (C, n) each; None is one condition
            in which all of `actuated` are active.
    """
    B, tolerance = geometry.motions, geometry.rank_tolerance
    rows = B[actuated]
    moving = np.ones(len(B), dtype=bool)
    moving[stuck], moving[actuated] = False, False
    if masks is None:
        locked, of_locked = B[stuck], geometry.closing[stuck] if _is_inexact(geometry) else None
        active: Array | float = 1.0
    else:
        is_locked, is_active = masks
        count, active = len(is_locked), is_active[..., None].astype(float)
        moving = np.tile(moving, (count, 1))
        moving[:, actuated] = ~is_locked & ~is_active
        both = np.concatenate([is_locked, np.ones((count, len(stuck)), dtype=bool)], axis=1)
        fixed_joints = np.concatenate([actuated, stuck])
        locked = both[..., None] * B[fixed_joints]
        of_locked = None
        if _is_inexact(geometry):
            of_locked = both[..., None] * geometry.closing[fixed_joints]
    alone = masks is None
    # B is orthonormal, so that the scale of ranks of its rows is one.
    fixed = ranked_svd(locked, 1.0, tolerance, full=alone, error=_error(geometry, of_locked, B))
    possible = fixed.null if alone else fixed.null_projector()
    unlocking = fixed.pseudo_inverse()
    of_active = None
    if of_locked is not None:
        of_active = active * (geometry.closing[actuated] - rows @ unlocking @ of_locked)
    rates = ranked_svd(
        active * rows @ possible,
        1.0,
        tolerance,
        full=alone,
        error=_error(geometry, of_active, B @ possible),
    )
    driven = possible @ rates.pseudo_inverse()
    closing = None
    if of_locked is not None and of_active is not None:
        task = geometry.task @ B
        free = geometry.task @ geometry.closing
        closing = free - task @ (unlocking @ of_locked + driven @ of_active)
    gaps = np.broadcast_arrays(geometry.loops.gap, fixed.gap, rates.gap)
    if not len(geometry.J_C):  # nothing was decided: B is the identity
        gaps = [np.full_like(gaps[0], np.inf)]
    freedom = B.shape[1] - fixed.rank - rates.rank
    return Motions(
        geometry=geometry,
        moving=moving,
        rates=rates,
        driven=driven,
        self_motion=possible @ (rates.null if alone else rates.null_projector()),
        freedom=freedom,
        internal=len(geometry.J_C) - (moving.sum(axis=-1) - freedom),
        closing=closing,
        gap=np.minimum.reduce(gaps),
    )


def _is_inexact(geometry: Geometry) -> bool:
    return geometry.closure_error is not None


def _error(geometry: Geometry, closing: Array | None, motion: Array) -> Array | None:
    """Return error bounds of a task that moves by `closing` per error of closure; None if exact."""
    if closing is None or geometry.closure_error is None:
        return None
    return np.abs(closing) @ (geometry.closure_error @ np.abs(motion))


def with_stiffness(motions: Motions, stiffness: Array) -> Motions:
    """Return the motions with the self-motion that minimizes theta^T K theta."""
    geometry, F, K = motions.geometry, motions.self_motion, stiffness
    if not F.shape[-1]:
        return motions
    B = geometry.motions
    # Springs of locked joints must not count, not even by the round-off of F.
    B_m = motions.moving[..., None] * B
    K_m = transposed(B_m) @ K
    # The scale includes all forces on the moving joints: relative to a large coupling K_pa, a
    # tiny K_pp is round-off.
    scale = np.sqrt(motions.moving @ (K**2).sum(axis=1))
    alone = motions.moving.ndim == 1
    resisted = transposed(F) @ K_m @ B_m @ F
    resistance = ranked_svd(resisted, scale, geometry.rank_tolerance, full=alone)
    compliance = F @ resistance.pseudo_inverse() @ transposed(F)
    return dataclasses.replace(
        motions,
        driven=motions.driven - compliance @ (K_m @ B) @ motions.driven,
        self_motion=F @ (resistance.null if alone else resistance.null_projector()),
        freedom=motions.freedom - resistance.rank,
        gap=np.minimum(motions.gap, resistance.gap),
    )
