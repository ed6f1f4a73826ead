"""Kinematics and velocity mappings of one mechanism at a batch of postures."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from argument_checks import Array, Indices
from prioritized._kinematics import Kinematics
from prioritized._mapping.task import task_selection
from prioritized._mapping.velocity import VelocityMapping
from prioritized._mapping.velocity_arguments import velocity_mapping
from prioritized._solver.arrays import apply, read_only, transposed


@dataclass(frozen=True, eq=False)
class Postures:
    """Kinematics of a mechanism with the same failures at a batch of postures.

    Created by :meth:`prioritized.ConstrainedSystem.postures`; the results equal those of single
    postures. Arrays are read-only and computed when first used; their leading axes (...) are those
    of the batch. Of N velocities n have actuators, q of which failed.

    Attributes:
        kinematics: Kinematics of every posture, in the order of a flattened batch.
        lead: Lengths of the batch axes.
    """

    kinematics: tuple[Kinematics, ...]
    lead: tuple[int, ...]

    @property
    def actuators(self) -> Indices:
        """Surviving actuators in nominal numbering, shape (n - q,)."""
        return self.kinematics[0].actuators

    @cached_property
    def J(self) -> Array:
        """Task Jacobian, eq. (14), shape (..., m, n - q)."""
        return self._stack([kin.J for kin in self.kinematics])

    @cached_property
    def active_constraint(self) -> Array:
        """Orthonormal rows, eq. (17), padded with zero rows, shape (..., r, n - q)."""
        return self._stack(_filled([kin.active_constraint for kin in self.kinematics]))

    @cached_property
    def self_motion(self) -> Array:
        """Basis of the task motion with active joints locked, zero-padded, shape (..., m, k)."""
        return transposed(self._stack(_filled([kin.self_motion.T for kin in self.kinematics])))

    @cached_property
    def passive_gain(self) -> Array:
        """Passive rates per active rate, eq. (10), shape (..., N - n + q, n - q)."""
        return self._stack([kin.passive_gain for kin in self.kinematics])

    def passive_rates(self, rates: ArrayLike) -> Array:
        """Return the rates of :meth:`prioritized.Kinematics.passive_rates`, (..., N - n + q).

        Args:
            rates: Rates of the survivors, shape (n - q,) or (..., n - q), one for each posture.
        """
        return apply(self.passive_gain, "rates", rates)

    def velocities(self, rates: ArrayLike) -> Array:
        """Return all velocities for rates in the order of J_T's columns, shape (..., N)."""
        return self.kinematics[0].system.joints.together(rates, self.passive_rates(rates))

    def velocity_mapping(
        self,
        major: Sequence[int] | ArrayLike,
        secondary: Sequence[int] | ArrayLike | None = None,
        joint_weight: ArrayLike | None = None,
        secondary_weight: ArrayLike | None = None,
    ) -> VelocityMapping:
        """Return one mapping for all postures, with the rank decisions of each posture.

        The arguments are those of :meth:`prioritized.Kinematics.velocity_mapping`; limits are set
        by :meth:`prioritized.VelocityMapping.with_limits`. The gap is that of the mapping alone,
        the status holds for all postures; `kinematics` has the gap of each mechanism.

        Args:
            major: Task rows of the major task, or a matrix of directions (m1, m).
            secondary: Secondary task, as for :func:`prioritized.velocity_mapping`.
            joint_weight: W1, of all n actuators or the survivors; a matrix may be a batch.
            secondary_weight: W2; a matrix may be a batch.
        """
        first, reduced = self.kinematics[0], [kin._reduced for kin in self.kinematics]
        units = reduced[0]  # the mechanism's own, at every posture
        S_m, S_s = task_selection(major, secondary, self.J.shape[-2])
        M = units.measure(S_m).metric
        J, scale = zip(*(kin.truncated_jacobian(S_m, S_s, M) for kin in reduced), strict=True)
        W1, natural = first._survivors.matrix("joint_weight", joint_weight), self._stack(J)
        mapping = velocity_mapping(natural, major, secondary, W1, secondary_weight, major_metric=M)
        return mapping._in_natural_units(
            units.task_units,
            units.mixed_units,
            J=natural,
            scale=self._stack(scale),
            active_constraint=self._stack(_filled([kin.constraint for kin in reduced])),
            self_motion=transposed(self._stack(_filled([kin.self_motion.T for kin in reduced]))),
        )

    def _stack(self, arrays: Array | Sequence[Array | float]) -> Array:
        """Stack one array of each posture, all of shape (i, ...), to shape (..., i, ...)."""
        stack = np.array(arrays)
        return read_only(stack.reshape((*self.lead, *stack.shape[1:])))


def _filled(rows: list[Array]) -> Array:
    """Stack matrices in one array, padding those that have fewer rows with zeros."""
    filled = np.zeros((len(rows), max(map(len, rows)), rows[0].shape[1]))
    for row_block, A in zip(filled, rows, strict=True):
        row_block[: len(A)] = A
    return filled
