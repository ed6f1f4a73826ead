"""A controller's own model of a mechanism: its kinematics at any joint positions."""

import copy
from collections.abc import Iterable
from dataclasses import dataclass

import mujoco
import numpy as np
import scipy.linalg
from numpy.typing import NDArray

import argument_checks as check
from sim.array import Array
from sim.closing.pin import Pin
from sim.kinematics.displacements import Displacements
from sim.kinematics.jacobian import Jacobians
from sim.kinematics.payload import Payload
from sim.kinematics.pose import Pose, computed
from sim.kinematics.reader import JacobianReader
from sim.mjcf.frame import Body, located
from sim.mjcf.model import check_state, start_of
from sim.mjcf.transmission import drives

_LOOPS_FIRST = 1e4
"""Weight of the closures against the commanded displacements, which may contradict them."""
_SPRINGS_LAST = 1e-4
"""Weight of the springs, which decide only what closures and displacements leave free."""
_ROUND_OFF = 1e-10


@dataclass(frozen=True, eq=False)
class JointPosture:
    """Joint positions, and what follows from them.

    Attributes:
        qpos: As in `data.qpos`, shape (nq,).
        pose: Of the task frame, relative to the nominal one, as :meth:`Plant.pose`.
        jacobians: At these positions.
        gaps: Of the closures, in the units of their rows, shape (c,).
        displacements: Of the active velocities from the nominal posture, shape (n,).
    """

    qpos: Array
    pose: Pose
    jacobians: Jacobians
    gaps: Array
    displacements: Array

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
        self._springs: Array | None = None
        # Each call takes one to compute in: no two threads have the same.
        self._scratch = [copy.copy(self._data)]
        self.nominal = self._posture(self._data.qpos.copy())

        if springs and (K := self.nominal.jacobians.stiffness) is not None:
            size, modes = np.linalg.eigh(K)
            weights = _SPRINGS_LAST * np.sqrt(size.clip(0.0) / max(size[-1], _ROUND_OFF))
            self._springs = weights[:, None] * modes.T

    def jacobians(self, posture: JointPosture) -> Jacobians:
        """The Jacobians in a posture."""
        return _checked(posture).jacobians

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
        jac = _checked(posture).jacobians
        J_C = jac.J_C
        held = check.indices("held", held, len(posture.displacements))
        displacements = check.exactly("displacements", displacements, len(posture.displacements))
        missing = (displacements - posture.displacements)[held]
        if not posture.gaps.any() and np.abs(missing).max(initial=0.0) == 0.0:
            return posture
        rows = np.zeros((len(held), J_C.shape[1]))
        rows[np.arange(len(held)), jac.active[held]] = 1.0
        gaps = np.zeros(len(J_C))
        gaps[: len(posture.gaps)] = posture.gaps
        springs = rows[:0] if self._springs is None else self._springs
        step = scipy.linalg.lstsq(
            np.vstack([_LOOPS_FIRST * J_C, rows, springs]),
            np.concatenate([-_LOOPS_FIRST * gaps, missing, np.zeros(len(springs))]),
            cond=_ROUND_OFF,
            lapack_driver="gelsy",
            check_finite=False,
        )[0]
        qpos = posture.qpos.copy()
        mujoco.mj_integratePos(self._model, qpos, step[: self._model.nv], 1.0)
        return self._posture(qpos)

    def _posture(self, qpos: Array) -> JointPosture:
        """Everything at these joint positions."""
        try:
            data = self._scratch.pop()
        except IndexError:  # another thread has it
            data = copy.copy(self._data)
        data.qpos[:] = qpos
        jac = self._reader.at(data)
        self._gauges.refresh(self._model, data)
        gaps = data.efc_pos[: data.ne].copy()
        here = {"pose": self._payload.pose(data), "jacobians": jac, "gaps": gaps}
        here["displacements"] = self._gauges.read(data)
        self._scratch.append(data)
        return computed(JointPosture, qpos=qpos, **here)


def _checked(posture: JointPosture) -> JointPosture:
    return check.instance("posture", posture, JointPosture)
