"""Displacements of the drives of a machine from its nominal pose."""

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.array import Array
from sim.mjcf.drive import Drive
from sim.mjcf.model import with_sleepers


@dataclass(frozen=True, eq=False)
class Displacements:
    """Where drives are read, and what is read there in the nominal pose.

    Attributes:
        joints: Which drives are slide or hinge joints.
        qpos: Of each of these, its place in `data.qpos`.
        others: Which are other transmissions.
        outputs: Of each of these, its place in `data.actuator_length`.
        gear: And the gear of that length.
        nominal: Of each drive, shape (n,).
    """

    joints: NDArray[np.intp]
    qpos: NDArray[np.intp]
    others: NDArray[np.intp]
    outputs: NDArray[np.intp]
    gear: Array
    nominal: Array

    @classmethod
    def from_here(
        cls, model: mujoco.MjModel, data: mujoco.MjData, drives: tuple[Drive, ...]
    ) -> "Displacements":
        """Those from the pose of `data`, which is up to date."""
        joints = [n for n, drive in enumerate(drives) if drive.joint is not None]
        others = [n for n, drive in enumerate(drives) if drive.joint is None]
        places = (
            *(joints, model.jnt_qposadr[[drives[n].joint for n in joints]]),
            *(others, [drives[n].outputs[0] for n in others]),
        )
        joints, qpos, others, outputs = (np.array(place, dtype=np.intp) for place in places)
        gear = np.array([drives[n].gear[0] for n in others])
        here = cls(joints, qpos, others, outputs, gear, np.zeros(len(drives)))
        return cls(joints, qpos, others, outputs, gear, here.read(data))

    def refresh(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Bring lengths up to date with bodies that are."""
        if self.others.size:
            mujoco.mj_comPos(model, data)
            mujoco.mj_tendon(model, data)
            mujoco.mj_transmission(model, data)
            with_sleepers(model, data, mujoco.mj_tendon, mujoco.mj_transmission)

    def places(self, data: mujoco.MjData) -> dict[str, Any]:
        """Where the compiled code reads them, by names of kernels.h, as long as `data` is there."""
        return {
            "drives": len(self.nominal),
            "at_joints": len(self.joints),
            "joints": self.joints,
            "places": self.qpos,
            "others": self.others,
            "outputs": self.outputs,
            "gear": self.gear,
            "nominal": self.nominal,
            "qpos": data.qpos,
            "lengths": data.actuator_length,
        }

    def read(self, data: mujoco.MjData) -> Array:
        """Displacements (n,) from the nominal pose, [m] or [rad]."""
        now = data.qpos.take(self.qpos)
        if self.others.size:
            at_joints, now = now, np.empty(len(self.nominal))
            now[self.joints] = at_joints
            now[self.others] = data.actuator_length.take(self.outputs) / self.gear
        return now - self.nominal
