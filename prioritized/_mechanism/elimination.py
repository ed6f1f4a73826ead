"""Elimination of passive joints, eqs. (6) to (10), with springs on motion left free by loops."""

from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from argument_checks import Array, Indices
from kernels import lib, pointer
from prioritized._mechanism.conditioning import loop_threshold
from prioritized._mechanism.geometry import Geometry
from prioritized._mechanism.motions import Motions, motions_of, with_stiffness
from prioritized._mechanism.task_motion import TaskMotion
from prioritized._solver.arrays import identity, none, read_only
from prioritized._solver.canonical import canonical
from prioritized._solver.rank import norm, whole_svd


class Joints(NamedTuple):
    """Velocity indices by the role of the joint; all but the active ones ascend.

    For each stuck joint the paper adds a unit row E to J_C (section 2.3.2). Here stuck joints are
    left out of the decomposition instead, and E's rows are restored in the result. This is
    mathematically equivalent, but ranks do not depend on the units of J_C relative to E.

    Attributes:
        actuators: Surviving actuators, in nominal numbering, shape (n - q,).
        active: Velocities of the surviving actuators, shape (n - q,).
        stuck: Joints whose rate is zero, actuated or not, shape (s,).
        moving: Passive joints that are not stuck, shape (p,).
        passive: All joints that are not active, shape (N - n + q,).
        actuated: Velocities of all nominal actuators, failed ones too, shape (n,).
        order: Moving, then active joints, shape (p + n - q,).
    """

    actuators: Indices
    active: Indices
    stuck: Indices
    moving: Indices
    passive: Indices
    actuated: Indices
    order: Indices

    def among_passive(self, rows: Array) -> Array:
        """Place rows of the moving joints (p, .) among those of the passive ones, else zero."""
        passive = np.zeros((len(self.passive), rows.shape[1]))
        passive[np.searchsorted(self.passive, self.moving)] = rows
        return passive

    def together(self, rates: ArrayLike, passive: Array) -> Array:
        """Merge active rates (..., n - q) and passive ones (..., N - n + q) to (..., N)."""
        velocities = np.empty((*passive.shape[:-1], len(self.active) + len(self.passive)))
        velocities[..., self.active] = rates
        velocities[..., self.passive] = passive
        return velocities


def sort_joints(actuated: Indices, actuators: Indices, stuck: Indices, N: int) -> Joints:
    """Classify the N velocities, given the surviving actuators and the stuck joints."""
    active = actuated[actuators]
    moving = _others(np.concatenate([active, stuck]), N)
    order = np.concatenate([moving, active])
    return Joints(actuators, active, stuck, moving, _others(active, N), actuated, order)


def _others(excluded: Indices, count: int) -> Indices:
    """Return the indices of range(count) that are not excluded, ascending."""
    is_other = np.ones(count, dtype=bool)
    is_other[excluded] = False
    return np.flatnonzero(is_other)


@dataclass(frozen=True, eq=False)
class Partition:
    """Constrained system partitioned by joints, eqs. (6) to (9), in natural units.

    Attributes:
        geometry: J_T and J_C.
        joints: Joints by their role.
        stiffness: K of the joint springs, (N, N); None is a rigid mechanism.
        passive_metric: Shape (N, N); None is the identity.
    """

    geometry: Geometry
    joints: Joints
    stiffness: Array | None
    passive_metric: Array | None

    @property
    def J_T(self) -> Array:
        """Task Jacobian in natural units, shape (m, N)."""
        return self.geometry.task

    @property
    def J_C(self) -> Array:
        """Constraint Jacobian in natural units, shape (c, N)."""
        return self.geometry.closure

    @property
    def shape(self) -> tuple[int, int]:
        """Shape of J, (m, n - q)."""
        return len(self.geometry.J_T), len(self.joints.active)

    def reduced(self, gain: Array) -> tuple[Array, float]:
        """Return J = J_Ta + J_Tp gain, eq. (14), shape (m, n - q), and the size of its terms."""
        J_T, (p, n) = np.ascontiguousarray(self.J_T), gain.shape
        J, columns = np.empty((len(J_T), n)), (pointer(self.joints.order), p, n, pointer(gain), n)
        scale = lib.reduce_task(pointer(J_T), *J_T.shape, *columns, pointer(J))
        return read_only(J), scale

    @property
    def is_rigid(self) -> bool:
        """Return whether the loops alone determine the motion of passive joints."""
        return self.stiffness is None and self.passive_metric is None

    @cached_property
    def rigid(self) -> Motions:
        """Motions that the loops admit."""
        return motions_of(self.geometry, self.joints.active, self.joints.stuck)

    @cached_property
    def elastic(self) -> Motions:
        """Motions that the loops admit with the springs of the joints."""
        return self.rigid if self.stiffness is None else with_stiffness(self.rigid, self.stiffness)

    @cached_property
    def weighed(self) -> Motions:
        """Motions with the springs, and with the passive metric as further springs."""
        metric = self.passive_metric
        return self.elastic if metric is None else with_stiffness(self.elastic, metric)

    @cached_property
    def motions(self) -> Motions:
        """Motions with springs whose self-motion has the least norm in the passive metric."""
        elastic = self.elastic
        return replace(self.weighed, self_motion=elastic.self_motion, freedom=elastic.freedom)


class PassiveMotion(NamedTuple):
    """Motion of the p moving passive joints per active rate, in natural units.

    Attributes:
        gain: Passive rates per active rate, eq. (10), shape (p, n - q).
        closing: J_Cp^+ in the metric of the springs and the passive metric, shape (p, c).
        free: Orthonormal basis of the motion that neither loops nor springs resist, shape (p, d).
        compliance: Inverse of K on the motion that the loops leave free, shape (p, p).
        left_null: Orthonormal rows that span the left null space of J_Cp, shape (r, c).
    """

    gain: Array
    closing: Array
    free: Array
    compliance: Array
    left_null: Array


def passive_motion(system: Partition) -> PassiveMotion:
    """Return the passive motion per active rate, eq. (10).

    Of the motion that the loops leave free, the part that springs resist minimizes their energy
    theta^T K theta / 2. The rest is self-motion and has the least norm in the passive metric.
    """
    J_C, (_, active, _, moving, *_) = system.J_C, system.joints
    c, p, n = len(J_C), len(moving), len(active)
    if not c and system.is_rigid:
        return PassiveMotion(none((p, n)), none((p, 0)), identity(p), none((p, p)), none((0, 0)))
    if c >= p:
        M, columns = np.empty((c + 1, p + n + c)), (pointer(system.joints.order), p, n, True)
        rows = pointer(np.ascontiguousarray(J_C))
        inverse = lib.close_loops(rows, c, J_C.shape[1], *columns, pointer(M))
        if loop_threshold(system.geometry) * norm(J_C) * inverse < 1.0:
            gain, closing = np.ascontiguousarray(M[:p, p : p + n]), M[:p, p + n :]
            return PassiveMotion(gain, closing, none((p, 0)), none((p, p)), M[p:c, p + n :])
    J_Cp = J_C.take(moving, 1)
    U, sigma, Vt = whole_svd(J_Cp)
    rank = p - int(system.rigid.freedom)
    # With a tolerance of zero, singular values that count may be zero.
    sigma = np.maximum(sigma[:rank], np.finfo(float).eps * norm(J_Cp))
    closing = (Vt[:rank].T / sigma) @ U[:, :rank].T
    gain, free, compliance = -closing.dot(J_C.take(active, 1)), Vt[rank:].T, none((p, p))
    if system.stiffness is not None:
        count = int(system.elastic.freedom)
        compliance, free = _compliance(free, system.stiffness, moving, count)
        gain, closing = _least_energy(gain, closing, compliance, system.stiffness, moving, active)
    if system.passive_metric is not None:
        count = int(system.weighed.freedom)
        inverse, _ = _compliance(free, system.passive_metric, moving, count)
        gain, closing = _least_energy(gain, closing, inverse, system.passive_metric, moving, active)
    return PassiveMotion(gain, closing, canonical(free), compliance, U[:, rank:].T)


def _compliance(free: Array, K: Array, moving: Indices, count: int) -> tuple[Array, Array]:
    """Return K^-1 on free motion (p, p), and a basis of the `count` unresisted motions."""
    resisted = free.shape[1] - count
    _, sigma, Vt = np.linalg.svd(free.T @ K[np.ix_(moving, moving)] @ free)
    directions = free @ Vt[:resisted].T
    return (directions / sigma[:resisted]) @ directions.T, free @ Vt[resisted:].T


def _least_energy(
    gain: Array, closing: Array, compliance: Array, K: Array, moving: Indices, active: Indices
) -> tuple[Array, Array]:
    """Shift passive rates per active rate, and J_Cp^+, along free motion to the least energy."""
    K_pp, K_pa = K[np.ix_(moving, moving)], K[np.ix_(moving, active)]
    return gain - compliance @ (K_pp @ gain + K_pa), closing - compliance @ (K_pp @ closing)


def regular_motion(system: Partition, motion: PassiveMotion) -> TaskMotion:
    """Return the task motion if loops determine all passive joints and tie no active ones."""
    geometry, (_, active, _, moving, *_) = system.geometry, system.joints
    (N, n), closing = (geometry.J_T.shape[1], len(active)), None
    velocities, is_moving = np.zeros((N, n)), np.zeros(N, dtype=bool)
    velocities[active, np.arange(n)], is_moving[moving] = 1.0, True
    velocities[moving] = motion.gain
    if geometry.closure_error is not None:
        closing = geometry.task[:, moving] @ motion.closing
    return TaskMotion(
        geometry=geometry,
        actuated=active,
        velocities=velocities,
        admissible=identity(n),
        self_motion=none((N, 0)),
        closing=closing,
        moving=is_moving,
        gap_of_motions=partial(_gap, system),
    )


def _gap(system: Partition) -> Array:
    return system.motions.gap
