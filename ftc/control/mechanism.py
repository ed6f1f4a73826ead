"""Any mechanism for the mapping, from a model that knows its kinematics in every posture."""

from collections.abc import Sequence
from typing import Any, Protocol, TypeVar

import numpy as np

import argument_checks as check
from argument_checks import Array, Indices
from prioritized import ConstrainedSystem

Posture = TypeVar("Posture")


class MechanismModel(Protocol[Posture]):
    """A controller's own model of a mechanism without failures; `sim.Mechanism` is one.

    A posture is the model's own type; it belongs to one set of joint positions.
    """

    @property
    def nominal(self) -> Posture:
        """The posture that displacements are measured from."""
        ...

    def jacobians(self, posture: Posture) -> Any:
        """An object with J_T (m, N), J_C (c, N) and active (n,); see :class:`sim.Jacobians`."""
        ...

    def displacements(self, posture: Posture) -> Array:
        """Displacements of the actuators from the nominal posture, shape (n,)."""
        ...

    def task(self, posture: Posture) -> Array:
        """Task coordinates (m,), whose rates are J_T's near the nominal posture."""
        ...

    def moved(self, posture: Posture, displacements: Array, held: Indices) -> Posture:
        """The posture near this one at which the `held` actuators have their displacements (n,).

        Those of the other actuators do not count: they follow.
        """
        ...


class MechanismGeometry:
    """A mechanism as :class:`ftc.control.geometry.Geometry`: its Jacobians in every posture."""

    def __init__(
        self, model: MechanismModel[Any], free: Sequence[int] = (), *, springs: bool = False
    ) -> None:
        """Take the model.

        Args:
            model: The mechanism without failures.
            free: Actuators known to exert no force: the loops say where they go.
            springs: Whether the springs of the joints hold what the loops leave free.

        Raises:
            ValueError, TypeError: Not a model, or none of its actuators.
        """
        self.model = check.methods("model", model, "jacobians", "displacements", "task", "moved")
        self.nominal = model.nominal
        self.system = ConstrainedSystem.of(
            model.jacobians(model.nominal), check.flag("springs", springs)
        )
        every = np.arange(len(self.system.active))
        self._held = np.setdiff1d(every, check.indices("free", free, len(every)))

    def posture(self, pose: Any) -> Any:
        """The posture itself."""
        return pose

    def jacobians(self, posture: Any) -> Any:
        """The Jacobians of the model there."""
        return self.model.jacobians(posture)

    def twist(self, posture: Any, displacements: Array) -> Array:
        """Task displacement (m,) of small displacements (n,) of the mechanism without failures."""
        there = self.system.at_pose(self.model.jacobians(posture)).kinematics()
        return there.J @ displacements

    def moved(self, pose: Any, displacements: Array) -> Any:
        """The posture to which displacements (n,) lead, from the one a tick before."""
        return self.model.moved(pose, displacements, self._held)
