"""Classification of all failure conditions of a mechanism in one vectorized call."""

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

import argument_checks as check
from argument_checks import Array, Mask
from prioritized._analysis.major_maps import unweighted
from prioritized._analysis.worst import ActuatorLimits
from prioritized._mapping.problem import Problem
from prioritized._mapping.task import task_selection
from prioritized._mechanism.decisions import MajorTask, respanned
from prioritized._mechanism.failures import Failures, failed_actuators
from prioritized._mechanism.motions import Motions, motions_of, with_stiffness
from prioritized._mechanism.names import Aliases, actuator_aliases
from prioritized._mechanism.task_motion import TaskMotion
from prioritized._solver.arrays import ReadOnly, transposed
from prioritized._solver.canonical import canonical
from prioritized._system import ConstrainedSystem

HEALTHY, LOCKED, FREE = 0, 1, 2

MOST_ACTUATORS = 10
"""Largest number of actuators for which all 3^n conditions are classified, bounded by memory."""


@dataclass(frozen=True, eq=False)
class Classes(ReadOnly):
    """Classification of C failure conditions, one in each row of all arrays.

    The flags are those of :class:`prioritized.Manipulability`.

    Attributes:
        possible: Whether the major task is still possible: fully reachable and not moved by any
            self-motion.
        gains: Major speeds per unit norm of the admissible active rates in the principal
            directions, descending, zero for unreachable directions, shape (C, m1). Where the major
            task is unstable, passive joints follow with the least norm.
        major_rank: Dimension of the space of reachable major velocities.
        secondary_rank: Dimension of the secondary velocities reachable with the major task at rest.
        lost_secondary: Orthonormal basis of the unreachable secondary velocities, columns padded
            with zeros, shape (C, m2, m2).
        self_motion: Orthonormal basis of the task self-motion, columns padded with zeros, shape (C,
            m, .).
        gap: Smallest gap of the rank decisions of the classification.
        worst_speed: Remaining major speed in the worst direction within the `rate_limits`, the
            radius of :meth:`prioritized.Kinematics.attainable`; zero where the task is not
            possible. None without limits.
        worst_force: Remaining major force in the worst direction within the `torque_limits`, the
            radius of :meth:`prioritized.Kinematics.attainable_force`; infinite where the structure
            bears every major force. None without limits.
    """

    possible: Mask
    unmanipulable: Mask
    unmanipulable_task: Mask
    unstable: Mask
    unstable_major: Mask
    irresolvable: Mask
    constrained_active: Mask
    gains: Array
    major_rank: NDArray[np.intp]
    secondary_rank: NDArray[np.intp]
    lost_secondary: Array
    self_motion: Array
    gap: Array
    worst_speed: Array | None
    worst_force: Array | None

    @property
    def worst_gain(self) -> Array:
        """Least gain of each condition, (C,); zero if unreachable, infinite without major rows."""
        return self.gains.min(axis=1, initial=np.inf)


@dataclass(frozen=True, eq=False)
class FailureAtlas(Classes):
    """Classification of failure conditions of a mechanism by rigid kinematics.

    Attributes:
        codes: Condition of each actuator, 0 healthy, 1 locked, 2 free, shape (C, n).
        elastic: Classification with the joint springs of the system; None without springs.
        actuator_names: Accepted names of each actuator, as in its system.
    """

    codes: NDArray[np.int8]
    elastic: Classes | None
    actuator_names: Aliases

    def describe(self, row: int) -> str:
        """Return the condition of a row as text, such as "knee locked, hip free", or "healthy".

        Failures that the system already had are not included.
        """
        condition = self.codes[check.integer("row", row, len(self.codes))]
        failed = (np.flatnonzero(condition == code).tolist() for code in (LOCKED, FREE))
        return Failures(*map(frozenset, failed)).describe(self.actuator_names, ())

    def row(self, locked: Iterable[int | str] = (), free: Iterable[int | str] = ()) -> int:
        """Return the row of the condition with exactly these failures; actuators by number or name.

        Raises:
            ValueError: The atlas lacks this condition, or an actuator is both locked and free.
        """
        condition = np.zeros(self.codes.shape[1], dtype=np.int8)
        lock, release = failed_actuators(locked, free, self.actuator_names)
        condition[sorted(lock)] = LOCKED
        condition[sorted(release)] = FREE
        matches = np.flatnonzero((self.codes == condition).all(axis=1))
        if not matches.size:
            failures = Failures(lock, release).describe(self.actuator_names, ())
            raise ValueError(f"locked and free must be in codes of the atlas, got {failures}")
        return int(matches[0])


def failure_atlas(
    system: ConstrainedSystem,
    major: Sequence[int] | ArrayLike,
    secondary: Sequence[int] | ArrayLike | None = None,
    codes: ArrayLike | None = None,
    *,
    rate_limits: tuple[ArrayLike, ArrayLike] | None = None,
    torque_limits: tuple[ArrayLike, ArrayLike] | None = None,
) -> FailureAtlas:
    """Classify every combination of healthy, locked and free actuators in one vectorized call.

    The loops are eliminated once; each condition is then a small problem in the motions that they
    admit. The result equals `system.with_failures(...).kinematics().manipulability(major)` of each
    condition, including the rank decisions. This is efficient for few degrees of freedom: with a
    hundred, classifying one condition after the other is faster.

    Args:
        system: The mechanism; failures it already has are part of every condition.
        major: Task rows of the major task, or a matrix of directions (m1, m).
        secondary: Secondary task, as for :func:`prioritized.velocity_mapping`.
        codes: Conditions to classify, 0 healthy, 1 locked, 2 free, shape (C, n); None is all 3^n,
            with the last actuator's code changing fastest.
        rate_limits: Lower and upper limits of the rates for `worst_speed`: numbers, (n,), or (C, n)
            with a row for each condition; None skips `worst_speed`.
        torque_limits: Limits of the torques for `worst_force`, of the same shapes.

    Raises:
        ValueError: Invalid rows, codes or limits, or more than ten actuators without codes.
    """
    n = len(check.instance("system", system, ConstrainedSystem).active)
    S_m, S_s = task_selection(major, secondary, system.J_T.shape[0])
    conditions = _conditions(codes, n)
    existing = system.failures
    locked, free = conditions == LOCKED, conditions == FREE
    locked[:, sorted(existing.locked)] = True
    free[:, sorted(existing.free)] = True
    active, units = ~locked & ~free, system.geometry.velocity_units[system.active]
    limits = ActuatorLimits(
        active,
        _limits("rate_limits", rate_limits, active.shape, 1.0 / units),
        _limits("torque_limits", torque_limits, active.shape, units),
    )
    stuck = np.array(sorted(existing.locked_passive), dtype=np.intp)
    motions = motions_of(system.geometry, system.active, stuck, (locked, active))
    rigid = _classes(motions, MajorTask(TaskMotion.of(motions, system.active), S_m, S_s), limits)
    elastic = None
    if system.stiffness is not None:
        elastic_motions = with_stiffness(motions, system.geometry.stiffness(system.stiffness))
        task = MajorTask(TaskMotion.of(elastic_motions, system.active), S_m, S_s)
        elastic = _classes(elastic_motions, task, limits)
    return FailureAtlas(
        **vars(rigid),
        codes=conditions,
        elastic=elastic,
        actuator_names=actuator_aliases(system.names, system.active),
    )


def _conditions(codes: ArrayLike | None, n: int) -> NDArray[np.int8]:
    if codes is None:
        if n > MOST_ACTUATORS:
            raise ValueError(f"codes must be given for {n} actuators, more than {MOST_ACTUATORS}")
        return np.array(list(itertools.product((HEALTHY, LOCKED, FREE), repeat=n)), dtype=np.int8)
    listed = check.array("codes", codes, None, n)
    if (strange := listed[~np.isin(listed, (HEALTHY, LOCKED, FREE))]).size:
        raise ValueError(f"codes must be 0 (healthy), 1 (locked) or 2 (free), got {strange[0]:g}")
    return listed.astype(np.int8)


def _limits(
    name: str, value: tuple[ArrayLike, ArrayLike] | None, shape: tuple[int, ...], units: Array
) -> tuple[Array, Array] | None:
    """Return lower and upper limits of each condition times the units (n,), shape (C, n) each."""
    if value is None:
        return None
    lower, upper = check.limits(name, value, shape[1], batch=True)
    if lower.shape not in ((), shape[1:], shape):
        raise ValueError(
            f"{name} must be two numbers or of shape {shape[1:]} or {shape}, got {lower.shape}"
        )
    return np.broadcast_to(lower * units, shape), np.broadcast_to(upper * units, shape)


def _classes(motions: Motions, task: MajorTask, limits: ActuatorLimits) -> Classes:
    task_motion = task.task
    m1, m2 = len(task.S_m), len(task.S_s)
    decision, secondary, moved = task.decision, task.secondary, task_motion.moved
    geometry = task_motion.geometry
    possible = (decision.rank == m1) & (task.moved.rank == 0)
    moves = moved.U[..., : moved.significant.shape[1]] * moved.significant[:, None, :]
    self_motion = canonical(respanned(moves, geometry.task_units))
    lost = secondary.U * (np.arange(m2) >= secondary.rank[:, None])[:, None, :]
    gains = np.zeros((len(possible), m1))
    gains[:, : decision.sigma.shape[1]] = np.where(decision.significant, decision.sigma, 0.0)
    problem = _problem(motions, task)
    return Classes(
        possible=possible,
        unmanipulable=decision.rank < m1,
        unmanipulable_task=task_motion.decision.rank < len(geometry.J_T),
        unstable=moved.rank > 0,
        unstable_major=task.moved.rank > 0,
        irresolvable=motions.internal > 0,
        constrained_active=motions.constraints(limits.active.sum(axis=1)) > 0,
        gains=gains * task.measure.gain_unit,
        major_rank=decision.rank,
        secondary_rank=secondary.rank,
        lost_secondary=canonical(respanned(lost, 1.0 / task.secondary_units)),
        self_motion=self_motion,
        gap=np.minimum(task.gap, np.minimum(task_motion.decision.gap, moved.gap)),
        worst_speed=limits.speed(problem, possible),
        worst_force=limits.force(problem),
    )


def _problem(motions: Motions, task: MajorTask) -> Problem:
    """Return Problems 1 and 6 without weights, for rates in natural units."""
    task_motion, Z = task.task, motions.admissible
    forbidden = np.eye(len(task_motion.rate_units)) - Z @ transposed(Z)
    J, scale = task.truncated(task_motion.J, task_motion.scale(None), forbidden)
    moved = task_motion.moved
    Q = moved.U[..., : moved.significant.shape[1]] * moved.significant[:, None, :]
    return unweighted(J, task.S_m, forbidden, Q, scale).natural(task_motion.task_units, 1.0)
