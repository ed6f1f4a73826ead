"""Observation of a machine: motion of its task frame and drives from a nominal pose."""

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
    """Pose-independent data for observing a task frame and drives.

    Axes are those of the base, None is the world; the frame's nominal origin is in the world;
    `constants` are the pose-independent fields of `observation` in kernels.h, by name.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        drives: Sequence[Drive],
        frame: Located,
        base: Located | None,
    ) -> None:
        """Take the present pose of `data`, which is up to date, as the nominal one."""
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
        indices = {name: np.array(values, dtype=np.intp) for name, values in numbers.items()}
        self.constants = indices | {
            "drives": len(drives),
            "at_joints": len(joints),
            "gear": np.array([drives[n].gear[0] for n in others]),
            "nominal": nominal,
            "R_0": frame.rotation(data).T.copy(),
            "p_0": self.origin_m,
        }
        nominal[:] = Observer(self, data).read()[1]

    def axes(self, data: mujoco.MjData) -> Array:
        """Return the present axes of the base in the world as columns, shape (3, 3)."""
        return NOMINAL.rotation if self.base is None else self.base.rotation(data)

    def refresh(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Update lengths of transmissions from frames that are up to date."""
        if self.constants["others"].size:
            mujoco.mj_comPos(model, data)
            mujoco.mj_tendon(model, data)
            mujoco.mj_transmission(model, data)
            with_sleepers(model, data, mujoco.mj_tendon, mujoco.mj_transmission)

    def fields(self, data: mujoco.MjData) -> dict[str, Any]:
        """Return the fields that compiled code reads, by name; views of `data`."""
        return self.constants | {
            "xmat": self.frame.rotation(data),
            "xpos": self.frame.position_m(data),
            "base_xmat": self.axes(data),
            "qpos": data.qpos,
            "lengths": data.actuator_length,
        }

    def force_at_centre_of_mass(self, data: mujoco.MjData, wrench: Array) -> Array:
        """Convert [moment; force] (6,) at the frame to [force; moment] for `xfrc_applied`."""
        axes = self.axes(data)
        moment, force = axes @ wrench[:3], axes @ wrench[3:]
        arm = self.frame.position_m(data) - data.xipos[self.frame.body]
        return np.array([*force, *(moment + np.cross(arm, force))])


class Observer:
    """Reader of the task frame and drives in one state, for repeated use."""

    def __init__(self, observed: Observed, data: mujoco.MjData) -> None:
        """Take a state, which must be up to date at each reading."""
        self.data, self._values = data, np.empty(18 + observed.constants["drives"])
        rotation, translation_m, self._task, displacement = np.split(self._values, [9, 12, 18])
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
        """Return the pose of the task frame, R_now R_nominal^T in base axes, and of drives (n,)."""
        principal(lib.observe(self._log.pointer, 0, ffi.NULL, ffi.NULL, 0), self._task)
        values = check.read_only(self._values.copy())
        pose = check.unchecked_record(
            Pose,
            rotation=values[:9].reshape(3, 3),
            translation_m=values[9:12],
            _displacement=values[12:18],
        )
        return pose, values[18:]
