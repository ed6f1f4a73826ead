"""A controller's own model of a mechanism: its kinematics at any joint positions."""

import copy
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

import argument_checks as check
from kernels import Struct, lib, pointer
from sim.array import Array
from sim.kinematics.jacobian import JacobianReader, Jacobians
from sim.kinematics.observation import Observed, Observer
from sim.kinematics.pose import Pose
from sim.kinematics.task import located_axes
from sim.mjcf.drive import drives
from sim.mjcf.frame import Body, located
from sim.mjcf.model import check_state, start_of


@dataclass(frozen=True, eq=False, kw_only=True)
class JointPosture(Jacobians):
    """Joint positions, and what follows from them.

    Attributes:
        qpos: As in `data.qpos`, shape (nq,).
        pose: Of the task frame, relative to the nominal one, as :meth:`Plant.pose`.
        gaps: Of the closures, in the units of their rows, shape (c,).
        displacements: Of the active velocities from the nominal posture, shape (n,).
    """

    qpos: Array
    pose: Pose
    gaps: Array
    displacements: Array


class Mechanism:
    """A mechanism as :class:`.MechanismModel`: MuJoCo's kinematics, no dynamics.

    Threads may share one.

    Joints, closures and actuators of every kind that :func:`jacobians` takes; an actuator that is
    no joint or tendon has no position to be measured, and its displacement is that commanded.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData | None = None,
        site: str | Body = "payload",
        axes: str | None = None,
        *,
        springs: bool = False,
    ) -> None:
        """Take private copies.

        Args:
            model: The mechanism without failures.
            data: Its nominal posture, loops closed; None is the first keyframe, or `qpos0`.
            site: The task frame: the name of a site or else of a body, or a :class:`Body`.
            axes: Site that gives the axes of the task; None is the world.
            springs: Whether what closures and actuators leave free moves as the springs have it,
                with their least energy, as of a finger on one cable.
        """
        check.instance("model", model, mujoco.MjModel)
        check.flag("springs", springs)
        self._model = copy.copy(model)
        self._data = start_of(model) if data is None else copy.copy(data)
        check_state(self._model, self._data)
        self._reader = JacobianReader(self._model, site, axes, closure_tolerance=np.inf)
        frame, base = located(model, "site", site), located_axes(model, axes)
        mujoco.mj_fwdPosition(self._model, self._data)
        self._observed = Observed(self._model, self._data, drives(self._model), frame, base)
        self._observers = list[Observer]()
        self.nominal = self._posture(self._data.qpos.copy())
        rows = None
        if springs and (K := self.nominal.stiffness) is not None:
            size, modes = np.linalg.eigh(K)  # rows whose squares are the energy of a motion
            rows = np.ascontiguousarray(np.sqrt(size.clip(0.0))[:, None] * modes.T)
        active, N = self.nominal.active, self.nominal.J_C.shape[1]
        self._drives = Struct("drives_model", N=N, n=len(active), active=active, springs=rows)

    def __getstate__(self) -> dict[str, Any]:
        """Without observers, which point into states of their own."""
        return vars(self) | {"_observers": []}

    def jacobians(self, posture: JointPosture) -> Jacobians:
        """The Jacobians in a posture: itself."""
        return _checked(posture)

    def displacements(self, posture: JointPosture) -> Array:
        """Displacements of the active velocities from the nominal posture, shape (n,)."""
        return _checked(posture).displacements

    def task(self, posture: JointPosture) -> Array:
        """Displacement [rotation vector; translation] of the task frame from nominal, (6,)."""
        return _checked(posture).pose.displacement()

    def moved(
        self, posture: JointPosture, displacements: Array, held: NDArray[np.intp]
    ) -> JointPosture:
        """The posture near this one at which the `held` actuators have their displacements (n,).

        One Newton step on the joint positions, closures first: a control tick moves so little that
        it lands within round-off. Displacements that contradict the closures are met with least
        error. What nothing determines stays where it is, or moves as the springs have it.
        """
        J_C, gaps, here = _checked(posture).J_C, posture.gaps, posture.displacements
        wanted = np.ascontiguousarray(check.array("displacements", displacements, len(here)))
        is_plain = type(held) is np.ndarray and held.dtype == np.intp and held.ndim == 1
        if not is_plain or not held.flags.c_contiguous:
            held = check.indices("held", held, len(here))
        (c, N), h = J_C.shape, len(held)
        motion, work = np.empty(N), np.empty(lib.nearest_room(c, h, N, N))
        found = lib.nearest_motion(
            *(self._drives.pointer, c, pointer(J_C), len(gaps), pointer(gaps)),
            *(h, pointer(held), pointer(wanted), pointer(here), pointer(work), pointer(motion)),
        )
        if found == lib.MOTION_REFUSED:
            check.indices("held", held, len(here))
        if found != lib.MOTION_FOUND:
            return posture
        qpos = posture.qpos.copy()
        mujoco.mj_integratePos(self._model, qpos, motion[: self._model.nv], 1.0)
        return self._posture(qpos)

    def _posture(self, qpos: Array) -> JointPosture:
        """Everything at these joint positions."""
        observer = self._observer()
        data = observer.data
        data.qpos[:] = qpos
        fields = self._reader.fields_at(data)
        self._observed.refresh(self._model, data)
        pose, displacements = observer.read()
        gaps = check.read_only(data.efc_pos[: data.ne].copy())
        self._observers.append(observer)
        own = {"qpos": check.read_only(qpos), "gaps": gaps, "displacements": displacements}
        return check.unchecked_record(JointPosture, **fields, **own, pose=pose)

    def _observer(self) -> Observer:
        """One with a state to compute in, which is to be given back."""
        try:
            return self._observers.pop()
        except IndexError:  # another thread has it
            mujoco.mj_copyData(data := mujoco.MjData(self._model), self._model, self._data)
            return Observer(self._observed, data)


def _checked(posture: JointPosture) -> JointPosture:
    return check.instance("posture", posture, JointPosture)
