"""Inverse kinematics: joint velocities for tasks in strict priority levels, within limits."""

import warnings
from collections.abc import Iterable, Sequence
from contextlib import suppress
from copy import copy
from dataclasses import replace
from math import sqrt

import mujoco
import numpy as np

import argument_checks as check
from fjh.ik.levels import Levels
from fjh.ik.limits import Limits, VelocityLimits
from fjh.ik.overshoot import MISSED, NEGLIGIBLE, StepTest
from fjh.ik.solution import IkProblem, IkSolution
from prioritized import ConstrainedSystem
from sim import FRACTIONS, Array, Body, JacobianReader, Jacobians, Pin, TaskFunction, advance


class Ik:
    """Inverse-kinematics solver: joint velocities for several tasks in strict priority levels.

    Each level of tasks is achieved as far as limits, loops and the levels before it permit.
    Everything that does not depend on the pose is prepared once::

        hand = FrameTask("hand")
        ik = Ik(model, [hand, PostureTask(target=data.qpos)], Limits(velocity=2.0))
        while True:
            hand.target = pose
            ik.advance(data, ik.step(data, dt), dt, into=data)

    The tasks store their targets and gains, which the loop may set. Everything else is fixed at
    construction; after a failure, :meth:`with_failures` returns another solver. Both overwrite the
    same Jacobians, so use them in one thread.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        tasks: Sequence[TaskFunction | Sequence[TaskFunction]],
        limits: Limits | None = None,
        *,
        active: bool | Iterable[str | int] = (),
        pinned: Iterable[str | Body | Pin] = (),
    ) -> None:
        """Prepare a solver for a model, with its tasks from the highest to the lowest priority.

        Args:
            model: Any MuJoCo model.
            tasks: A task, or a list of tasks that are weighted against each other, for each level.
            limits: Limits; None is `Limits()`: the ranges that the model states.
            active: Unactuated joints that the solver may move, by name or number, such as the base
                of a walking robot; True: all of them.
            pinned: Frames fixed to the world, such as feet, as for :func:`sim.jacobians`.

        Raises:
            ModelError: A name does not exist, no active joint moves a task, or
                :func:`sim.jacobians` does not support the model.
            ValueError: There is no level, a level is empty, or a task occurs twice.
        """
        self._model = check.instance("model", model, mujoco.MjModel)
        self._levels = Levels.of(model, tasks)
        self._pinned = tuple(pinned) if isinstance(pinned, Iterable) else pinned
        read = {"pinned": self._pinned, "active": active}
        self._reader = JacobianReader(model, self._levels.read, **read)
        reader = JacobianReader(model, self._levels.read, closure_tolerance=np.inf, **read)
        self._scratch = reader, mujoco.MjData(model)
        jac = reader.at(self._scratch[1])
        for sentence in jac.structure.left_out:
            warnings.warn(sentence, RuntimeWarning, stacklevel=2)
        user_limits = Limits() if limits is None else check.instance("limits", limits, Limits)
        self._limits = user_limits.of(model, jac)
        system = ConstrainedSystem.of(jac)
        self._levels_of_tasks = self._levels.levels(system)
        self._prepare(system)

    def with_failures(
        self,
        locked: Iterable[int | str] = (),
        free: Iterable[int | str] = (),
        locked_passive: Iterable[int | str] = (),
    ) -> "Ik":
        """Return a solver for the robot with further failures, with the same task objects.

        `locked` and `free` are actuators, `locked_passive` joints without one, by name or number;
        see :meth:`prioritized.ConstrainedSystem.with_failures`.
        """
        failed = copy(self)
        failed._prepare(self._system.with_failures(locked, free, locked_passive))
        return failed

    def step(self, data: mujoco.MjData, dt: float) -> Array:
        """Return the joint velocities until the next tick, (nv,), in the order of `data.qvel`.

        Args:
            data: State with closed loops, whose frames are updated.
            dt: Time until the next tick [s].

        Raises:
            ClosureError: A loop is open: see :func:`sim.assemble`.
            ValueError: A task has no target, or does not fit the model.
        """
        period_s = check.number("dt", dt, *check.SECONDS)
        jac = self._reader.read(data)
        demand = self._at(data, period_s)
        v = self._compiled_solution(data, jac.J_T, jac.J_C, jac.error_bound, demand)
        if v is None or not self._approaches(data, jac.J_T, demand[1], v, period_s):
            return self._solution(data, period_s, self._reader.at(data), demand, v).qvel
        qvel, fraction = self._limited(data, v, demand[0], None)
        if fraction < 1.0 and demand[0].braking is not None and len(jac.J_C):
            return self._solution(data, period_s, self._reader.at(data), demand, v).qvel
        return qvel

    def solve(self, data: mujoco.MjData, dt: float) -> IkSolution:
        """Return the velocities of :meth:`step` with the status and residuals of all levels."""
        period_s = check.number("dt", dt, *check.SECONDS)
        jac = self._reader.at(data)
        demand = self._at(data, period_s)
        v = self._compiled_solution(data, jac.J_T, jac.J_C, jac.error_bound, demand)
        return self._solution(data, period_s, jac, demand, v)

    def advance(
        self, data: mujoco.MjData, qvel: Array, dt: float, into: mujoco.MjData | None = None
    ) -> mujoco.MjData:
        """Return the state after moving at `qvel` for `dt` [s], with all loops closed again.

        The result is written to `into`, which may be `data` and saves the time for a new state.
        Locked joints do not move for any `qvel`. A motion that is too long is shortened: `time`
        increases by its actual duration; see :func:`sim.advance`.
        """
        stuck = self._system.stuck
        velocity = check.array("qvel", qvel, self._model.nv).copy()
        velocity[stuck[stuck < len(velocity)]] = 0.0
        check.array("qvel times dt", velocity * check.number("dt", dt, check.SMALLEST))
        options = {"held": stuck.tolist(), "pinned": self._pinned}
        moved = advance(self._model, data, velocity, dt, **options, warn_of_misses=False, into=into)
        moved.qvel[:] = velocity
        return moved

    def _prepare(self, system: ConstrainedSystem) -> None:
        """Store a mechanism and the pose-independent part of its tasks' targets."""
        self._system, self._nominal_kinematics = system, (actuated := system.kinematics())
        self._hierarchy = actuated.hierarchy(self._levels_of_tasks)
        self._tick = self._hierarchy.tick(actuated)
        self._targets = self._levels.targets(actuated)
        self._step_test = StepTest(self._model, *self._scratch, self._targets, system)
        demand, units = self._targets.of_rows(), system.geometry.velocity_units
        self._rows = demand, 1.0 / system.geometry.task_units[: len(demand)], 1.0 / units
        self._scale = np.outer(self._rows[1], units)
        parts = [part for level in self._targets.levels for part in level]
        has_rates = any(part.among is not None for part in parts)
        self._has_free_rates = has_rates and not len(actuated.system.joints.moving)

    def _at(self, data: mujoco.MjData, period_s: float) -> tuple[VelocityLimits, Array]:
        """Return the limits of all velocities at an updated state, and the targets of the tasks."""
        check.array("data.qvel", data.qvel)
        limits = self._limits.at(data, period_s, self._nominal_kinematics)
        return limits, self._targets.at(data, period_s)

    def _compiled_solution(
        self,
        data: mujoco.MjData,
        J_T: Array,
        J_C: Array,
        error_bound: float,
        demand: tuple[VelocityLimits, Array],
    ) -> Array | None:
        """Return all velocities from one compiled call; None if it cannot certify the result."""
        if self._tick is None:
            return None
        limits, targets = demand
        v = self._tick(J_T, J_C, targets, limits.box, error_bound)
        if v is None or not limits.are_satisfied_by(v):
            return None
        return v if self._limits.tightened(data, limits, v) is None else None

    def _approaches(
        self, data: mujoco.MjData, J_T: Array, demand: Array, v: Array, period_s: float
    ) -> bool:
        """Return True if a step reduces the errors of all tasks, by a bound or by a test step.

        Joint tasks in the null space are not counted if no loops couple it.
        """
        rows, weight, of_rates = self._rows
        J, y, target = (J_T[: len(rows)] * self._scale, of_rates * v, weight * demand[rows])
        flat, moved = J.ravel(), J.dot(y)
        residual, h = target - moved, 0.25 * period_s * sqrt(flat.dot(flat))
        reduction = sqrt(target.dot(target)) - sqrt(residual.dot(residual))
        spare = MISSED * reduction + NEGLIGIBLE / period_s
        if h * y.dot(y) <= spare:
            return True
        if self._has_free_rates:
            with suppress(np.linalg.LinAlgError):  # if singular, a test step decides
                if 0.0 <= h * moved.dot(np.linalg.solve(J.dot(J.T), moved)) <= spare:
                    return True
        return self._step_test.comes_nearer(data, period_s * moved, period_s * demand, period_s * v)

    def _solution(
        self,
        data: mujoco.MjData,
        period_s: float,
        jac: Jacobians,
        demand: tuple[VelocityLimits, Array],
        compiled: Array | None,
    ) -> IkSolution:
        """Return the solution with diagnostics, from the compiled velocities if there are any."""
        limits, targets = demand[0], self._targets.of_levels(demand[1])
        problem = IkProblem(self._system, self._hierarchy, jac, limits, targets, ())
        if compiled is None:
            problem = self._tightened(data, problem)
        velocities = problem.velocities if compiled is None else compiled
        if not self._approaches(data, jac.J_T, demand[1], velocities, period_s):
            displacement, motion = period_s * demand[1], period_s * velocities
            rows = self._step_test.damping_rows(
                data, self._hierarchy, problem.kinematics, displacement, motion
            )
            if rows:
                problem, compiled = self._tightened(data, replace(problem, damping_rows=rows)), None
                velocities = problem.velocities
        qvel, fraction = self._limited(data, velocities, limits, problem.braking)
        return IkSolution(qvel, fraction, compiled is not None or problem.solved[1], problem)

    def _tightened(self, data: mujoco.MjData, problem: IkProblem) -> IkProblem:
        """Return the problem with limits corrected for tendons that rotate during the step."""
        for _ in range(_BENDS):
            tighter = self._limits.tightened(data, problem.limits, problem.velocities)
            if tighter is None:
                break
            problem = replace(problem, limits=tighter)
        return problem

    def _limited(
        self, data: mujoco.MjData, velocities: Array, limits: VelocityLimits, braked: Array | None
    ) -> tuple[Array, float]:
        """Return joint velocities (nv,) that keep distances, and the fraction of the step taken.

        With acceleration limits the result is on the line from the braking velocities `braked`
        (None: those of a mechanism without loops) to the given ones, so that braking afterwards
        keeps all limits.
        """
        nv, distances, braking = self._model.nv, self._limits.limits.distances, limits.braking
        if braking is None:
            if distances is None:
                return velocities[:nv], 1.0
            fraction = distances.safe_fraction(data, velocities[:nv], limits.period_s)
            return fraction * velocities[:nv], fraction
        first = braking.first if braked is None else braked
        least = braking.excess(first)

        def steps(fraction: float) -> list[tuple[Array, float]] | None:
            partly = first + fraction * (velocities - first)
            if not braking.keeps(partly, least):
                return None
            return [(partly[:nv], duration_s) for duration_s in braking.durations(partly)]

        if distances is None:
            feasible = (part for part in FRACTIONS if steps(part) is not None)
            fraction = next(feasible, 0.0)
        else:
            fraction = distances.largest_fraction(data, steps)
        return (first + fraction * (velocities - first))[:nv], fraction


_BENDS = 3
"""Largest number of corrections of a step for tendons that rotate during it."""
