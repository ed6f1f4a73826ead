"""General constrained multibody systems and their actuator failures, sections 2.1 and 2.3."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import prod
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

import argument_checks as check
from argument_checks import Array, Indices
from prioritized._kinematics import Kinematics
from prioritized._mechanism.elimination import Joints, Partition, sort_joints
from prioritized._mechanism.failures import Failures, failed_actuators, stuck_passive
from prioritized._mechanism.from_model import Mechanism, accuracy_of, arguments_of, tolerance_of
from prioritized._mechanism.geometry import ACCURACY_PARTS, Accuracy, Geometry, TransferredAccuracy
from prioritized._mechanism.names import (
    Aliases,
    HasNames,
    Names,
    actuator_aliases,
    checked_names,
    count_phrase,
    passive_joints,
    velocity_aliases,
)
from prioritized._postures import Postures
from prioritized._solver.arrays import read_only
from prioritized._solver.rank import norm


@dataclass(frozen=True, eq=False, init=False)
class ConstrainedSystem:
    """Constrained multibody system v = J_T theta_dot with J_C theta_dot = 0, eqs. (2) and (3).

    J_C is None for a serial arm, and its rows may be redundant.

    Attributes:
        J_T: Task Jacobian of all generalized velocities, shape (m, N).
        J_C: Constraint Jacobian, shape (c, N).
        active: Velocity indices of the n actuated joints, in actuator order.
        rank_tolerance: Singular values below this fraction of the scale of J_T and J_C are zero.
        stiffness: K of the joint springs, shape (N, N), or None for a rigid mechanism.
        failures: Failed actuators and stuck joints, see :meth:`with_failures`.
        names: Names of joints and actuators, or None.
        geometry_accuracy: Accuracy of J_T and J_C [rad, or relative length], or None.
        accuracy: Error bounds of the entries of J_T and J_C, and natural units, or None.
    """

    J_T: Array
    J_C: Array
    active: Indices
    rank_tolerance: float
    stiffness: Array | None
    failures: Failures
    names: Names | None
    geometry_accuracy: float | None
    accuracy: Accuracy | None

    def __init__(
        self,
        J_T: ArrayLike,
        J_C: ArrayLike | None,
        active: Sequence[int] | ArrayLike,
        rank_tolerance: float | None = None,
        stiffness: ArrayLike | None = None,
        failures: Failures | None = None,
        *,
        names: HasNames | None = None,
        geometry_accuracy: float | None = None,
        accuracy: Accuracy | None = None,
    ) -> None:
        """Store read-only copies of the Jacobians.

        With springs the mechanism is quasi-static and elastic: motion that the loops leave free
        minimizes the potential energy theta^T K theta / 2. Springs of active joints have an effect
        only after a torque failure.

        Args:
            J_T: Task Jacobian, shape (m, N).
            J_C: Constraint Jacobian, shape (c, N); None is no constraint.
            active: Velocity index of each of the n actuators.
            rank_tolerance: Fraction of the inputs' scale below which singular values are zero; None
                is :data:`RANK_TOLERANCE`, which allows for round-off alone.
            stiffness: K, diagonal (N,) or symmetric positive semidefinite (N, N); None is rigid.
            failures: Initial failures; None is a healthy mechanism. They are preserved by
                `dataclasses.replace(system, J_T=..., J_C=...)`, the same mechanism at another pose.
            names: `names.velocities` are N strings, `names.actuators` n tuples of strings, as in
                :class:`prioritized._mechanism.names.Names`; None is a mechanism without names.
            geometry_accuracy: Largest error of a joint axis [rad] or of a length, relative. Given
                instead of `rank_tolerance`, which it sets to ten times its own value.
            accuracy: Errors of the entries, in the unit of each, and natural units, as a
                :class:`prioritized._mechanism.geometry.Accuracy`; None is round-off alone and units
                of 1.

        Raises:
            TypeError: `names` or `failures` has the wrong type.
            ValueError: An argument has a wrong shape or index or is not finite, or both
                    accuracy and tolerance are given.
        """
        task = _copy("J_T", J_T)
        N = task.shape[1]
        fields = {
            "J_T": task,
            "J_C": _copy("J_C", np.zeros((0, N)) if J_C is None else J_C, N),
            "active": check.frozen(check.indices("active", active, N)),
            "stiffness": _metric("stiffness", stiffness, N),
            "rank_tolerance": tolerance_of(rank_tolerance, geometry_accuracy),
            "geometry_accuracy": None if geometry_accuracy is None else float(geometry_accuracy),
        }
        if accuracy is not None:
            check.attributes("accuracy", accuracy, *ACCURACY_PARTS)
        fields["accuracy"] = accuracy
        fields["names"] = None if names is None else checked_names(names, N, len(fields["active"]))
        for name, value in (fields | {"failures": Failures()}).items():
            object.__setattr__(self, name, value)
        if failures is not None:
            check.instance("failures", failures, Failures)
            failed = self.with_failures(failures.locked, failures.free, failures.locked_passive)
            object.__setattr__(self, "failures", failed.failures)

    @classmethod
    def of(
        cls, mechanism: Mechanism, springs: bool = False, *, geometry_accuracy: float | None = None
    ) -> "ConstrainedSystem":
        """Return the system of a mechanism read from a model, such as `sim.jacobians(...)`.

        Args:
            mechanism: Object with J_T, J_C and active, and optionally names, stiffness and
                geometry_accuracy, each as in the constructor.
            springs: Whether to include the joint springs of the mechanism.
            geometry_accuracy: As in the constructor; None is that of the mechanism, if it has one.

        Raises:
            TypeError: The mechanism has no J_T, J_C or active, or `springs` is not a bool.
            ValueError: `springs` is set but the mechanism has no stiffness, or an array is invalid.
        """
        return cls(**arguments_of(mechanism, springs, geometry_accuracy))

    def with_failures(
        self,
        locked: Iterable[int | str] = (),
        free: Iterable[int | str] = (),
        locked_passive: Iterable[int | str] = (),
    ) -> "ConstrainedSystem":
        """Return the mechanism with further failures, section 2.3 of the paper.

        Repeating a failure changes nothing. A later lock overrides free: a free actuator may still
        jam. State a linear actuator that locks when it loses its force (footnote 1) as locked.

        Args:
            locked: Actuators whose position is stuck (position failure): numbers, names of
                actuators or of the joints that they drive, or the names in `str(system)`.
            free: Actuators that exert no torque (torque failure, free-swinging), in the same form.
                Where several drive one joint, all of them fail.
            locked_passive: Passive joints that are stuck: velocity indices, or names of joints,
                which stand for all their velocities.

        Raises:
            ValueError: An index is out of range, a name is unknown or ambiguous, or an actuator is
                both locked and free in one call.
        """
        lock, release = failed_actuators(
            locked, free, self._actuator_aliases, passive_joints(self.names, self.active)
        )
        stuck = stuck_passive(locked_passive, self._velocity_aliases, self.active)
        return self._changed(failures=self.failures.and_also(lock, release, stuck))

    def at(self, J_T: ArrayLike | None = None, J_C: ArrayLike | None = None) -> "ConstrainedSystem":
        """Return the same mechanism with the same failures at another pose.

        Both Jacobians must be evaluated with closed loops, as after `sim.assemble`. The accuracy is
        carried over from the first pose: each entry gets the largest error of its column in rows of
        the same unit. With a model, use :meth:`at_pose` to update it.

        Args:
            J_T: Task Jacobian at that pose, shape (m, N); None: unchanged.
            J_C: Constraint Jacobian at that pose, with any number of rows; None: unchanged.
        """
        (m, N), poses = self.J_T.shape, {}
        if J_T is not None:
            poses["J_T"] = _copy("J_T", J_T, N, m)
        if J_C is not None:
            poses["J_C"] = _copy("J_C", J_C, N)
        if self.accuracy is not None:
            rows = len(poses.get("J_C", self.J_C))
            poses["accuracy"] = TransferredAccuracy.of(self.accuracy, rows)
        return self._changed(**poses)

    def at_pose(self, mechanism: Mechanism) -> "ConstrainedSystem":
        """Return the system with the Jacobians and accuracy of the mechanism at another pose.

        Args:
            mechanism: Object as for :meth:`of`, with the same velocities and task rows.
        """
        check.attributes("mechanism", mechanism, "J_T", "J_C")
        system, accuracy = self.at(mechanism.J_T, mechanism.J_C), accuracy_of(mechanism)
        return system if accuracy is None else system._changed(accuracy=accuracy)

    def postures(self, J_T: ArrayLike, J_C: ArrayLike | None = None) -> Postures:
        """Return the kinematics of the mechanism with the same failures at a batch of postures.

        Each posture has the results and rank decisions of `at(J_T[k], J_C[k]).kinematics()`.

        Args:
            J_T: Task Jacobians, shape (..., m, N).
            J_C: Constraint Jacobians, shape (..., c, N); None is that of this system for all.

        Raises:
            ValueError: An argument has a wrong shape or is not finite, or the batch is empty.
        """
        m, N = self.J_T.shape
        tasks = check.array("J_T", J_T, ..., m, N, copy=True)
        loops = self.J_C if J_C is None else check.array("J_C", J_C, ..., None, N, copy=True)
        lead = check.common_axes({"J_T": tasks.shape[:-2], "J_C": loops.shape[:-2]})
        if 0 in lead:
            raise ValueError(f"J_T and J_C must hold at least one posture, got batch axes {lead}")
        flat = [
            np.broadcast_to(A, (*lead, *A.shape[-2:])).reshape(prod(lead), *A.shape[-2:])
            for A in (tasks, loops)
        ]
        kinematics = (self.at(*pair).kinematics() for pair in zip(*flat, strict=True))
        return Postures(tuple(kinematics), lead)

    def _changed(self, **changes: Any) -> "ConstrainedSystem":
        other = object.__new__(ConstrainedSystem)
        other.__dict__.update(self.__dict__)
        if "failures" in changes:
            other.__dict__.pop("_joints", None)
        else:
            other.__dict__.pop("geometry", None)
            other.__dict__["_joints"] = self._joints  # of every pose, sorted once
        other.__dict__.update(changes)
        return other

    @property
    def stuck(self) -> Indices:
        """Velocity indices of all joints whose rate is zero, actuated or not, ascending."""
        # Section 2.3.2: a locked joint is a passive joint whose rate is zero.
        locked = self.active[sorted(self.failures.locked)].tolist()
        return np.array(sorted({*locked, *self.failures.locked_passive}), dtype=np.intp)

    def kinematics(self, passive_metric: ArrayLike | None = None) -> Kinematics:
        """Return differential kinematics and statics of the surviving actuators, eqs. (12) to (17).

        Args:
            passive_metric: M, diagonal (N,) or symmetric positive semidefinite (N, N). Self-motion
                leaves the passive rates undetermined; the ones that minimize theta_dot^T M
                theta_dot are chosen. None is the identity, with rates of hinges in rad/s and of
                slides in mechanism lengths/s; the mass matrix gives the motion of a frictionless
                machine that starts from rest.
        """
        both = self.stiffness, _metric("passive_metric", passive_metric, self.J_T.shape[1])
        springs = (None if K is None else self.geometry.stiffness(K) for K in both)
        return Kinematics(Partition(self.geometry, self._joints, *springs), self.names)

    @cached_property
    def geometry(self) -> Geometry:
        """J_T and J_C in natural units, with the rank decisions that do not depend on failures."""
        is_stated = self.geometry_accuracy is not None
        return Geometry(self.J_T, self.J_C, self.rank_tolerance, self.accuracy, is_stated)

    def __repr__(self) -> str:
        """Return a one-line summary for interactive use."""
        return f"<ConstrainedSystem of {self}>"

    def __str__(self) -> str:
        failures = self.failures.describe(self._actuator_aliases, self._velocity_aliases)
        velocities = count_phrase(self.J_T.shape[1], "velocity", "velocities")
        constraints = count_phrase(len(self.J_C), "constraint", "constraints")
        actuators = count_phrase(len(self.active), "actuator", "actuators")
        return f"{velocities}, {constraints}, {actuators}: {failures}."

    @cached_property
    def _actuator_aliases(self) -> Aliases:
        return actuator_aliases(self.names, self.active)

    @property
    def _velocity_aliases(self) -> Aliases:
        return velocity_aliases(self.names, self.J_T.shape[1])

    @cached_property
    def _joints(self) -> Joints:
        n, failed = len(self.active), self.failures.locked | self.failures.free
        actuators = np.array([k for k in range(n) if k not in failed], dtype=np.intp)
        return sort_joints(self.active, actuators, self.stuck, self.J_T.shape[1])


def _copy(
    name: str, value: ArrayLike, columns: int | None = None, rows: int | None = None
) -> Array:
    """Return a read-only, C-contiguous copy of one finite matrix."""
    if (  # the common case, at every tick
        check.is_plain(value)
        and value.ndim == 2
        and (columns is None or value.shape[1] == columns)
        and (rows is None or len(value) == rows)
    ):
        size = norm(value)
        if check.SMALLEST <= size < check.LARGEST or size == 0.0:
            return read_only(value.copy())
    A = check.array(name, value, ..., rows, columns)
    if A.ndim != 2:
        raise ValueError(
            f"{name} must be one matrix, got shape {A.shape}: ConstrainedSystem.postures takes many"
        )
    return read_only(A.copy())


def _metric(name: str, value: ArrayLike | None, size: int) -> Array | None:
    if value is None:
        return None
    return check.frozen(check.weight(name, value, size, semidefinite=True))
