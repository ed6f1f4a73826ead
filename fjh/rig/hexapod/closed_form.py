"""Closed-form kinematics of a hexapod: strut lengths and their Jacobian from the pose."""

import math
from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np

import argument_checks as check
from kernels import Struct, lib, pointer
from sim import Array, ModelError, Pose
from sim.mjcf import element_id


@dataclass(frozen=True)
class Posture(Pose):
    """A pose of a hexapod with its strut displacements and inverse Jacobian.

    Attributes:
        displacement_m: Strut lengths minus the nominal ones, shape (..., 6).
        inverse_jacobian: Matrix A in l_dot = A [omega; v], shape (..., 6, 6).
    """

    displacement_m: Array
    inverse_jacobian: Array

    def __post_init__(self) -> None:
        super().__post_init__()
        check.freeze_field(self, "displacement_m", 6)
        check.freeze_field(self, "inverse_jacobian", 6, 6)

    def twist(self, displacement_m: Array) -> Array:
        """Return [rotation vector; translation] (6,) of small strut displacements (6,).

        Raises:
            ValueError: The shape is wrong, a number is not finite, or the pose is singular.
        """
        displacement_m = check.array("displacement_m", displacement_m, 6)
        if self.inverse_jacobian.ndim != 2:
            raise ValueError("inverse_jacobian must be that of one pose, got a batch")
        twist = displacement_m.copy()
        if not lib.strut_twist(pointer(self.inverse_jacobian), pointer(twist)):
            raise ValueError(_SINGULAR)
        return twist


_SINGULAR = "inverse_jacobian must not be singular: with fixed struts the payload could move"
_NO_LENGTH = "pose must give every strut a nonzero length, got one whose nodes coincide"


@dataclass(frozen=True)
class Hexapod:
    """Geometry of a hexapod: its nodes in base axes, measured from the nominal payload origin.

    All methods except `moved` accept batches of poses.

    Attributes:
        bottom_m: Bottom node of each strut, on the base, shape (6, 3).
        top_m: Top node of each strut at the nominal pose, on the payload, shape (6, 3).
    """

    bottom_m: Array
    top_m: Array

    def __post_init__(self) -> None:
        for name in ("bottom_m", "top_m"):
            check.freeze_field(self, name, 6, 3)
            check.array(name, getattr(self, name), 6, 3)

    @cached_property
    def nominal_length_m(self) -> Array:
        """Strut lengths at the nominal pose, shape (6,)."""
        return check.read_only(np.linalg.norm(self.top_m - self.bottom_m, axis=1))

    @cached_property
    def nodes(self) -> Struct:
        """Nodes and nominal lengths as a struct of the compiled code."""
        names = ("bottom_m", "top_m", "nominal_length_m")
        return Struct("strut_nodes", **{name: getattr(self, name) for name in names})

    def displacements(self, pose: Pose) -> Array:
        """Return strut lengths minus the nominal ones at a pose, shape (..., 6), [m]."""
        if isinstance(pose, Posture):
            return pose.displacement_m
        return self.lengths_and_jacobian(pose, singular=True)[0] - self.nominal_length_m

    def inverse_jacobian(self, pose: Pose) -> Array:
        """Return A in l_dot = A [omega; v] at a pose, (..., 6, 6), with rows [(R a) x u, u]."""
        return self.posture(pose).inverse_jacobian

    def posture(self, pose: Pose) -> Posture:
        """Return a pose with its strut displacements and A; a `Posture` is returned unchanged.

        Raises:
            ValueError: A strut has zero length and so no direction.
        """
        if isinstance(pose, Posture):
            return pose
        length_m, A = self.lengths_and_jacobian(pose)
        return check.computed(
            Posture,
            rotation=pose.rotation,
            translation_m=pose.translation_m,
            displacement_m=length_m - self.nominal_length_m,
            inverse_jacobian=A,
        )

    def lengths_and_jacobian(self, pose: Pose, *, singular: bool = False) -> tuple[Array, Array]:
        """Return strut lengths (..., 6) [m] and A (..., 6, 6) at a pose.

        Args:
            pose: One pose, or a batch.
            singular: Whether rows of struts of zero length may be NaN.
        """
        check.instance("pose", pose, Pose)
        check.flag("singular", singular)
        lead = pose.lead
        length_m, A = np.empty((*lead, 6)), np.empty((*lead, 6, 6))
        poses = check.flat(pose.rotation, 2, lead), check.flat(pose.translation_m, 1, lead)
        buffers = map(pointer, (*poses, length_m, A))
        if not lib.strut_lengths(self.nodes.pointer, math.prod(lead), *buffers) and not singular:
            raise ValueError(_NO_LENGTH)
        return length_m, A

    def moved(self, pose: Pose, displacement_m: Array) -> Posture:
        """Return the posture at strut displacements (6,), by one Newton step from a nearby pose.

        Raises:
            ValueError: An argument has a wrong shape or non-finite numbers, the pose is singular,
                or a strut has zero length.
        """
        here = self.posture(pose)
        target_m = check.array("displacement_m", displacement_m, 6)
        fields = np.empty((3, 3)), np.empty(3), np.empty((6, 6)), np.empty(6)
        R, t, A, moved_m = fields
        arguments = (
            *(here.rotation, here.translation_m, here.inverse_jacobian, here.displacement_m),
            np.ascontiguousarray(target_m),
        )
        status = lib.follow(self.nodes.pointer, *map(pointer, (*arguments, *fields)))
        if status != lib.FOLLOWED:
            raise ValueError(_SINGULAR if status == lib.SINGULAR else _NO_LENGTH)
        return check.computed(
            Posture, rotation=R, translation_m=t, displacement_m=moved_m, inverse_jacobian=A
        )


def hexapod(model: mujoco.MjModel) -> Hexapod:
    """Return the geometry in an MJCF model, from its bodies `housing1..6`, `tip1..6` and sites.

    Raises:
        sim.ModelError: A body, a site, a joint `strut1..6` or an actuator `coil1..6` is missing, or
            the coils do not drive the struts in order.
    """
    check.instance("model", model, mujoco.MjModel)
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
