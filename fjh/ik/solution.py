"""What is asked of a robot at one state, and what it answers."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fjh.ik.limits import RETURNING, RateLimits, VelocityLimits
from prioritized import ConstrainedSystem, Hierarchy, HierarchySolution, Kinematics, Status
from sim import Array, Jacobians
from sim.mjcf import listed

_LEAST = 1e-2
"""Damping of levels after the first one that is held back, per size of their rows."""


@dataclass(frozen=True, eq=False)
class IkProblem:
    """What is asked for at one state, solved with all its findings when it is asked for.

    Attributes:
        system: The robot at any pose.
        hierarchy: Its tasks there.
        jacobians: At this pose.
        limits: Of all velocities.
        targets: Of each level.
        held_back: Further rows of each level; see :class:`fjh.ik.overshoot.Trial`.
    """

    system: ConstrainedSystem
    hierarchy: Hierarchy
    jacobians: Jacobians
    limits: VelocityLimits
    targets: list[Array | list[Array]]
    held_back: tuple[Array, ...]

    @cached_property
    def kinematics(self) -> Kinematics:
        """The robot at this pose."""
        return self.system.at_pose(self.jacobians).kinematics()

    @cached_property
    def solved(self) -> tuple[HierarchySolution, bool]:
        """The solution, and whether all that is beyond a limit returns as it should."""
        limits = self.limits.of_rates(self.system.active, self.kinematics)
        solution = self._within(limits)
        if not limits.excludes_rest or solution.status is not Status.INFEASIBLE:
            return solution, not limits.is_cut
        for part in RETURNING[1:]:
            solution = self._within(limits.returning(part))
            if solution.status is not Status.INFEASIBLE:
                break
        return solution, False

    @property
    def velocities(self) -> Array:
        """Of all joints and other drives, (N,)."""
        return self.kinematics.velocities(self.solved[0].rates)

    @property
    def braking(self) -> Array | None:
        """The velocities of the next tick if all brake together, (N,); None: nothing need."""
        if self.limits.braking is None:
            return None
        C, rates = self.kinematics.active_constraint, self.limits.braking.first
        rates = rates[self.kinematics.active]
        return self.kinematics.velocities(rates - (C @ rates) @ C if C.size else rates)

    def _within(self, limits: RateLimits) -> HierarchySolution:
        there = self.hierarchy.at(self.kinematics, rate_limits=limits.box, rate_rows=limits.rows)
        if self.held_back:
            # Differences leave no null space exact: what is lost by round-off is not divided by.
            sizes = [float(np.linalg.norm(B)) for B in self.held_back]
            first = next(k for k, size in enumerate(sizes) if size)
            sizes[first + 1 :] = [size for _, size in there.weighted_rows[first + 1 :]]
            damping = tuple(
                max(own, _LEAST * size) for own, size in zip(there.damping, sizes, strict=True)
            )
            there = replace(there, damping_rows=self.held_back, damping=damping)
        return there.solve(self.targets)


@dataclass(frozen=True, eq=False)
class IkSolution:
    """The velocity of one tick.

    Attributes:
        qvel: Of all joints, shape (nv,).
        fraction: Part of the velocity that is left so that no geoms come too near; with
            accelerations, of the way to it from that with which all joints brake.
        is_led_back: Whether all that is beyond a limit returns as :class:`Limits` says.
        problem: What was asked for; the properties are found from it when they are asked for.
    """

    qvel: Array
    fraction: float
    is_led_back: bool
    problem: IkProblem

    @property
    def solution(self) -> HierarchySolution:
        """Rates of the actuators that survive; how each level is met."""
        return self.problem.solved[0]

    @property
    def kinematics(self) -> Kinematics:
        """The robot at that pose, from which static forces follow, too."""
        return self.problem.kinematics

    @property
    def torque_limits(self) -> tuple[Array, Array]:
        """Least and most force of each actuator that the model states, (n,) each.

        For `kinematics.force_mapping(torque_limits=...)`; zero of variables without an actuator.
        """
        force_range = self.problem.jacobians.force_range
        return force_range[:, 0], force_range[:, 1]

    @property
    def status(self) -> Status:
        """How the first level is met, and whether limits are."""
        return self.solution.status

    @property
    def exceeded(self) -> tuple[str, ...]:
        """Joints, tendons and pairs of geoms that are not kept within their limits.

        They are beyond these, or so fast that no acceleration within its limit stops them before.
        """
        return self.problem.limits.exceeded()

    @property
    def at_limits(self) -> tuple[str, ...]:
        """Joints, tendons and pairs of geoms whose limits hold the robot back at this tick."""
        (names, _), solution = self.problem.limits.names(), self.solution
        active = self.kinematics.active[solution.active_limits != 0]
        held_by = self.problem.limits.held_by(self.kinematics)
        rows = [held_by[k] for k in np.flatnonzero(solution.active_rows)]
        return tuple(dict.fromkeys((*(names[k] for k in active), *rows)))

    def __str__(self) -> str:
        """The status in words, with what is at a limit and what damping costs."""
        sentences = [self.solution.describe(self.at_limits)]
        if exceeded := self.exceeded:
            sentences.append(f"Beyond a limit, or too fast to stop before it: {listed(exceeded)}.")
        if not self.is_led_back:
            sentences.append("What is beyond a limit cannot return as fast as it should.")
        if self.fraction < 1.0 and self.problem.limits.braking is not None:
            sentences.append(f"All brake, but for {self.fraction:g} of the way to what was asked.")
        elif self.fraction < 1.0:
            sentences.append(f"The step is shortened to {self.fraction:g} of it to keep distances.")
        return " ".join(sentences)

    @property
    def residuals(self) -> tuple[Array, ...]:
        """What each level lacks of the velocity that its tasks ask for."""
        return self.solution.residuals
