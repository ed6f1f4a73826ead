"""Kinematic model of a mechanism for a controller, at any joint positions."""

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
    """Joint positions with the Jacobians, pose, gaps and displacements computed from them.

    Attributes:
        qpos: Joint positions, as `data.qpos`, shape (nq,).
        pose: Pose of the task frame relative to nominal, as :meth:`Plant.pose`.
        gaps: Gaps of the closures, in the units of their rows, shape (c,).
        displacements: Displacements of the active joints from nominal, shape (n,).
    """

    qpos: Array
    pose: Pose
    gaps: Array
    displacements: Array


class Mechanism:
    """Kinematic model of a mechanism for a controller, a :class:`.MechanismModel` by MuJoCo.

    Threads may share an instance. All joints, closures and actuators that :func:`jacobians` takes
    are supported; an actuator without joint or tendon has no measured position, and its
    displacement is the commanded one.
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
        """Copy the model and its state.

        Args:
            model: The mechanism without failures.
            data: Nominal posture with closed loops; None is the first keyframe, or `qpos0`.
            site: Task frame: the name of a site or else of a body, or a :class:`Body`.
            axes: Site that gives the axes of the task; None is the world.
            springs: Whether motion that closures and actuators leave free is determined by the
                least energy of the springs, as for a finger on one cable.
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
        """Return the state without observers, which hold pointers."""
        return vars(self) | {"_observers": []}

    def jacobians(self, posture: JointPosture) -> Jacobians:
        """Return the posture itself, which has J_T (m, N), J_C (c, N) and active (n,)."""
        return _checked(posture)

    def displacements(self, posture: JointPosture) -> Array:
        """Return the displacements of the active joints from the nominal posture, shape (n,)."""
        return _checked(posture).displacements

    def task(self, posture: JointPosture) -> Array:
        """Return the displacement [rotation vector; translation] of the task frame, (6,)."""
        return _checked(posture).pose.displacement()

    def moved(
        self, posture: JointPosture, displacements: Array, held: NDArray[np.intp]
    ) -> JointPosture:
        """Return the posture near this one in which the `held` actuators have given displacements.

        `displacements` has shape (n,). One Newton step on the joint positions is made, closures
        first, which for the motion of a control tick is exact to round-off. Displacements that
        contradict the closures are satisfied with least error. Undetermined joints stay in place,
        or move to the least energy of the springs.
        """
        J_C, gaps, here = _checked(posture).J_C, posture.gaps, posture.displacements
        target = np.ascontiguousarray(check.array("displacements", displacements, len(here)))
        is_plain = type(held) is np.ndarray and held.dtype == np.intp and held.ndim == 1
        if not is_plain or not held.flags.c_contiguous:
            held = check.indices("held", held, len(here))
        (c, N), h = J_C.shape, len(held)
        motion, work = np.empty(N), np.empty(lib.nearest_room(c, h, N, N))
        status = lib.nearest_motion(
            *(self._drives.pointer, c, pointer(J_C), len(gaps), pointer(gaps)),
            *(h, pointer(held), pointer(target), pointer(here), pointer(work), pointer(motion)),
        )
        if status == lib.MOTION_INVALID:
            check.indices("held", held, len(here))
        if status != lib.MOTION_SOLVED:
            return posture
        qpos = posture.qpos.copy()
        mujoco.mj_integratePos(self._model, qpos, motion[: self._model.nv], 1.0)
        return self._posture(qpos)

    def _posture(self, qpos: Array) -> JointPosture:
        """Compute the posture at joint positions (nq,)."""
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
        """Take an observer with a state from the pool, or create one; the caller returns it."""
        try:
            return self._observers.pop()
        except IndexError:  # none left
            mujoco.mj_copyData(data := mujoco.MjData(self._model), self._model, self._data)
            return Observer(self._observed, data)


def _checked(posture: JointPosture) -> JointPosture:
    return check.instance("posture", posture, JointPosture)
