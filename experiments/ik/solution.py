"""What is asked of a robot at one state, and what it answers."""

from dataclasses import dataclass, replace
from functools import cached_property

from experiments.ik.limits import RateLimits, VelocityLimits
from prioritized import ConstrainedSystem, Hierarchy, HierarchySolution, Kinematics, Status
from sim import Array, Jacobians


@dataclass(frozen=True, eq=False)
class IkProblem:
    """What is asked for at one state, solved with all its findings when it is asked for.

    Attributes:
        system: The robot at any pose.
        hierarchy: Its tasks there.
        jacobians: At this pose.
        limits: Of all velocities.
        targets: Of each level.
        damping: Of each level that a step without it would not bring nearer; see
            :func:`experiments.ik.overshoot.damping_of`.
    """

    system: ConstrainedSystem
    hierarchy: Hierarchy
    jacobians: Jacobians
    limits: VelocityLimits
    targets: list[Array | list[Array]]
    damping: tuple[float, ...]

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
            return solution, True
        return self._within(limits.no_farther()), False

    @property
    def velocities(self) -> Array:
        """Of all joints and other drives, (N,)."""
        return self.kinematics.velocities(self.solved[0].rates)

    def _within(self, limits: RateLimits) -> HierarchySolution:
        there = self.hierarchy.at(self.kinematics, rate_limits=limits.box, rate_rows=limits.rows)
        if any(self.damping):
            units = self.kinematics.rate_units
            there = replace(
                there,
                damping=tuple(map(max, there.damping, self.damping)),
                damping_units=tuple(units if own else None for own in self.damping),
            )
        return there.solve(self.targets)


@dataclass(frozen=True, eq=False)
class IkSolution:
    """The velocity of one tick.

    Attributes:
        qvel: Of all joints, shape (nv,).
        fraction: Part of the velocity that is left so that no geoms come too near.
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
        machine = self.problem.jacobians.machine
        assert machine is not None
        return machine.force_range[:, 0], machine.force_range[:, 1]

    @property
    def status(self) -> Status:
        """How the first level is met, and whether limits are."""
        return self.solution.status

    def __str__(self) -> str:
        """The status in words, with what is at a limit and what damping costs."""
        sentences = [str(self.solution)]
        if not self.is_led_back:
            sentences.append("What is beyond a limit cannot return as fast as it should.")
        if self.fraction < 1.0:
            sentences.append(f"The step is shortened to {self.fraction:g} of it to keep distances.")
        return " ".join(sentences)

    @property
    def residuals(self) -> tuple[Array, ...]:
        """What each level lacks of the velocity that its tasks ask for."""
        return self.solution.residuals
