"""What is observed of a machine: motion of its task frame and its drives from a nominal pose."""

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

import argument_checks as check
from kernels import Struct, ffi, lib
from sim.array import Array
from sim.kinematics.pose import NOMINAL, Pose, principal
from sim.mjcf.drive import Drive
from sim.mjcf.frame import Located
from sim.mjcf.model import with_sleepers


class Observed:
    """Where a task frame and drives are read, and what is read there in the nominal pose.

    Axes are those of the base, None is the world; the frame's nominal origin is in the world;
    `known` is what no pose changes of the `observation` of kernels.h, by its names.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        drives: Sequence[Drive],
        frame: Located,
        base: Located | None,
    ) -> None:
        """Take the present pose for the nominal one, `data` up to date."""
        joints = [n for n, drive in enumerate(drives) if drive.joint is not None]
        others = [n for n, drive in enumerate(drives) if drive.joint is None]
        numbers = {
            "joints": joints,
            "places": model.jnt_qposadr[[drives[n].joint for n in joints]],
            "others": others,
            "outputs": [drives[n].outputs[0] for n in others],
        }
        self.frame, self.base = frame, base
        self.origin_m, nominal = frame.position_m(data).copy(), np.zeros(len(drives))
        self.known = {name: np.array(each, dtype=np.intp) for name, each in numbers.items()} | {
            "drives": len(drives),
            "at_joints": len(joints),
            "gear": np.array([drives[n].gear[0] for n in others]),
            "nominal": nominal,
            "R_0": frame.rotation(data).T.copy(),
            "p_0": self.origin_m,
        }
        nominal[:] = Observer(self, data).read()[1]

    def axes(self, data: mujoco.MjData) -> Array:
        """Present axes of the base in the world as columns, shape (3, 3)."""
        return NOMINAL.rotation if self.base is None else self.base.rotation(data)

    def refresh(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Bring lengths of transmissions up to date with bodies that are."""
        if self.known["others"].size:
            mujoco.mj_comPos(model, data)
            mujoco.mj_tendon(model, data)
            mujoco.mj_transmission(model, data)
            with_sleepers(model, data, mujoco.mj_tendon, mujoco.mj_transmission)

    def fields(self, data: mujoco.MjData) -> dict[str, Any]:
        """What compiled code reads, by names of kernels.h, as long as `data` is there."""
        return self.known | {
            "xmat": self.frame.rotation(data),
            "xpos": self.frame.position_m(data),
            "base_xmat": self.axes(data),
            "qpos": data.qpos,
            "lengths": data.actuator_length,
        }

    def force_at_centre_of_mass(self, data: mujoco.MjData, wrench: Array) -> Array:
        """[force; moment] in world axes, as `xfrc_applied`, of [moment; force] (6,) at it."""
        axes = self.axes(data)
        moment, force = axes @ wrench[:3], axes @ wrench[3:]
        arm = self.frame.position_m(data) - data.xipos[self.frame.body]
        return np.array([*force, *(moment + np.cross(arm, force))])


class Observer:
    """Reads what is observed in one state, again and again as that changes."""

    def __init__(self, observed: Observed, data: mujoco.MjData) -> None:
        """Take a state, which is up to date whenever it is read."""
        self.data, self._seen = data, np.empty(18 + observed.known["drives"])
        rotation, translation_m, self._task, displacement = np.split(self._seen, [9, 12, 18])
        self._log = Struct(
            "observation",
            **observed.fields(data),
            rotation=rotation,
            translation_m=translation_m,
            task=self._task,
            displacement=displacement,
            closure_residual_m=np.empty(1),
        )

    def read(self) -> tuple[Pose, Array]:
        """The motion of the task frame in base axes, R_now R_nominal^T, and of the drives, (n,)."""
        principal(lib.observe(self._log.pointer, 0, ffi.NULL, ffi.NULL, 0), self._task)
        seen = check.read_only(self._seen.copy())
        pose = check.unchecked_record(
            Pose,
            rotation=seen[:9].reshape(3, 3),
            translation_m=seen[9:12],
            _displacement=seen[12:18],
        )
        return pose, seen[18:]
