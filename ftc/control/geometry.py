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
    """Model of a mechanism without failures, parallel or serial, as the mapping needs it.

    A pose is the client's own type; the mapping only hands it back.
    """

    @property
    def nominal(self) -> Pose:
        """The pose that displacements are measured from."""
        ...

    @property
    def system(self) -> ConstrainedSystem:
        """The mechanism at the nominal pose, with springs where there are any."""
        ...

    def posture(self, pose: Pose) -> Pose:
        """The pose at which the mapping is evaluated; the nominal one for a constant Jacobian."""
        ...

    def jacobians(self, posture: Pose) -> Any:
        """An object with J_T (m, N) and J_C (c, N) of :attr:`system` at a posture.

        And with their `accuracy`, where that is known; see :class:`sim.Jacobians`.
        """
        ...

    def twist(self, posture: Pose, displacements: Array) -> Array:
        """Task displacement (m,) of small displacements (n,) of the mechanism without failures."""
        ...

    def moved(self, pose: Pose, displacements: Array) -> Pose:
        """The pose to which displacements (n,) lead, from the pose one tick before."""
        ...


class LocalGeometry:
    """Any mechanism about its nominal pose, from its Jacobians alone; poses are twists (m,)."""

    def __init__(self, system: ConstrainedSystem) -> None:
        """Make the geometry from the mechanism without failures at its nominal pose.

        Raises:
            TypeError: Not a mechanism.
        """
        self.system = check.instance("system", system, ConstrainedSystem)
        self.nominal = np.zeros(len(system.J_T))
        self._J = system.kinematics().J

    def posture(self, pose: Array) -> Array:
        """The nominal pose, for every present pose."""
        return self.nominal

    def jacobians(self, posture: Array) -> ConstrainedSystem:
        """The mechanism itself."""
        return self.system

    def twist(self, posture: Array, displacements: Array) -> Array:
        """Task displacement (m,) of displacements (n,)."""
        return self._J @ displacements

    def moved(self, pose: Array, displacements: Array) -> Array:
        """The twist of displacements (n,)."""
        return self._J @ displacements


def without_springs(system: ConstrainedSystem, actuators: Sequence[int]) -> ConstrainedSystem:
    """The mechanism without the springs of these actuators."""
    if system.stiffness is None or not actuators:
        return system
    K, joints = system.stiffness.copy(), system.active[list(actuators)]
    K[joints, joints] = 0.0
    return replace(system, stiffness=K)


def without_idle_springs(system: ConstrainedSystem) -> ConstrainedSystem:
    """The mechanism without springs where its loops leave these nothing to decide."""
    if system.stiffness is None:
        return system
    rigid = replace(system, stiffness=None)
    return system if rigid.kinematics().self_motion.shape[1] else rigid


def free_actuators_follow(released: ConstrainedSystem) -> Array:
    """Displacements of all actuators per displacement of those that are held, shape (n, n)."""
    kinematics, n = released.kinematics(), len(released.active)
    follow = np.zeros((n, n))
    follow[kinematics.actuators, kinematics.actuators] = 1.0
    number = {velocity: k for k, velocity in enumerate(released.active.tolist())}
    for velocity, gain in zip(kinematics.passive.tolist(), kinematics.passive_gain, strict=True):
        if velocity in number:
            follow[number[velocity], kinematics.actuators] = gain
    return follow


def yielded(released: ConstrainedSystem, locked_at: Array, survivors: Indices) -> Array:
    """Least displacements (n,) of the survivors that the closed loops need around locked ones."""
    kinematics, yielded = released.kinematics(), np.zeros(len(locked_at))
    C = kinematics.active_constraint
    if len(C) and locked_at.any():
        needed = C @ locked_at[kinematics.actuators]
        of_survivors = C[:, np.isin(kinematics.actuators, survivors)]
        yielded[survivors] = -np.linalg.pinv(of_survivors) @ needed
    return yielded
