"""Steps that come no nearer to a target, and the damping with which they do, or rest."""

from typing import NamedTuple

import mujoco
import numpy as np

from experiments.ik.levels import Part, Targets
from prioritized import Hierarchy, Kinematics
from sim import Array
from sim.kinematics.structure import bring_up_to_date

MISSED = 0.5
"""Part of the way that is asked for that a step may miss."""


class Trial(NamedTuple):
    """A state in which steps are tried.

    Attributes:
        model: The robot.
        data: The state; overwritten.
        targets: Of all tasks.
    """

    model: mujoco.MjModel
    data: mujoco.MjData
    targets: Targets

    def damping(
        self,
        at: mujoco.MjData,
        hierarchy: Hierarchy,
        kinematics: Kinematics,
        way: Array,
        motion: Array,
    ) -> tuple[float, ...]:
        """Damping of each level that a motion without any does not bring nearer.

        The motion is tried: of each level that which its rows and those of levels before it need.
        Where it misses half of the way, as before a target out of reach, the squares of the level's
        singular values count as 2 h |way| at least. The sum h of the norms of its Jacobian's
        columns bounds the second derivative, because no column changes faster with a joint than by
        its own length. So the step is stiffer than half of what the error is curved, and the robot
        comes to rest, at any distance: the method of Levenberg and Marquardt with a damping in
        proportion to the error (Sugihara, 2011; Fan and Yuan, 2005).

        Args:
            at: Where the motion begins.
            hierarchy: The levels there.
            kinematics: The robot there.
            way: What all tasks ask for until the next tick, (t,).
            motion: Of all velocities, (N,).
        """
        units, damping = kinematics.rate_units, list[float]()
        J, step = kinematics.J * units, motion[kinematics.active] / units
        before, allowed = np.zeros((0, len(units))), 0.0
        for parts, own in zip(hierarchy.asked.levels, self.targets.levels, strict=True):
            damping.append(0.0)
            tasks = [(p, q) for p, q in zip(parts, own, strict=True) if p.S is not None]
            if not tasks or any(part.task.damping is not None for _, part in tasks):
                continue
            A = np.vstack([p.weighted(*kinematics.J.shape)[0] @ J for p, _ in tasks])
            size = float(np.linalg.norm(np.concatenate([p.matrix @ way[q.own] for p, q in tasks])))
            h = float(np.linalg.norm(A, axis=0).sum())
            if not (h and size):
                continue
            stack = np.vstack([before, A / h])
            alone = units * np.linalg.lstsq(stack, stack @ step)[0]
            self._move(at, kinematics.velocities(alone)[: self.model.nv])
            missed = [p.matrix @ self._missed(q, way[q.own]) for p, q in tasks]
            if np.linalg.norm(np.concatenate(missed)) <= MISSED * (size + h * allowed):
                before, allowed = stack, allowed + size / h
            else:
                damping[-1] = float(np.sqrt(h * size))
        return tuple(damping)

    def _move(self, at: mujoco.MjData, motion: Array) -> None:
        """Go to the state after a motion (nv,), loops not closed again."""
        there = self.data
        there.time, there.qpos[:] = at.time, at.qpos
        there.mocap_pos[:], there.mocap_quat[:] = at.mocap_pos, at.mocap_quat
        mujoco.mj_integratePos(self.model, there.qpos, motion, 1.0)
        bring_up_to_date(self.model, there)

    def _missed(self, part: Part, way: Array) -> Array:
        """Of a way that is a part of the error, what is left of it after the motion."""
        gain = part.task.gain
        return part.located.error(self.model, self.data) - (1.0 - gain) / gain * way
