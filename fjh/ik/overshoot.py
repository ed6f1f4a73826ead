"""Steps that come no nearer to a target, and what holds them back so that they do, or rest."""

from typing import NamedTuple

import mujoco
import numpy as np

from fjh.ik.levels import Part, Targets
from prioritized import ConstrainedSystem, Hierarchy, Kinematics
from sim import Array, JacobianReader

MISSED = 0.5
"""Part of a way, or of what the Jacobian says that a step lowers an error by, that it may miss."""
NEGLIGIBLE = 1e-14
"""Errors in natural units that no step needs to lower."""
_FAR = 1.0
"""Motion in natural units, 1 rad for one, as far as a step is tried: none is taken farther."""
_SMALL = 1e-6
"""Of steps in natural units that differences are taken of."""
_CLEAR = 1e-6
"""Part of the largest singular value or eigenvalue below which one counts as none."""


class Trial(NamedTuple):
    """A state in which steps are tried.

    Attributes:
        model: The robot.
        reader: Of its Jacobians, loops closed or not.
        data: The state; overwritten.
        targets: Of all tasks.
        system: The robot at any pose, with its failures.
    """

    model: mujoco.MjModel
    reader: JacobianReader
    data: mujoco.MjData
    targets: Targets
    system: ConstrainedSystem

    def held_back(
        self,
        at: mujoco.MjData,
        hierarchy: Hierarchy,
        kinematics: Kinematics,
        way: Array,
        motion: Array,
    ) -> tuple[Array, ...]:
        """Further rows of each level that a motion does not bring nearer; () where all come nearer.

        The motion is tried: of each level that which its rows and those of levels before it need.
        A level that misses half of its way, as before a target out of reach, gets the second
        derivative of its error besides the first: rows whose squares are |S|, S being what the
        error times the second derivatives of its rows are, less those of levels before it that
        must not move. So the step is that of Newton, or a damping of Levenberg and Marquardt (here
        in each direction what it must be) that vanishes with the error: the robot comes to rest
        where it is nearest. What does not curve the error is left to the levels after it.

        Args:
            at: Where the motion begins.
            hierarchy: The levels there.
            kinematics: The robot there.
            way: What all tasks ask for until the next tick, (t,).
            motion: Of all velocities, (N,).
        """
        units, far = _rate_units(kinematics), dict[int, tuple[Array, Array]]()
        J, step = kinematics.J * units, motion[kinematics.active] / units
        before, allowed = np.zeros((0, len(units))), 0.0
        above = np.zeros((0, len(J)))
        for k, (parts, own) in enumerate(
            zip(hierarchy.specs.levels, self.targets.levels, strict=True)
        ):
            tasks = [(p.matrix, p.S, q) for p, q in zip(parts, own, strict=True) if p.S is not None]
            if not tasks:
                continue
            S = np.vstack([W @ S for W, S, _ in tasks])
            wanted = np.concatenate([W @ way[q.own] for W, _, q in tasks])
            A, size = S @ J, float(np.linalg.norm(wanted))
            h = float(np.linalg.norm(A, axis=0).sum())
            if h and size and not any(q.task.damping is not None for *_, q in tasks):
                stack = np.vstack([before, A / h])
                alone = units * np.linalg.lstsq(stack, stack @ step)[0]
                self._move(at, kinematics.velocities(alone))
                left = [self._error(q) - (1.0 / q.task.gain - 1.0) * way[q.own] for *_, q in tasks]
                missed = np.concatenate([W @ e for (W, *_), e in zip(tasks, left, strict=True)])
                if np.linalg.norm(missed) <= MISSED * (size + h * allowed):
                    before, allowed = stack, allowed + size / h
                else:
                    of_rows = S.T @ wanted
                    force = np.linalg.lstsq((above @ J).T, J.T @ of_rows, _CLEAR)[0]
                    far[k] = A, of_rows - above.T @ force
            above = np.vstack([above, S])
        if not far:
            return ()
        bend, rows = (
            self._bend(at, kinematics),
            [np.zeros((0, len(units)))] * len(self.targets.levels),
        )
        for k, (A, of_rows) in far.items():
            least = _CLEAR * float(np.linalg.norm(J) * np.linalg.norm(of_rows))
            curved = _root(bend @ of_rows, least)
            # What hardly moves the error, and does not curve it, is no way to lower it.
            size, V = np.linalg.svd(A, full_matrices=False)[1:]
            idle = float(np.linalg.norm(curved)) * V[size < _CLEAR * size.max()]
            rows[k] = np.vstack([curved, idle]) / units if len(curved) else curved
        return tuple(rows) if any(map(len, rows)) else ()

    def comes_nearer(self, at: mujoco.MjData, moved: Array, way: Array, motion: Array) -> bool:
        """Whether the error of each level falls by half of what the Jacobian says, or more.

        Args:
            at: Where the motion begins.
            moved: How far the Jacobian says that the rows of all tasks come, in natural units.
            way: What all tasks ask for until the next tick, (t,).
            motion: Of all velocities, (N,).
        """
        geometry, first = self.system.geometry, 0
        part = min(1.0, _FAR / max(_FAR, np.abs(motion / geometry.velocity_units).max()))
        moved = part * moved
        self._move(at, part * motion)
        for level in self.targets.levels:
            sizes = np.zeros(3)
            for part in (each for each in level if each.among is None):
                rows = slice(first, first := first + part.size)
                error = way[part.own] / part.task.gain / geometry.task_units[rows]
                left = self._error(part) / geometry.task_units[rows]
                sizes += [e.dot(e) for e in (error, error - moved[rows], left)]
            before, predicted, after = np.sqrt(sizes)
            is_free = all(part.task.damping is None for part in level)
            allowed = before - (1.0 - MISSED) * (before - predicted) + NEGLIGIBLE
            if is_free and after > allowed:
                return False
        return True

    def _move(self, at: mujoco.MjData, motion: Array) -> None:
        """Go to the state after a motion (N,), loops not closed again."""
        there = self.data
        there.time, there.qpos[:], there.eq_active[:] = at.time, at.qpos, at.eq_active
        there.mocap_pos[:], there.mocap_quat[:] = at.mocap_pos, at.mocap_quat
        mujoco.mj_integratePos(self.model, there.qpos, motion[: self.model.nv], 1.0)
        self.reader.read(there)

    def _error(self, part: Part) -> Array:
        """What is left after the motion."""
        return part.located.error(self.model, self.data)

    def _bend(self, at: mujoco.MjData, kinematics: Kinematics) -> Array:
        """Second derivatives of all rows by the rates in natural units, (n, n, m)."""
        units, loops = _rate_units(kinematics), kinematics.system.joints.moving
        motions = kinematics.velocities(np.diag(units))
        rows = []
        for motion in (0.0 * motions[0], *motions):
            self._move(at, _SMALL * motion)
            if len(loops):  # passive joints follow otherwise, too
                there = self.system.at_pose(self.reader.at(self.data)).kinematics()
                rows.append(there.J * units)
            else:
                rows.append(self.reader.read(self.data).J_T @ motions.T)
        return np.transpose((np.array(rows[1:]) - rows[0]) / _SMALL, (0, 2, 1))


def _root(S: Array, least: float) -> Array:
    """Rows B with B^T B = |S|, of eigenvalues without their sign that are clearly not zero."""
    size, V = np.linalg.eigh(0.5 * (S + S.T))
    size = np.abs(size)
    kept = size > least
    return np.sqrt(size[kept])[:, None] * V[:, kept].T


def _rate_units(kinematics: Kinematics) -> Array:
    """Natural units of the rates, (n,)."""
    return kinematics.system.geometry.velocity_units[kinematics.active]
