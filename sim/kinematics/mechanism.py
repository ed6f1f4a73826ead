"""A controller's own model of a mechanism: its kinematics at any joint positions."""

import copy
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

import argument_checks as check
from kernels import Struct, ffi, lib, pointer
from sim.array import Array
from sim.closing.pin import Pin
from sim.kinematics.displacements import Displacements
from sim.kinematics.entry_accuracy import EntryAccuracy
from sim.kinematics.jacobian import Jacobians
from sim.kinematics.machine import Machine
from sim.kinematics.payload import Payload
from sim.kinematics.pose import Pose, principal
from sim.kinematics.reader import JacobianReader
from sim.mjcf.frame import Body, located
from sim.mjcf.model import check_state, start_of
from sim.mjcf.transmission import drives


@dataclass(frozen=True, eq=False, kw_only=True)
class JointPosture(Jacobians):
    """Joint positions, and what follows from them.

    Attributes:
        mechanism: Whose they are.
        qpos: As in `data.qpos`, shape (nq,).
        pose: Of the task frame, relative to the nominal one, as :meth:`Plant.pose`.
        gaps: Of the closures, in the units of their rows, shape (c,).
        displacements: Of the active velocities from the nominal posture, shape (n,).
        error_bound: Of the errors of all entries of the Jacobians, in natural units.
    """

    mechanism: "Mechanism"
    qpos: Array
    pose: Pose
    gaps: Array
    displacements: Array
    error_bound: float

    # Fields of the Jacobians that only rank decisions and reports need.
    @cached_property
    def machine(self) -> Machine | None:  # pyright: ignore[reportIncompatibleVariableOverride]
        """See :class:`Jacobians`."""
        return self._whole.machine

    @cached_property
    def accuracy(self) -> EntryAccuracy | None:  # pyright: ignore[reportIncompatibleVariableOverride]
        """See :class:`Jacobians`."""
        return self._whole.accuracy

    @cached_property
    def _whole(self) -> Jacobians:
        return self.mechanism.read(self.qpos)

    @property
    def rotation(self) -> Array:
        """Of the task frame, relative to the nominal one, shape (3, 3)."""
        return self.pose.rotation

    @property
    def translation_m(self) -> Array:
        """Of the task frame, relative to the nominal one, shape (3,)."""
        return self.pose.translation_m


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
        pinned: Iterable[str | Body | Pin] = (),
        springs: bool = False,
    ) -> None:
        """Take private copies.

        Args:
            model: The mechanism without failures.
            data: Its nominal posture, loops closed; None is the first keyframe, or `qpos0`.
            site: The task frame: the name of a site or else of a body, or a :class:`Body`.
            axes: Site that gives the axes of the task; None is the world.
            pinned: Frames that stay where they are.
            springs: Whether what closures and actuators leave free moves as the springs have it,
                with their least energy, as of a finger on one cable.

        Raises:
            sim.ModelError, sim.ClosureError, ValueError, TypeError: As :func:`jacobians`.
        """
        check.instance("model", model, mujoco.MjModel)
        check.flag("springs", springs)
        self._model = copy.copy(model)
        self._data = start_of(model) if data is None else copy.copy(data)
        check_state(self._model, self._data)
        self._reader = JacobianReader(
            self._model, site, axes, pinned=pinned, closure_tolerance=np.inf
        )
        frame = located(model, "site", site)
        base = None if axes is None else located(model, "axes", axes)
        mujoco.mj_fwdPosition(self._model, self._data)
        self._payload = Payload.at_rest(self._data, frame, base)
        gauged = drives(self._model)
        self._gauges = Displacements.from_here(self._model, self._data, gauged)
        first = self._reader.at(self._data)
        self._rows, self._gear = first.rows, first.gear
        of = self._model, self._data, self._reader, self._payload, self._gauges
        self._workspaces = [_Workspace(*of)]
        self.nominal = self._posture(self._data.qpos.copy())
        stiffness = self.nominal.stiffness if springs else None
        self._drives = Struct(
            "drives_model",
            N=self.nominal.J_C.shape[1],
            n=len(self.nominal.active),
            active=self.nominal.active,
            springs=None if stiffness is None else _spring_rows(stiffness),
        )

    def __getstate__(self) -> dict[str, Any]:
        """Without workspaces, which point into states of their own."""
        return vars(self) | {"_workspaces": []}

    def jacobians(self, posture: JointPosture) -> Jacobians:
        """The Jacobians in a posture: itself."""
        return _checked(posture)

    def read(self, qpos: Array) -> Jacobians:
        """The Jacobians at joint positions (nq,), with all that the model says besides."""
        space = self._workspace()
        space.qpos[:] = qpos
        jacobians = self._reader.at(space.data)
        self._workspaces.append(space)
        return jacobians

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

        Raises:
            ValueError: `displacements` of another number, or not finite; or no such actuators.
            TypeError: `posture` is of another type.
        """
        J_C, gaps, here = _checked(posture).J_C, posture.gaps, posture.displacements
        displacements = check.exactly("displacements", displacements, len(here))
        displacements = np.ascontiguousarray(displacements)
        motion = self._motion(J_C, gaps, here, displacements, held)
        if motion is None:
            return posture
        qpos = posture.qpos.copy()
        mujoco.mj_integratePos(self._model, qpos, motion[: self._model.nv], 1.0)
        return self._posture(qpos)

    def _motion(
        self, J_C: Array, gaps: Array, here: Array, wanted: Array, held: NDArray[np.intp]
    ) -> Array | None:
        """Motion of all velocities (N,) of :meth:`moved`; None: nothing is to move."""
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
        return motion if found == lib.MOTION_FOUND else None

    def _posture(self, qpos: Array) -> JointPosture:
        """Everything at these joint positions."""
        space = self._workspace()
        space.qpos[:] = qpos
        J_T, J_C, active, residual, bound = space.reader.read(space.data)
        self._gauges.refresh(self._model, space.data)
        seen = space.seen()
        gaps, J_T, J_C = space.data.efc_pos[: space.data.ne].copy(), J_T.copy(), J_C.copy()
        self._workspaces.append(space)
        for array in (gaps, J_T, J_C, qpos):
            array.setflags(write=False)
        return check.made(
            JointPosture,
            mechanism=self,
            qpos=qpos,
            pose=check.made(
                Pose,
                rotation=seen[:9].reshape(3, 3),
                translation_m=seen[9:12],
                _displacement=seen[12:18],
            ),
            J_T=J_T,
            J_C=J_C,
            active=active,
            gear=self._gear,
            rows=self._rows,
            closure_residual=residual,
            error_bound=bound,
            gaps=gaps,
            displacements=seen[18:],
        )

    def _workspace(self) -> "_Workspace":
        """A state to compute in, which is to be given back."""
        try:
            return self._workspaces.pop()
        except IndexError:  # another thread has it
            reader = copy.copy(self._reader)
            return _Workspace(self._model, self._data, reader, self._payload, self._gauges)


class _Workspace:
    """A state to compute in, of which no two threads have the same, and where it is read."""

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        reader: JacobianReader,
        payload: Payload,
        gauges: Displacements,
    ) -> None:
        """A copy of a state of the model, and a reader that nobody else reads by."""
        self.reader, self.data = reader, mujoco.MjData(model)
        mujoco.mj_copyData(self.data, model, data)
        self.qpos, self._seen = self.data.qpos, np.empty(18 + len(gauges.nominal))
        rotation, translation_m, self._task, displacement = np.split(self._seen, [9, 12, 18])
        self._observation = Struct(
            "observation",
            **payload.frames(self.data),
            **gauges.places(self.data),
            rotation=rotation,
            translation_m=translation_m,
            task=self._task,
            displacement=displacement,
            closure_residual_m=np.empty(1),
        )

    def seen(self) -> Array:
        """Pose, task displacement and those of the drives, (9 + 3 + 6 + n,), read-only."""
        angle = lib.observe(self._observation.pointer, 0, ffi.NULL, ffi.NULL, 0)
        principal(angle, self._task)
        return check.read_only(self._seen.copy())


def _spring_rows(K: Array) -> Array:
    """Rows (N, N) whose squares are the energy of a motion."""
    size, modes = np.linalg.eigh(K)
    return np.ascontiguousarray(np.sqrt(size.clip(0.0))[:, None] * modes.T)


def _checked(posture: JointPosture) -> JointPosture:
    return check.instance("posture", posture, JointPosture)
