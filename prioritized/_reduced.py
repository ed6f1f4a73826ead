"""What is left of a mechanism once its passive joints are eliminated: eqs. (6) to (17)."""

from dataclasses import dataclass
from functools import cached_property
from math import sqrt

import numpy as np

from argument_checks import Array, Indices
from prioritized._arrays import none, read_only
from prioritized._elimination import Joints, PassiveMotion, Task, passive_motion
from prioritized._rank import RankedSvd, norm, ranked_svd


@dataclass(frozen=True, eq=False)
class Reduced:
    """A mechanism without its passive joints, eqs. (6) to (17).

    All arrays are read-only, and worked out when they are first asked for.

    Attributes:
        task: Task Jacobian by joints; `J_C`: constraint Jacobian, shape (c, N).
        joints: Which velocities are active, passive and stuck.
        stiffness: K of the joint springs, shape (N, N); None is a rigid mechanism.
        passive_metric: Whose norm self-motion is the least of, shape (N, N); None is the plain one.
        rank_tolerance: See the rank decision.
    """

    task: Task
    J_C: Array
    joints: Joints
    stiffness: Array | None
    passive_metric: Array | None
    rank_tolerance: float

    @property
    def actuators(self) -> Indices:
        """Surviving actuators in nominal numbering, shape (n - q,)."""
        return self.joints.actuators

    @property
    def active(self) -> Indices:
        """Their velocity indices, shape (n - q,)."""
        return self.joints.active

    @property
    def passive(self) -> Indices:
        """Velocity indices of all others, failed ones too, shape (N - n + q,)."""
        return self.joints.passive

    @property
    def actuator_count(self) -> int:
        """Nominal number n of actuators."""
        return self.joints.actuator_count

    @property
    def J(self) -> Array:
        """Task Jacobian, eq. (14), shape (m, n - q)."""
        return self._seen[0]

    @property
    def scale(self) -> float:
        """Size of the terms whose difference is J; its rank is decided against it."""
        return self._seen[1]

    @cached_property
    def _seen(self) -> tuple[Array, float]:
        task, gain = self.task, self._motion.gain
        # Passive joints that the task does not see, however fast, make the scale no larger.
        through = task.moving_squared.dot(np.add.reduce(gain * gain, 1))
        return read_only(task.active + task.moving.dot(gain)), task.size + sqrt(through)

    @cached_property
    def self_motion(self) -> Array:
        """Orthonormal basis of the task motion that remains with every active joint held.

        Unstable singularity, shape (m, k).
        """
        drift = ranked_svd(self.task_drift, 1.0, self.rank_tolerance)
        return read_only(drift.U[:, : int(drift.rank)])

    @cached_property
    def internal_force(self) -> Array:
        """Orthonormal rows spanning the left null space of J_Cp, shape (r, c).

        c counts the rows of J_C and then one for each stuck joint, by velocity index.
        """
        rows = self._internal_rows
        return read_only(np.linalg.qr(rows.T)[0].T if self.joints.stuck.size else rows.copy())

    @property
    def active_constraint(self) -> Array:
        """Orthonormal rows; admissible active rates are their null space, eq. (17), (r', n - q)."""
        if not len(self._motion.loops.left_null):
            return none((0, len(self.active)))
        return read_only(self._bound.Vt[: int(self._bound.rank)])

    @cached_property
    def passive_gain(self) -> Array:
        """Rates of the passive joints per active rate, eq. (10), shape (N - n + q, n - q)."""
        return read_only(self.joints.among_passive(self._motion.gain))

    @cached_property
    def passive_drift(self) -> Array:
        """Orthonormal basis of the passive motion with every active joint held.

        Shape (N - n + q, d); zero rows at stuck joints.
        """
        return read_only(self.joints.among_passive(self._motion.free))

    @property
    def task_drift(self) -> Array:
        """Its task motion J_Tp J~_Cp as a fraction of the size of J_T, shape (m, d)."""
        if not self._motion.free.shape[1]:
            return none((len(self.task.J_T), 0))
        return read_only(self.task.moving.dot(self._motion.free) / (self.task.size or 1.0))

    @cached_property
    def constraint_gain(self) -> Array:
        """Constraint forces per task force, eq. (11) without its free part, shape (c, m)."""
        joints, J_T, J_C = self.joints, self.task.J_T, self.J_C
        f_C = -self._motion.closing.T @ self.task.moving.T
        # A stuck joint's reaction balances what f, f_C and springs put on it, eq. (9).
        reaction = -J_T[:, joints.stuck].T - J_C[:, joints.stuck].T @ f_C
        reaction += self._spring_load(joints.stuck)
        gain = np.vstack([f_C, reaction])
        least = self.internal_force.T @ (self.internal_force @ gain)
        return read_only(gain - least)

    @cached_property
    def torque_gain(self) -> Array:
        """The torques that go with it, shape (n - q, m)."""
        f_C = self.constraint_gain[: len(self.J_C)]
        gain = self.task.active.T + self.J_C[:, self.active].T @ f_C
        return read_only(gain - self._spring_load(self.active))

    @cached_property
    def internal_gain(self) -> Array:
        """Internal force eta of eq. (11) for what torques differ from these, shape (r, n - q)."""
        back = self._bound.pseudo_inverse().T
        return read_only(self.internal_force @ self._internal_rows.T @ back)

    @cached_property
    def loop_gap(self) -> float:
        """Gap of the rank of J_Cp."""
        return self._motion.loops.gap()

    @cached_property
    def constraint_gap(self) -> float:
        """Gap of the rank of the active constraint."""
        return float(self._bound.gap)

    @property
    def spring_gap(self) -> float:
        """Gap of what springs hold and the passive metric weighs; infinite without them."""
        return self._motion.spring_gap

    @property
    def gap(self) -> float:
        """Smallest gap of the rank decisions that J and its constraints rest on."""
        return min(self.loop_gap, self.constraint_gap, self.spring_gap)

    @cached_property
    def _motion(self) -> PassiveMotion:
        return passive_motion(
            self.J_C, self.joints, self.stiffness, self.passive_metric, self.rank_tolerance
        )

    @cached_property
    def _bound(self) -> RankedSvd:
        left = self._motion.loops.left_null @ self.J_C[:, self.active]
        return ranked_svd(left, norm(self.J_C), self.rank_tolerance)

    @cached_property
    def _internal_rows(self) -> Array:
        """Left null space of [J_C; E] without the active columns: E's share balances the rest."""
        left = self._motion.loops.left_null
        return np.hstack([left, -left @ self.J_C[:, self.joints.stuck]])

    def _spring_load(self, held: Indices) -> Array:
        """What springs put on held joints as a task force moves the others, per task force."""
        if self.stiffness is None:
            return np.zeros((len(held), len(self.task.J_T)))
        moving = self.joints.moving
        stretch = self._motion.give @ self.task.moving.T
        return self.stiffness[np.ix_(held, moving)] @ stretch
