"""Rows of J_T and J_C at one pose, written where they are wanted."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import mujoco
import numpy as np

import argument_checks as check
from sim.array import Array
from sim.closing.pin import LocatedPin
from sim.errors import ModelError
from sim.kinematics.structure import Structure
from sim.kinematics.task import HasRows, LocatedRows, Task
from sim.mjcf.frame import Located
from sim.mjcf.limits import stuck_rows
from sim.mjcf.transmission import drive_rows

Writer = Callable[[mujoco.MjModel, mujoco.MjData, Array], None]
"""Overwrites an array (k, nv) by rows per qvel."""


class TaskRows(NamedTuple):
    """Rows of one task.

    Attributes:
        write: What writes them.
        rows: Which they are in J_T.
        is_turned: Whether they are in the axes that a reader is given, and not in their own.
    """

    write: Writer
    rows: slice
    is_turned: bool


class RowSource(NamedTuple):
    """All whose names are looked up to read J_T and J_C of a model.

    Attributes:
        model: The model.
        tasks: One after the other.
        axes: In which velocities are expressed; None is the world.
        pins: Frames that stay.
        stuck: Which joints and tendons on their limits count as stuck: none, all, or by names.
        no_rows: Where none does, shape (0, nv).
    """

    model: mujoco.MjModel
    tasks: tuple[TaskRows, ...]
    axes: Located | None
    pins: tuple[LocatedPin, ...]
    stuck: bool | tuple[str, ...]
    no_rows: Array

    def rows(
        self, data: mujoco.MjData, now: Structure, spare: dict[int, "Matrices"]
    ) -> tuple[Array, Array]:
        """J_T (m, N) and J_C (c, N) as arrays of their own; `data` is up to date.

        Args:
            data: The pose.
            now: What no pose changes.
            spare: By the number of rows of limits matrices of :meth:`blank`, or none: to write in,
                by one thread at a time.

        Raises:
            ModelError, ValueError: As :meth:`write`; as :func:`stuck_rows`.
        """
        stuck = self.stuck_rows(data)
        to = spare.pop(len(stuck), None) or self.blank(now, len(stuck))
        self.write(data, now, stuck, to)
        found = to.J_T.copy(), to.J_C.copy()
        spare[len(stuck)] = to
        return found

    def stuck_rows(self, data: mujoco.MjData) -> Array:
        """Velocities (p, nv) that limits forbid, of which there may be more at another pose."""
        if not self.stuck:
            return self.no_rows
        return stuck_rows(self.model, data, self.stuck)

    def blank(self, now: Structure, stuck: int) -> "Matrices":
        """Matrices to be written, for so many rows of limits."""
        nv, E = self.model.nv, len(now.extra)
        heights = [len(now.closures.units), E, *(pin.height for pin in self.pins), stuck]
        ends = np.cumsum(heights).tolist()
        J_T, J_C = np.zeros((self.tasks[-1].rows.stop, nv + E)), np.zeros((ends[-1], nv + E))
        J_C[ends[0] : ends[1], nv:] = -np.eye(E)
        # MuJoCo writes rows of nv numbers, one after the other.
        tasks, forbidden = (np.zeros((len(J), nv)) if E else J for J in (J_T, J_C))
        parts = [forbidden[end - k : end] for end, k in zip(ends, heights, strict=True)]
        closures, drives, *pins, limits = parts
        return Matrices(
            J_T,
            J_C,
            tasks,
            forbidden,
            tuple(self._part(task, tasks[task.rows]) for task in self.tasks),
            closures,
            drives,
            tuple(pins),
            limits,
        )

    def _part(self, task: TaskRows, out: Array) -> tuple[Array, tuple[Array, Array] | None]:
        if self.axes is None or not task.is_turned:
            return out, None
        world = np.empty_like(out)
        return world, (world.reshape(-1, 3, world.shape[1]), out.reshape(-1, 3, out.shape[1]))

    def write(self, data: mujoco.MjData, now: Structure, stuck: Array, to: "Matrices") -> None:
        """Overwrite what a pose changes of J_T and J_C.

        Args:
            data: The pose, up to date.
            now: What no pose changes.
            stuck: Rows of limits, shape (p, nv).
            to: Where, of :meth:`blank`.

        Raises:
            ModelError: Rows of closures or transmissions are not finite.
            ValueError: A task has other rows than it says.
        """
        model = self.model
        for task, (out, blocks) in zip(self.tasks, to.of_tasks, strict=True):
            task.write(model, data, out)
            if blocks is not None and self.axes is not None:
                np.matmul(self.axes.rotation(data).T, blocks[0], out=blocks[1])
        now.closures.write_rows(model, data, to.closures)
        for pin, out in zip(self.pins, to.pins, strict=True):
            pin.frame.write_jacobian(model, data, out)
        if len(stuck):
            to.limits[:] = stuck
        if now.extra:  # row qvel less its own velocity is zero
            mujoco.mj_transmission(model, data)
            to.drives[:] = drive_rows(model, data, now.extra)
            to.J_T[:, : model.nv], to.J_C[:, : model.nv] = to.tasks, to.forbidden
        if not check.is_moderate(to.forbidden):
            raise ModelError("an equality or a transmission of the model is not finite")


class Matrices(NamedTuple):
    """J_T and J_C, and which parts of them are written.

    Attributes:
        J_T: Shape (m, N).
        J_C: Shape (c, N): rows of closures, transmissions, pins and limits.
        tasks: What J_T is per qvel, shape (m, nv): itself where no other velocities are.
        forbidden: Likewise of J_C, (c, nv).
        of_tasks: Rows that a task writes; those in the axes of the world, and of `tasks`, as blocks
            (., 3, nv), where it is turned.
        closures: Of `forbidden`.
        drives: Likewise.
        pins: Likewise, of each.
        limits: Likewise.
    """

    J_T: Array
    J_C: Array
    tasks: Array
    forbidden: Array
    of_tasks: tuple[tuple[Array, tuple[Array, Array] | None], ...]
    closures: Array
    drives: Array
    pins: tuple[Array, ...]
    limits: Array


def task_rows(
    tasks: Sequence[tuple[Task, LocatedRows]],
) -> tuple[TaskRows, ...]:
    """What writes the rows of tasks that are looked up, one after the other."""
    found, start = list[TaskRows](), 0
    for task, located in tasks:
        rows = slice(start, start := start + len(located.angular))
        write = getattr(located, "write_jacobian", None) or partial(_copy, task, located)
        found.append(TaskRows(write, rows, is_turned=not isinstance(task, HasRows)))
    return tuple(found)


def _copy(
    task: Task, located: LocatedRows, model: mujoco.MjModel, data: mujoco.MjData, out: Array
) -> None:
    """Of a task of a user's own, which may have other rows than it says."""
    out[:] = check.exactly(
        f"the Jacobian of {check.shown(task)}", located.jacobian(model, data), *out.shape
    )
