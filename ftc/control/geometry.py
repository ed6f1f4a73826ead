"""Models of a mechanism for the mapping, and its motion when actuators fail."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Protocol, TypeVar

import numpy as np

import argument_checks as check
from argument_checks import Array, Indices
from prioritized import ConstrainedSystem

Pose = TypeVar("Pose")


class Geometry(Protocol[Pose]):
    """Mechanism without failures, as the mapping needs it; a pose is the client's own type.

    Its `system` is the mechanism at the nominal pose, with springs where there are any.
    """

    system: ConstrainedSystem

    @property
    def nominal(self) -> Pose:
        """The pose that displacements are measured from."""
        ...

    def jacobians(self, pose: Pose) -> Any:
        """An object with J_T (m, N) and J_C (c, N) of :attr:`system` at a pose.

        And with their `accuracy`, where that is known. Where the Jacobian is constant,
        :attr:`system` itself.
        """

    def twist(self, pose: Pose, displacements: Array) -> Array:
        """Task displacement (m,) of small displacements (n,) of the mechanism without failures."""
        ...

    def moved(self, pose: Pose, displacements: Array) -> Pose:
        """The pose to which displacements (n,) lead, from the pose one tick before."""
        ...


class LocalGeometry:
    """Any mechanism about its nominal pose, from its Jacobians alone; poses are twists (m,)."""

    def __init__(self, system: ConstrainedSystem) -> None:
        """Take the mechanism without failures at its nominal pose."""
        self.system = check.instance("system", system, ConstrainedSystem)
        self.nominal = np.zeros(len(system.J_T))
        self._J = system.kinematics().J

    def jacobians(self, pose: Array) -> ConstrainedSystem:
        """The mechanism itself."""
        return self.system

    def twist(self, pose: Array, displacements: Array) -> Array:
        """Task displacement (m,) of displacements (n,)."""
        return self._J @ displacements

    def moved(self, pose: Array, displacements: Array) -> Array:
        """The twist of displacements (n,)."""
        return self._J @ displacements


class MechanismModel(Protocol[Pose]):
    """A controller's own model of a mechanism without failures, such as `sim.Mechanism`.

    A posture is the model's own type, and belongs to one set of joint positions.
    """

    @property
    def nominal(self) -> Pose:
        """The posture that displacements are measured from."""
        ...

    def jacobians(self, posture: Pose) -> Any:
        """An object with J_T (m, N), J_C (c, N) and active (n,); see :class:`sim.Jacobians`."""

    def displacements(self, posture: Pose) -> Array:
        """Displacements of the actuators from the nominal posture, shape (n,)."""
        ...

    def task(self, posture: Pose) -> Array:
        """Task coordinates (m,), whose rates are J_T's near the nominal posture."""
        ...

    def moved(self, posture: Pose, displacements: Array, fixed: Indices, /) -> Pose:
        """The posture near this one at which the `held` actuators have their displacements (n,).

        Those of the other actuators do not count: they follow.
        """
        ...


class MechanismGeometry:
    """A mechanism as :class:`Geometry`: its Jacobians in every posture."""

    def __init__(
        self, model: MechanismModel[Any], free: Sequence[int] = (), *, springs: bool = False
    ) -> None:
        """Take the mechanism without failures.

        Of the `free` actuators, which exert no force, the loops say where they go; with `springs`
        those of the joints hold what the loops leave free.
        """
        self.model = check.attributes("model", model, "jacobians", "displacements", "task", "moved")
        self.nominal = model.nominal
        self.system = ConstrainedSystem.of(
            model.jacobians(model.nominal), check.flag("springs", springs)
        )
        every = np.arange(len(self.system.active))
        self._driven = np.setdiff1d(every, check.indices("free", free, len(every)))

    def jacobians(self, pose: Any) -> Any:
        """The Jacobians of the model there."""
        return self.model.jacobians(pose)

    def twist(self, pose: Any, displacements: Array) -> Array:
        """Task displacement (m,) of small displacements (n,)."""
        return self.system.at_pose(self.model.jacobians(pose)).kinematics().J @ displacements

    def moved(self, pose: Any, displacements: Array) -> Any:
        """The posture to which displacements (n,) lead, from the one a tick before."""
        return self.model.moved(pose, displacements, self._driven)


def without_springs(system: ConstrainedSystem, actuators: Sequence[int]) -> ConstrainedSystem:
    """The mechanism without the springs of these actuators."""
    if system.stiffness is None or not actuators:
        return system
    K, joints = system.stiffness.copy(), system.active[list(actuators)]
    K[joints, joints] = 0.0
    return replace(system, stiffness=K)


def without_unneeded_springs(system: ConstrainedSystem) -> ConstrainedSystem:
    """The mechanism without springs where its loops leave these nothing to decide."""
    if system.stiffness is None:
        return system
    rigid = replace(system, stiffness=None)
    return system if rigid.kinematics().self_motion.shape[1] else rigid


def free_actuators_follow(released: ConstrainedSystem) -> Array:
    """Displacements of all actuators per displacement of those that are held, shape (n, n)."""
    kinematics, n = released.kinematics(), len(released.active)
    follow, driven = np.zeros((n, n)), kinematics.actuators
    follow[:, driven] = kinematics.velocities(np.eye(len(driven)))[:, released.active].T
    return follow


def induced_displacements(
    released: ConstrainedSystem, locked_at: Array, survivors: Indices
) -> Array:
    """Least displacements (n,) of the survivors that the closed loops need around locked ones."""
    kinematics, induced = released.kinematics(), np.zeros(len(locked_at))
    C = kinematics.active_constraint
    if len(C) and locked_at.any():
        needed = C @ locked_at[kinematics.actuators]
        surviving_columns = C[:, np.isin(kinematics.actuators, survivors)]
        induced[survivors] = -np.linalg.pinv(surviving_columns) @ needed
    return induced
