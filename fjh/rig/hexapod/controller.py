"""Controller of the hexapod: compensators of Fig. 3 and the mapping to strut displacements."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import mujoco
import numpy as np

from fjh.rig.hexapod.closed_form import Hexapod, hexapod
from fjh.rig.hexapod.columns import MAJOR, SECONDARY
from fjh.rig.hexapod.detector import pointing_angles, secondary_motion
from fjh.rig.hexapod.testbed import Testbed, TestbedConfig
from fjh.rig.options import JacobianChoice
from ftc import Goal, LoopShape, PrioritizedController, PrioritizedMapping, compensator, margins
from ftc.control import (
    Compensator,
    DisplacementForm,
    Margins,
    NoResponse,
    PreviousCommand,
    UnstableLoop,
)
from prioritized import ConstrainedSystem, Kinematics, WhenLimited
from sim import NOMINAL, Array, LinearPlant, ModelError, Plant, Pose, linearize

if TYPE_CHECKING:
    import control

ANGLES = ("alpha", "beta")


@dataclass(frozen=True)
class Loop(Compensator, Margins):
    """Compensator, with the stability margins of its loop on the healthy plant."""


def design(plant: LinearPlant, pointing: Array, bench: TestbedConfig) -> tuple[Loop, Loop]:
    """Return the alpha and beta loops on the healthy plant, with their margins.

    Args:
        plant: Linear model of the healthy plant.
        pointing: Gains from demanded (alpha, beta) to strut displacements, shape (n, 2), [m]/[rad].
        bench: Crossovers, roll-off and control period.

    Raises:
        sim.ModelError: The plant does not have six degrees of freedom, a coil moves nothing, or a
            loop is unstable.
    """
    if plant.A.shape != (12, 12):
        raise ModelError(
            "without failures the machine must have six degrees of freedom, "
            f"it has {len(plant.A) // 2}"
        )
    P = sampled(plant, pointing, bench.control_period_s)
    alpha, beta = (
        Loop(**vars(loop), **vars(margins(P[row, row] * loop.discrete)))
        for row, loop in enumerate(designed(plant, pointing, bench))
    )
    return alpha, beta


def designed(
    plant: LinearPlant, pointing: Array, bench: TestbedConfig
) -> tuple[Compensator, Compensator]:
    """Return the (alpha, beta) compensators of :func:`design` without margins.

    Raises:
        sim.ModelError: A coil moves nothing, or a loop is unstable.
    """
    return _designed(plant, pointing, bench, 0), _designed(plant, pointing, bench, 1)


def _designed(plant: LinearPlant, pointing: Array, bench: TestbedConfig, row: int) -> Compensator:
    import control  # late, as in ftc.compensator

    hz, angle = bench.crossover_hz[row], ANGLES[row]
    channel = control.ss(plant.A, plant.B @ pointing[:, [row]], plant.C_twist[[MAJOR[row]]], 0)
    shape = LoopShape(hz, bench.roll_off_hz, bench.roll_off_damping)
    try:
        return compensator(channel, shape, bench.control_period_s)
    except UnstableLoop:
        raise ModelError(
            f"the {angle} loop is unstable on this machine at a crossover of {hz} Hz: choose "
            "a lower crossover, or give the struts more damping"
        ) from None
    except NoResponse:
        raise ModelError(f"the coils do not move {angle}") from None


def sampled(plant: LinearPlant, gain: Array, period_s: float) -> "control.StateSpace":
    """Return the zero-order-hold model of the plant from the inputs of `gain` to the twist."""
    import control  # late, as above

    continuous = control.ss(plant.A, plant.B @ gain, plant.C_twist, 0)
    return control.c2d(continuous, period_s, method="zoh")


NO_COMMAND = PreviousCommand(np.zeros(2), np.zeros(6), np.zeros(6))


class StrutJacobians(NamedTuple):
    """Exact Jacobians of struts and payload; theta_dot = [l_dot; x_dot], with shapes (6,) and (6,).

    Attributes:
        J_T: Jacobian of the payload twist, shape (6, 12).
        J_C: Jacobian of the six struts' closures, shape (6, 12).
    """

    J_T: Array
    J_C: Array


class HexapodGeometry:
    """Closed-form geometry of the healthy hexapod, a :class:`ftc.control.geometry.Geometry`."""

    def __init__(self, hexapod: Hexapod, *, constant: bool, stiffness: Array | None) -> None:
        """Take the nodes; `constant` fixes the Jacobian at that of the nominal pose.

        `stiffness`, over [struts; payload twist], determines the position of free struts.
        """
        self.hexapod, self.constant = hexapod, constant
        self.nominal = hexapod.posture(NOMINAL)
        self.system = ConstrainedSystem(
            J_T=np.hstack([np.zeros((6, 6)), np.eye(6)]),
            J_C=np.hstack([np.eye(6), -self.nominal.inverse_jacobian]),
            active=np.arange(6),
            stiffness=stiffness,
        )

    def jacobians(self, pose: Pose) -> "StrutJacobians | ConstrainedSystem":
        """Return the Jacobians of struts and payload at a pose, from l_dot = A x_dot."""
        if self.constant or pose is self.nominal:
            return self.system
        J_C = self.system.J_C.copy()
        np.negative(self.hexapod.inverse_jacobian(pose), out=J_C[:, 6:])
        return StrutJacobians(self.system.J_T, J_C)

    def twist(self, pose: Pose, displacements: Array) -> Array:
        """Return the payload twist (6,) of small strut displacements (6,)."""
        here = self.nominal if self.constant else self.hexapod.posture(pose)
        return here.twist(displacements)

    def moved(self, pose: Pose, displacements: Array) -> Pose:
        """Return the pose after strut displacements (6,), from the pose one tick before.

        This is one Newton step on the strut lengths, exact to round-off for the motion of a tick.
        With the analytic Jacobian the result is a `Posture`, which mapping and next estimate need.
        """
        if self.constant:
            return NOMINAL.moved(self.nominal.twist(displacements))
        return self.hexapod.moved(pose, displacements)


def task_coordinates(pose: Pose) -> Array:
    """Return [alpha, beta, gamma, t_x, t_y, t_z] of a pose (6,), or of N poses (N, 6)."""
    secondary = secondary_motion(pose.rotation, pose.translation_m)
    return np.concatenate([pointing_angles(pose.rotation), secondary], axis=-1)


class StrutMapping(PrioritizedMapping[Pose]):
    """Mapping from demanded (alpha, beta) to optimal strut displacements, eqs. (28) and (30)."""

    def __init__(
        self,
        geometry: Hexapod,
        goal: Goal,
        jacobian: JacobianChoice,
        stiffness: Array | None = None,
        form: DisplacementForm = "absolute",
        limits: tuple[Array, Array] | None = None,
        when_limited: WhenLimited = "least_squares",
        allocate: Callable[[Kinematics], Any] | None = None,
    ) -> None:
        """Prepare the mapping at the nominal pose; with "analytic" it is evaluated at each pose.

        `stiffness` (12, 12) over [struts; payload twist] determines the position of free struts;
        `limits` are lower and upper strut displacements, (6,) each [m]; `allocate` is that of
        :class:`ftc.PrioritizedMapping`.

        Raises:
            ValueError: Free or loose struts need a stiffness (without it they are an unstable
                singularity), or the incremental form cannot represent a strut locked off center.
        """
        self.geometry = geometry
        self.jacobian = jacobian
        if stiffness is None and (goal.free or goal.spring_lost):
            raise ValueError(
                "stiffness must be given for a goal with free or loose struts, got None"
            )
        struts = HexapodGeometry(geometry, constant=jacobian == "constant", stiffness=stiffness)
        options = {"limits": limits, "when_limited": when_limited, "allocate": allocate}
        super().__init__(struts, goal, MAJOR, SECONDARY, form, task_coordinates, **options)


def nominal_plant(model: mujoco.MjModel) -> tuple[LinearPlant, Array]:
    """Return the linear healthy plant, and the gain (6, 2) of W_a at the nominal pose.

    Raises:
        sim.ModelError: The machine is not a hexapod.
    """
    equal = StrutMapping(hexapod(model), Goal(joint_weight=(1.0,) * 6), "constant")
    plant = Plant(model)
    return linearize(plant.model, plant.data), equal.major_gain()


def nominal_loops(model: mujoco.MjModel, bench: TestbedConfig) -> tuple[Loop, Loop]:
    """Return the compensators, designed for the healthy plant with W_a at the nominal pose.

    Raises:
        sim.ModelError: The machine is not a hexapod, or its pointing loops cannot be closed.
    """
    return design(*nominal_plant(model), bench)


def controller_for(
    testbed: Testbed,
    goal: Goal,
    *,
    jacobian: JacobianChoice = "analytic",
    form: DisplacementForm = "absolute",
    feedforward: bool = False,
) -> PrioritizedController[Pose]:
    """Return the controller of this machine for a goal.

    Args:
        testbed: Machine, constants around it, compensators.
        goal: Weights, and the known failures.
        jacobian: Jacobian of the mapping.
        form: How eq. (41) becomes a displacement.
        feedforward: Whether the reference is added to the demand; in the paper it is not.
    """
    bench = testbed.bench
    return PrioritizedController(
        testbed.loops,
        StrutMapping(hexapod(testbed.model), goal, jacobian, testbed.stiffness, form),
        testbed.amplifier(),
        bench.handover_s,
        bench.demand_limit_rad,
        anti_windup=bench.anti_windup,
        reference_feedforward=feedforward,
    )
