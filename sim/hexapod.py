"""Closed-form kinematics of a hexapod: strut lengths and their Jacobian from the pose."""

from dataclasses import dataclass

import mujoco
import numpy as np

from sim.array import Array
from sim.errors import ModelError
from sim.model import element_id


@dataclass(frozen=True)
class Pose:
    """Payload frame in base axes, relative to the nominal pose.

    Attributes:
        rotation: Shape (3, 3).
        translation_m: Shape (3,).
    """

    rotation: Array
    translation_m: Array

    def moved(self, twist: Array) -> "Pose":
        """The pose after a small displacement [rotation vector; translation], base axes."""
        quat_wxyz, turn = np.array([1.0, 0.0, 0.0, 0.0]), np.empty(9)
        mujoco.mju_quatIntegrate(quat_wxyz, twist[:3], 1.0)
        mujoco.mju_quat2Mat(turn, quat_wxyz)
        return Pose(turn.reshape(3, 3) @ self.rotation, self.translation_m + twist[3:])


NOMINAL = Pose(np.eye(3), np.zeros(3))


@dataclass(frozen=True)
class Hexapod:
    """Nodes of a hexapod in base axes, measured from the nominal payload origin.

    Attributes:
        bottom_m: Bottom node of each strut, on the base, shape (6, 3).
        top_m: Top node of each strut at the nominal pose, on the payload, shape (6, 3).
    """

    bottom_m: Array
    top_m: Array

    def displacements(self, pose: Pose) -> Array:
        """Strut lengths less their nominal ones at a pose, shape (6,), [m]."""
        nominal = np.linalg.norm(self.top_m - self.bottom_m, axis=1)
        return np.linalg.norm(self._struts(pose), axis=1) - nominal

    def inverse_jacobian(self, pose: Pose) -> Array:
        """A in l_dot = A [omega; v] at a pose, shape (6, 6): rows [(R a) x u, u]."""
        struts = self._struts(pose)
        u = struts / np.linalg.norm(struts, axis=1, keepdims=True)
        arms = self.top_m @ pose.rotation.T
        return np.hstack([np.cross(arms, u), u])

    def _struts(self, pose: Pose) -> Array:
        return self.top_m @ pose.rotation.T + pose.translation_m - self.bottom_m


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
