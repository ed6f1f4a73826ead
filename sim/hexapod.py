"""Closed-form kinematics of a hexapod: strut lengths and their Jacobian from the pose."""

from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from sim.array import Array
from sim.errors import ModelError
from sim.model import element_id


@dataclass(frozen=True)
class Pose:
    """Payload frame in base axes, relative to the nominal pose; or a batch of them.

    Attributes:
        rotation: Shape (..., 3, 3).
        translation_m: Shape (..., 3).
    """

    rotation: Array
    translation_m: Array

    def moved(self, twist: Array) -> "Pose":
        """The pose after a displacement [rotation vector; translation] (..., 6), base axes."""
        turn = Rotation.from_rotvec(twist[..., :3].reshape(-1, 3)).as_matrix()
        turn = turn.reshape(*twist.shape[:-1], 3, 3)
        return Pose(turn @ self.rotation, self.translation_m + twist[..., 3:])


NOMINAL = Pose(np.eye(3), np.zeros(3))


@dataclass(frozen=True)
class Hexapod:
    """Nodes of a hexapod in base axes, measured from the nominal payload origin.

    A batch of poses gives a batch of answers.

    Attributes:
        bottom_m: Bottom node of each strut, on the base, shape (6, 3).
        top_m: Top node of each strut at the nominal pose, on the payload, shape (6, 3).
    """

    bottom_m: Array
    top_m: Array

    @property
    def nominal_length_m(self) -> Array:
        """Strut lengths at the nominal pose, shape (6,)."""
        return np.linalg.norm(self.top_m - self.bottom_m, axis=1)

    def displacements(self, pose: Pose) -> Array:
        """Strut lengths less their nominal ones at a pose, shape (..., 6), [m]."""
        _, struts = self._arms_and_struts(pose)
        return np.linalg.norm(struts, axis=-1) - self.nominal_length_m

    def inverse_jacobian(self, pose: Pose) -> Array:
        """A in l_dot = A [omega; v] at a pose, shape (..., 6, 6): rows [(R a) x u, u]."""
        arms, struts = self._arms_and_struts(pose)
        u = struts / np.linalg.norm(struts, axis=-1, keepdims=True)
        return np.concatenate([np.cross(arms, u), u], axis=-1)

    def _arms_and_struts(self, pose: Pose) -> tuple[Array, Array]:
        """From the payload origin to the top nodes, and from bottom to top; (..., 6, 3) each."""
        arms = self.top_m @ pose.rotation.swapaxes(-1, -2)
        return arms, arms + pose.translation_m[..., None, :] - self.bottom_m


def hexapod(model: mujoco.MjModel) -> Hexapod:
    """Read the nodes from the bodies `housing1..6`, `tip1..6` and the sites of an MJCF model.

    Raises:
        sim.ModelError: The model lacks one of them, or of `strut1..6` and `coil1..6`; or its coils
            do not drive the struts in their order.
    """
    if model.nu != 6:
        raise ModelError(f"a hexapod has six actuators, the model has {model.nu}")
    for k in range(1, 7):
        coil = element_id(model, "actuator", f"coil{k}")
        strut = element_id(model, "joint", f"strut{k}")
        if coil != k - 1 or model.actuator_trnid[coil, 0] != strut:
            raise ModelError(f'actuator "coil{k}" must be number {k} and drive joint "strut{k}"')
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    to_base = data.site_xmat[element_id(model, "site", "base")].reshape(3, 3).T
    origin = data.site_xpos[element_id(model, "site", "payload")]

    def nodes(body: str) -> Array:
        ids = [element_id(model, "body", f"{body}{k}") for k in range(1, 7)]
        return (data.xpos[ids] - origin) @ to_base.T

    return Hexapod(bottom_m=nodes("housing"), top_m=nodes("tip"))
