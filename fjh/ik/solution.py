"""Inverse-kinematics problem at one state, and its solution."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fjh.ik.limits import RETURNING, RateLimits, VelocityLimits
from prioritized import ConstrainedSystem, Hierarchy, HierarchySolution, Kinematics, Status
from sim import Array, Jacobians
from sim.mjcf import listed

_LEAST = 1e-2
"""Damping relative to the rows' size, for levels below the first one with damping rows."""


@dataclass(frozen=True, eq=False)
class IkProblem:
    """Inverse-kinematics problem at one state; it is solved when a property needs the solution.

    Attributes:
        system: Pose-independent mechanism.
        hierarchy: Pose-independent task levels.
        jacobians: Jacobians at this pose.
        limits: Limits of all velocities.
        targets: Targets of each level.
        damping_rows: Further rows of each level; see :class:`fjh.ik.overshoot.StepTest`.
    """

    system: ConstrainedSystem
    hierarchy: Hierarchy
    jacobians: Jacobians
    limits: VelocityLimits
    targets: list[Array | list[Array]]
    damping_rows: tuple[Array, ...]

    @cached_property
    def kinematics(self) -> Kinematics:
        """The robot at this pose."""
        return self.system.at_pose(self.jacobians).kinematics()

    @cached_property
    def solved(self) -> tuple[HierarchySolution, bool]:
        """Solution, and True if every quantity beyond its limit returns at the specified rate."""
        limits = self.limits.of_rates(self.system.active, self.kinematics)
        solution = self._within(limits)
        if not limits.excludes_braking or solution.status is not Status.INFEASIBLE:
            return solution, not limits.is_cut
        for part in RETURNING[1:]:
            solution = self._within(limits.returning(part))
            if solution.status is not Status.INFEASIBLE:
                break
        return solution, False

    @property
    def velocities(self) -> Array:
        """Velocities of all joints and other drives, (N,)."""
        return self.kinematics.velocities(self.solved[0].rates)

    @property
    def braking(self) -> Array | None:
        """Velocities of the next tick if all joints brake together, (N,); None if not needed."""
        if self.limits.braking is None:
            return None
        C, rates = self.kinematics.active_constraint, self.limits.braking.first
        rates = rates[self.kinematics.active]
        return self.kinematics.velocities(rates - (C @ rates) @ C if C.size else rates)

    def _within(self, limits: RateLimits) -> HierarchySolution:
        posed = self.hierarchy.at(self.kinematics, rate_limits=limits.box, rate_rows=limits.rows)
        if self.damping_rows:
            # Finite differences make no null space exact: damping avoids division by round-off.
            sizes = [float(np.linalg.norm(B)) for B in self.damping_rows]
            first = next(k for k, size in enumerate(sizes) if size)
            sizes[first + 1 :] = [size for _, size in posed.weighted_rows[first + 1 :]]
            damping = tuple(
                max(level_damping, _LEAST * size)
                for level_damping, size in zip(posed.damping, sizes, strict=True)
            )
            posed = replace(posed, damping_rows=self.damping_rows, damping=damping)
        return posed.solve(self.targets)


@dataclass(frozen=True, eq=False)
class IkSolution:
    """Joint velocities for one tick, with diagnostics.

    Attributes:
        qvel: Velocities of all joints, shape (nv,), [rad]/[s] or [m]/[s].
        fraction: Fraction of the step that keeps all distances; with acceleration limits, fraction
            of the way from braking to the solved velocities.
        is_led_back: True if every quantity beyond its limit returns at the rate of :class:`Limits`.
        problem: The problem, from which the properties are computed on demand.
    """

    qvel: Array
    fraction: float
    is_led_back: bool
    problem: IkProblem

    @property
    def solution(self) -> HierarchySolution:
        """Rates of the remaining actuators, and the status of each level."""
        return self.problem.solved[0]

    @property
    def kinematics(self) -> Kinematics:
        """Kinematics of the robot at this pose, for static forces as well."""
        return self.problem.kinematics

    @property
    def torque_limits(self) -> tuple[Array, Array]:
        """Lower and upper force limits of the actuators in the model, (n,) each, [N] or [N m].

        For `kinematics.force_mapping(torque_limits=...)`; zero for variables without an actuator.
        """
        force_range = self.problem.jacobians.force_range
        return force_range[:, 0], force_range[:, 1]

    @property
    def status(self) -> Status:
        """Status of the first level, of the limits and of the loops."""
        return self.solution.status

    @property
    def exceeded(self) -> tuple[str, ...]:
        """Joints, tendons and pairs of geoms that violate their limits.

        Each is beyond its limit, or too fast to stop before it within the acceleration limits.
        """
        return self.problem.limits.exceeded()

    @property
    def at_limits(self) -> tuple[str, ...]:
        """Joints, tendons and pairs of geoms whose limits are active at this tick."""
        (names, _), solution = self.problem.limits.names(), self.solution
        active = self.kinematics.active[solution.active_limits != 0]
        row_names = self.problem.limits.row_names(self.kinematics)
        rows = [row_names[k] for k in np.flatnonzero(solution.active_rows)]
        return tuple(dict.fromkeys((*(names[k] for k in active), *rows)))

    def __str__(self) -> str:
        """Return sentences on status, active and violated limits, and error due to damping."""
        sentences = [self.solution.describe(self.at_limits)]
        if exceeded := self.exceeded:
            sentences.append(f"Beyond a limit, or too fast to stop before it: {listed(exceeded)}.")
        if not self.is_led_back:
            sentences.append("A quantity beyond its limit cannot return at the specified rate.")
        if self.fraction < 1.0 and self.problem.limits.braking is not None:
            sentences.append(f"All joints brake; only {self.fraction:g} of the step is taken.")
        elif self.fraction < 1.0:
            sentences.append(f"The step is scaled by {self.fraction:g} to keep distances.")
        return " ".join(sentences)

    @property
    def residuals(self) -> tuple[Array, ...]:
        """Residual of each level: target minus achieved velocity, in the units of its rows."""
        return self.solution.residuals
