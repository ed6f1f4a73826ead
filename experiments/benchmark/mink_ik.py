"""The same displacements from mink, on the same MuJoCo model."""

from collections.abc import Sequence
from typing import Any

import mink
import mujoco
import numpy as np

from experiments.benchmark.case import GOAL, STUCK, Case, strut_velocities
from experiments.hexapod.goal import MAJOR
from sim import Array


class Pointing(mink.Task):
    """The payload's rotation about x_b and y_b: the two rows that matter.

    mink's FrameTask has six, all of which become equalities when it is a constraint.
    """

    def __init__(self, model: mujoco.MjModel, pointing_rad: Array) -> None:
        """Ask for a rotation (alpha, beta) from the configuration that is solved for."""
        super().__init__(cost=np.ones(len(MAJOR)))
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        self._to_base = data.site("base").xmat.reshape(3, 3).T[MAJOR]
        self._payload = model.site("payload").id
        self._rotation = np.empty((3, model.nv))
        self._error = -pointing_rad

    def compute_error(self, configuration: mink.Configuration) -> Array:
        """What is left to turn, with mink's sign."""
        return self._error

    def compute_jacobian(self, configuration: mink.Configuration) -> Array:
        """Shape (2, nv)."""
        model, data = configuration.model, configuration.data
        mujoco.mj_jacSite(model, data, None, self._rotation, self._payload)
        return self._to_base @ self._rotation


class LeastStruts(mink.Task):
    """The strut displacements that shall be small: six rows.

    mink's DampingTask has one for every joint and takes 6 % longer.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        """With the weights of the goal."""
        super().__init__(cost=np.array(GOAL.joint_weight))
        self._rows = np.eye(model.nv)[strut_velocities(model)]
        self._error = np.zeros(len(self._rows))

    def compute_error(self, configuration: mink.Configuration) -> Array:
        """None: the struts shall stay."""
        return self._error

    def compute_jacobian(self, configuration: mink.Configuration) -> Array:
        """Shape (6, nv)."""
        return self._rows


def arguments(model: mujoco.MjModel, cases: Sequence[Case]) -> list[tuple[Any, ...]]:
    """Of `solve_ik`: configurations already updated, tasks already made."""
    least = LeastStruts(model)
    loops = mink.EqualityConstraintTask(model, cost=1.0)
    freeze = mink.DofFreezingTask(model, [int(strut_velocities(model)[STUCK])])
    return [
        (
            mink.Configuration(model, case.qpos),
            [least],
            [Pointing(model, case.pointing_rad), loops, freeze],
        )
        for case in cases
    ]


def solve_ik(configuration: mink.Configuration, tasks: list[Any], constraints: list[Any]) -> Array:
    """A displacement of all joints (nv,), as a user of mink gets it fastest.

    Pointing, loops and lock are equalities: a strict priority, as here. Limits are off. Without
    `eq_reduction` daqp's tolerance is 1e-4 of so small a motion; it costs no time.
    """
    return mink.solve_ik(
        configuration, tasks, 1.0, "daqp", limits=[], constraints=constraints, eq_reduction=1
    )
