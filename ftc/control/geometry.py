"""Models of a mechanism for the mapping, and its motion after actuator failures."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Protocol, TypeVar

import numpy as np

import argument_checks as check
from argument_checks import Array, Indices
from prioritized import ConstrainedSystem

Pose = TypeVar("Pose")


class Geometry(Protocol[Pose]):
    """Protocol of a mechanism without failures, as the mapping uses it; the pose type is free.

    `system` is the mechanism at the nominal pose, with its springs if it has any.
    """

    system: ConstrainedSystem

    @property
    def nominal(self) -> Pose:
        """Pose from which displacements are measured."""
        ...

    def jacobians(self, pose: Pose) -> Any:
        """Return an object with J_T (m, N) and J_C (c, N) of :attr:`system` at a pose.

        It may have their `accuracy`. A constant Jacobian is :attr:`system` itself.
        """

    def twist(self, pose: Pose, displacements: Array) -> Array:
        """Return the task displacement (m,) for small displacements (n,) without failures."""
        ...

    def moved(self, pose: Pose, displacements: Array) -> Pose:
        """Return the pose for displacements (n,), starting from the pose one tick before."""
        ...


class LocalGeometry:
    """Geometry linearized about the nominal pose of any mechanism; poses are twists (m,)."""

    def __init__(self, system: ConstrainedSystem) -> None:
        """Linearize the mechanism without failures about its nominal pose."""
        self.system = check.instance("system", system, ConstrainedSystem)
        self.nominal = np.zeros(len(system.J_T))
        self._J = system.kinematics().J

    def jacobians(self, pose: Array) -> ConstrainedSystem:
        """Return the linearized mechanism, whose Jacobians are constant."""
        return self.system

    def twist(self, pose: Array, displacements: Array) -> Array:
        """Return the task displacement (m,) for displacements (n,)."""
        return self._J @ displacements

    def moved(self, pose: Array, displacements: Array) -> Array:
        """Return the pose, a twist (m,), for displacements (n,)."""
        return self._J @ displacements


class MechanismModel(Protocol[Pose]):
    """Protocol of a controller's model of a mechanism without failures, such as `sim.Mechanism`.

    The posture type is free; a posture belongs to one set of joint positions.
    """

    @property
    def nominal(self) -> Pose:
        """Posture from which displacements are measured."""
        ...

    def jacobians(self, posture: Pose) -> Any:
        """Return an object with J_T (m, N), J_C (c, N), active (n,); see :class:`sim.Jacobians`."""

    def displacements(self, posture: Pose) -> Array:
        """Return the displacements (n,) of the actuators from the nominal posture."""
        ...

    def task(self, posture: Pose) -> Array:
        """Return the task coordinates (m,), with rates given by J_T near the nominal posture."""
        ...

    def moved(self, posture: Pose, displacements: Array, fixed: Indices, /) -> Pose:
        """Return the posture near this one at which the `fixed` actuators have displacements (n,).

        The entries of the other actuators are ignored: these actuators follow the loops.
        """
        ...


class MechanismGeometry:
    """:class:`Geometry` of a mechanism with the Jacobians of every posture."""

    def __init__(
        self, model: MechanismModel[Any], free: Sequence[int] = (), *, springs: bool = False
    ) -> None:
        """Wrap the model of a mechanism without failures.

        The positions of the `free` actuators, which exert no force, follow from the closed loops;
        with `springs`, joint springs determine the motions that the loops leave free.
        """
        self.model = check.attributes("model", model, "jacobians", "displacements", "task", "moved")
        self.nominal = model.nominal
        jacobians = model.jacobians(model.nominal)
        self.system = ConstrainedSystem.of(jacobians, check.flag("springs", springs))
        every = np.arange(len(self.system.active))
        self._driven = np.setdiff1d(every, check.indices("free", free, len(every)))

    def jacobians(self, pose: Any) -> Any:
        """Return the model's Jacobians at a posture."""
        return self.model.jacobians(pose)

    def twist(self, pose: Any, displacements: Array) -> Array:
        """Return the task displacement (m,) for small displacements (n,)."""
        return self.system.at_pose(self.model.jacobians(pose)).kinematics().J @ displacements

    def moved(self, pose: Any, displacements: Array) -> Any:
        """Return the posture for displacements (n,), starting from the posture one tick before."""
        return self.model.moved(pose, displacements, self._driven)


def without_springs(system: ConstrainedSystem, actuators: Sequence[int]) -> ConstrainedSystem:
    """Return the mechanism without the springs of these actuators."""
    if system.stiffness is None or not actuators:
        return system
    K, joints = system.stiffness.copy(), system.active[list(actuators)]
    K[joints, joints] = 0.0
    return replace(system, stiffness=K)


def without_unneeded_springs(system: ConstrainedSystem) -> ConstrainedSystem:
    """Return the mechanism, without its springs if the loops alone determine its motion."""
    if system.stiffness is None:
        return system
    rigid = replace(system, stiffness=None)
    return system if rigid.kinematics().self_motion.shape[1] else rigid


def free_actuators_follow(released: ConstrainedSystem) -> Array:
    """Return the displacements of all actuators per displacement of the driven ones, (n, n)."""
    kinematics, n = released.kinematics(), len(released.active)
    follow, driven = np.zeros((n, n)), kinematics.actuators
    follow[:, driven] = kinematics.velocities(np.eye(len(driven)))[:, released.active].T
    return follow


def induced_displacements(
    released: ConstrainedSystem, locked_at: Array, survivors: Indices
) -> Array:
    """Return the least displacements (n,) of the survivors that locked ones off centre require."""
    kinematics, induced = released.kinematics(), np.zeros(len(locked_at))
    C = kinematics.active_constraint
    if len(C) and locked_at.any():
        needed = C @ locked_at[kinematics.actuators]
        surviving_columns = C[:, np.isin(kinematics.actuators, survivors)]
        induced[survivors] = -np.linalg.pinv(surviving_columns) @ needed
    return induced
