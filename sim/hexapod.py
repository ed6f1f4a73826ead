"""Closed-form kinematics of a hexapod: strut lengths and their Jacobian from the pose."""

from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np
from scipy.linalg.lapack import dgesv
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
        if twist.ndim == 1:
            return Pose(_turn(twist[:3]).dot(self.rotation), self.translation_m + twist[3:])
        turn = Rotation.from_rotvec(twist[..., :3].reshape(-1, 3)).as_matrix()
        turn = turn.reshape(*twist.shape[:-1], 3, 3)
        return Pose(turn @ self.rotation, self.translation_m + twist[..., 3:])


def _turn(rotation_vector: Array) -> Array:
    """Matrix of one rotation: MuJoCo takes a tenth of scipy's time, which is made for batches."""
    quat_wxyz, matrix = np.array([1.0, 0.0, 0.0, 0.0]), np.empty(9)
    mujoco.mju_quatIntegrate(quat_wxyz, rotation_vector, 1.0)
    mujoco.mju_quat2Mat(matrix, quat_wxyz)
    return matrix.reshape(3, 3)


NOMINAL = Pose(np.eye(3), np.zeros(3))


@dataclass(frozen=True)
class Posture(Pose):
    """A pose of a hexapod together with its struts there.

    Attributes:
        displacement_m: Strut lengths less their nominal ones, shape (..., 6).
        inverse_jacobian: A in l_dot = A [omega; v], shape (..., 6, 6).
    """

    displacement_m: Array
    inverse_jacobian: Array

    def twist(self, displacement_m: Array) -> Array:
        """The displacement [rotation vector; translation] (6,) of small strut displacements (6,).

        Raises:
            numpy.linalg.LinAlgError: The pose is singular.
        """
        *_, twist, singular = dgesv(self.inverse_jacobian, displacement_m)
        if singular:
            raise np.linalg.LinAlgError("the pose is singular: held struts let the payload move")
        return twist


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

    @cached_property
    def nominal_length_m(self) -> Array:
        """Strut lengths at the nominal pose, shape (6,)."""
        return _length(self.top_m - self.bottom_m)

    def displacements(self, pose: Pose) -> Array:
        """Strut lengths less their nominal ones at a pose, shape (..., 6), [m]."""
        if isinstance(pose, Posture):
            return pose.displacement_m
        _, struts = self._arms_and_struts(pose)
        return _length(struts) - self.nominal_length_m

    def inverse_jacobian(self, pose: Pose) -> Array:
        """A in l_dot = A [omega; v] at a pose, shape (..., 6, 6): rows [(R a) x u, u]."""
        return self.posture(pose).inverse_jacobian

    def posture(self, pose: Pose) -> Posture:
        """The pose with its struts; one that has them already is returned as it is."""
        if isinstance(pose, Posture):
            return pose
        arms, struts = self._arms_and_struts(pose)
        length_m = _length(struts)
        A = np.empty((*length_m.shape, 6))
        u = np.divide(struts, length_m[..., None], out=A[..., 3:])
        A[..., :3] = _cross(arms, u)
        return Posture(pose.rotation, pose.translation_m, length_m - self.nominal_length_m, A)

    def _arms_and_struts(self, pose: Pose) -> tuple[Array, Array]:
        """From the payload origin to the top nodes, and from bottom to top; (..., 6, 3) each."""
        # dot has half the overhead of @, and serves one pose alone.
        turned = self.top_m.dot if pose.rotation.ndim == 2 else self.top_m.__matmul__
        arms = turned(pose.rotation.swapaxes(-1, -2))
        return arms, arms + (pose.translation_m[..., None, :] - self.bottom_m)


def _length(vectors: Array) -> Array:
    return np.sqrt((vectors * vectors).dot(_ONES))


_ONES = np.ones(3)
_NEXT, _AFTER = np.array([1, 2, 0]), np.array([2, 0, 1])


def _cross(a: Array, b: Array) -> Array:
    """Cross products of vectors (..., 3), at a tenth of the overhead of numpy's."""
    return a.take(_NEXT, -1) * b.take(_AFTER, -1) - a.take(_AFTER, -1) * b.take(_NEXT, -1)


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
