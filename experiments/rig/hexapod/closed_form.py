"""The kinematics of a hexapod whose struts are sound or locked, in closed form."""

from collections.abc import Callable
from functools import cached_property
from math import sqrt
from typing import Any

import numpy as np
from scipy.linalg.blas import dnrm2

from prioritized import RANK_TOLERANCE, Kinematics
from sim import Array


class StrutKinematics(Kinematics):
    """J of the survivors, columns of A^-1 where l_dot = A x_dot, without a rank decision.

    No motion is left free, and no strut is tied to another. All that a mapping does not need at
    every tick comes from the general elimination, whose result this J is but for round-off.
    """

    _twists: Array
    _general: Callable[[], Kinematics]

    def __init__(self, J: Array, general: Callable[[], Kinematics]) -> None:
        """Take J, shape (6, n - q), and what makes the kinematics by elimination."""
        own = self.__dict__
        own["_twists"], own["_general"] = J, general

    # A field there, computed when asked for here.
    @cached_property
    def system(self) -> Any:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The mechanism by joints."""
        return self._general().system

    @property
    def J(self) -> Array:
        """Twist of the payload per rate of the surviving struts."""
        return self._twists

    @cached_property
    def _jacobian(self) -> tuple[Array, float]:
        """J in natural units, and sizes of J_T = [0, 1] and of what is taken from A^-1."""
        J = self._twists * self.common_unit / self.task_units[:, None]
        return J, _SIZE_OF_J_T + (float(dnrm2(J.ravel())) if J.size else 0.0)

    @property
    def constraint(self) -> Array:
        """None: shape (0, n - q)."""
        return _NO_ROWS[:, : self._twists.shape[1]]

    @property
    def is_tied(self) -> bool:
        """Never."""
        return False

    @property
    def clear(self) -> float:
        """As of exact Jacobians."""
        return CLEARLY_REGULAR


_SIZE_OF_J_T = sqrt(6.0)
_NO_ROWS = np.zeros((0, 6))
CLEARLY_REGULAR = 2.0 * RANK_TOLERANCE
