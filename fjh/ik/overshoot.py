"""Test whether a step reduces the task errors, and damping rows for steps that do not."""

from typing import NamedTuple

import mujoco
import numpy as np

from fjh.ik.levels import Part, Targets
from prioritized import ConstrainedSystem, Hierarchy, Kinematics
from sim import Array, JacobianReader

MISSED = 0.5
"""Largest fraction of the predicted error reduction, or of the target, that may be missed."""
NEGLIGIBLE = 1e-14
"""Error in natural units that need not be reduced."""
_FAR = 1.0
"""Largest test step in natural units, such as 1 rad; longer steps are shortened for the test."""
_SMALL = 1e-6
"""Step in natural units of finite differences."""
_ZERO = 1e-6
"""Relative threshold below which a singular value or eigenvalue counts as zero."""


class StepTest(NamedTuple):
    """Test of steps from a state.

    Attributes:
        model: The robot.
        reader: Reader of its Jacobians, with loops closed or open.
        data: State for test steps, overwritten by each.
        targets: Targets of all tasks.
        system: The robot at any pose, with its failures.
    """

    model: mujoco.MjModel
    reader: JacobianReader
    data: mujoco.MjData
    targets: Targets
    system: ConstrainedSystem

    def damping_rows(
        self,
        at: mujoco.MjData,
        hierarchy: Hierarchy,
        kinematics: Kinematics,
        target: Array,
        motion: Array,
    ) -> tuple[Array, ...]:
        """Return damping rows of each level that a motion does not improve; () if there is none.

        For each level the part of the motion that its rows and those of previous levels need is
        tested. A level that misses half of its target, for example because it is out of reach, gets
        damping rows B with B^T B = |S|, where S is its error times the second derivatives of its
        rows, minus those of previous levels, which must not move. The step is then a Newton step,
        or a Levenberg-Marquardt step with the required damping in each direction, which vanishes
        with the error: the robot comes to rest at the minimum. Directions without curvature are
        left to the following levels.

        Args:
            at: State where the motion starts.
            hierarchy: Levels at this state.
            kinematics: Kinematics at this state.
            target: Targets of all tasks until the next tick, (t,).
            motion: Displacements of all velocities, (N,).
        """
        units, missed = _rate_units(kinematics), dict[int, tuple[Array, Array]]()
        J, step = kinematics.J * units, motion[kinematics.active] / units
        before, allowed = np.zeros((0, len(units))), 0.0
        above = np.zeros((0, len(J)))
        levels = zip(hierarchy.specs.levels, self.targets.levels, strict=True)
        for k, (parts, level) in enumerate(levels):
            pairs = zip(parts, level, strict=True)
            tasks = [(p.matrix, p.S, q) for p, q in pairs if p.S is not None]
            if not tasks:
                continue
            S = np.vstack([W @ S for W, S, _ in tasks])
            target_rows = np.concatenate([W @ target[q.slot] for W, _, q in tasks])
            A, size = S @ J, float(np.linalg.norm(target_rows))
            h = float(np.linalg.norm(A, axis=0).sum())
            if h and size and not any(q.task.damping is not None for *_, q in tasks):
                stack = np.vstack([before, A / h])
                level_motion = units * np.linalg.lstsq(stack, stack @ step)[0]
                self._move(at, kinematics.velocities(level_motion))
                errors = [
                    self._error(q) - (1.0 / q.task.gain - 1.0) * target[q.slot] for *_, q in tasks
                ]
                residual = np.concatenate([W @ e for (W, *_), e in zip(tasks, errors, strict=True)])
                if np.linalg.norm(residual) <= MISSED * (size + h * allowed):
                    before, allowed = stack, allowed + size / h
                else:
                    of_rows = S.T @ target_rows
                    force = np.linalg.lstsq((above @ J).T, J.T @ of_rows, _ZERO)[0]
                    missed[k] = A, of_rows - above.T @ force
            above = np.vstack([above, S])
        if not missed:
            return ()
        curvature = self._curvature(at, kinematics)
        rows = [np.zeros((0, len(units)))] * len(self.targets.levels)
        for k, (A, of_rows) in missed.items():
            least = _ZERO * float(np.linalg.norm(J) * np.linalg.norm(of_rows))
            curved = _root(curvature @ of_rows, least)
            # Directions with neither slope nor curvature of the error do not reduce it.
            size, V = np.linalg.svd(A, full_matrices=False)[1:]
            flat = float(np.linalg.norm(curved)) * V[size < _ZERO * size.max()]
            rows[k] = np.vstack([curved, flat]) / units if len(curved) else curved
        return tuple(rows) if any(map(len, rows)) else ()

    def comes_nearer(self, at: mujoco.MjData, moved: Array, target: Array, motion: Array) -> bool:
        """Return True if a motion reduces each level's error by at least half of the prediction.

        Args:
            at: State where the motion starts.
            moved: Displacement of the rows of all tasks by the Jacobian, in natural units.
            target: Targets of all tasks until the next tick, (t,).
            motion: Displacements of all velocities, (N,).
        """
        geometry, first = self.system.geometry, 0
        part = min(1.0, _FAR / max(_FAR, np.abs(motion / geometry.velocity_units).max()))
        moved = part * moved
        self._move(at, part * motion)
        for level in self.targets.levels:
            sizes = np.zeros(3)
            for part in (part for part in level if part.among is None):
                rows = slice(first, first := first + part.size)
                error = target[part.slot] / part.task.gain / geometry.task_units[rows]
                remaining = self._error(part) / geometry.task_units[rows]
                sizes += [e.dot(e) for e in (error, error - moved[rows], remaining)]
            before, predicted, after = np.sqrt(sizes)
            is_free = all(part.task.damping is None for part in level)
            allowed = before - (1.0 - MISSED) * (before - predicted) + NEGLIGIBLE
            if is_free and after > allowed:
                return False
        return True

    def _move(self, at: mujoco.MjData, motion: Array) -> None:
        """Move to the state after a motion (N,), without closing loops."""
        there = self.data
        there.time, there.qpos[:], there.eq_active[:] = at.time, at.qpos, at.eq_active
        there.mocap_pos[:], there.mocap_quat[:] = at.mocap_pos, at.mocap_quat
        mujoco.mj_integratePos(self.model, there.qpos, motion[: self.model.nv], 1.0)
        self.reader.read(there)

    def _error(self, part: Part) -> Array:
        return part.located.error(self.model, self.data)

    def _curvature(self, at: mujoco.MjData, kinematics: Kinematics) -> Array:
        """Return second derivatives of all rows by the rates in natural units, (n, n, m)."""
        units, loops = _rate_units(kinematics), kinematics.system.joints.moving
        motions = kinematics.velocities(np.diag(units))
        rows = []
        for motion in (0.0 * motions[0], *motions):
            self._move(at, _SMALL * motion)
            if len(loops):  # the passive joints' motion changes, too
                there = self.system.at_pose(self.reader.at(self.data)).kinematics()
                rows.append(there.J * units)
            else:
                rows.append(self.reader.read(self.data).J_T @ motions.T)
        return np.transpose((np.array(rows[1:]) - rows[0]) / _SMALL, (0, 2, 1))


def _root(S: Array, least: float) -> Array:
    """Return rows B with B^T B = |S|, from eigenvalues that are clearly nonzero."""
    size, V = np.linalg.eigh(0.5 * (S + S.T))
    size = np.abs(size)
    significant = size > least
    return np.sqrt(size[significant])[:, None] * V[:, significant].T


def _rate_units(kinematics: Kinematics) -> Array:
    """Return the natural units of the rates, (n,)."""
    return kinematics.system.geometry.velocity_units[kinematics.active]
