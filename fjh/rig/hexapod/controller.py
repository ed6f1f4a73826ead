"""The hexapod's controller: the compensators of Fig. 3, the mapping to strut displacements."""

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
    """A compensator, and the margins of its loop on the sound plant."""


def design(plant: LinearPlant, pointing: Array, bench: TestbedConfig) -> tuple[Loop, Loop]:
    """The alpha and beta loops on the sound plant, their margins measured.

    Args:
        plant: Linear model of the sound plant.
        pointing: Gains from demanded (alpha, beta) to strut displacements, shape (n, 2).
        bench: Crossovers, roll-off and control period.

    Raises:
        sim.ModelError: The plant has not six degrees of freedom, a coil moves nothing, or a loop
            comes out unstable.
    """
    if plant.A.shape != (12, 12):
        raise ModelError(
            "without failures the machine must have six degrees of freedom, "
            f"it has {len(plant.A) // 2}"
        )
    P = sampled(plant, pointing, bench.control_period_s)
    alpha, beta = (
        Loop(**vars(each), **vars(margins(P[row, row] * each.discrete)))
        for row, each in enumerate(designed(plant, pointing, bench))
    )
    return alpha, beta


def designed(
    plant: LinearPlant, pointing: Array, bench: TestbedConfig
) -> tuple[Compensator, Compensator]:
    """The (alpha, beta) compensators of :func:`design`, without margins.

    Raises:
        sim.ModelError: A coil moves nothing, or a loop comes out unstable.
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
            f"the {angle} loop is unstable on this machine at a crossover of {hz} Hz: lower it, "
            "or give the struts more damping"
        ) from None
    except NoResponse:
        raise ModelError(f"the coils do not move {angle}") from None


def sampled(plant: LinearPlant, gain: Array, period_s: float) -> "control.StateSpace":
    """The plant behind a zero-order hold, from `gain`'s inputs to the twist."""
    import control  # late, as above

    continuous = control.ss(plant.A, plant.B @ gain, plant.C_twist, 0)
    return control.c2d(continuous, period_s, method="zoh")


NO_COMMAND = PreviousCommand(np.zeros(2), np.zeros(6), np.zeros(6))


class StrutJacobians(NamedTuple):
    """Of struts and payload, theta_dot = [l_dot; x_dot]: exact ones.

    Attributes:
        J_T: Twist of the payload, shape (6, 12).
        J_C: Of the six struts, shape (6, 12).
    """

    J_T: Array
    J_C: Array


class HexapodGeometry:
    """The closed-form geometry of the sound hexapod, as :class:`ftc.control.geometry.Geometry`."""

    def __init__(self, hexapod: Hexapod, *, constant: bool, stiffness: Array | None) -> None:
        """Take the nodes; `constant` evaluates the Jacobian at the nominal pose alone.

        `stiffness`, over [struts; payload twist], determines where a free strut goes.
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
        """Where l_dot = A x_dot."""
        if self.constant or pose is self.nominal:
            return self.system
        J_C = self.system.J_C.copy()
        np.negative(self.hexapod.inverse_jacobian(pose), out=J_C[:, 6:])
        return StrutJacobians(self.system.J_T, J_C)

    def twist(self, pose: Pose, displacements: Array) -> Array:
        """Payload twist (6,) of small strut displacements (6,)."""
        here = self.nominal if self.constant else self.hexapod.posture(pose)
        return here.twist(displacements)

    def moved(self, pose: Pose, displacements: Array) -> Pose:
        """The pose to which strut displacements (6,) lead, from the pose one tick before.

        One Newton step on the strut lengths; a tick moves so little that it lands within round-off.
        With the present Jacobian the pose comes with its struts, which the mapping and the next
        estimate need.
        """
        if self.constant:
            return NOMINAL.moved(self.nominal.twist(displacements))
        return self.hexapod.moved(pose, displacements)


def task_coordinates(pose: Pose) -> Array:
    """[alpha, beta, gamma, t_x, t_y, t_z] of a pose (6,), or of N poses (N, 6)."""
    secondary = secondary_motion(pose.rotation, pose.translation_m)
    return np.concatenate([pointing_angles(pose.rotation), secondary], axis=-1)


class StrutMapping(PrioritizedMapping[Pose]):
    """Optimal strut displacements for demanded (alpha, beta), eqs. (28) and (30)."""

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
        """Prepare the mapping at the nominal pose; "analytic" re-evaluates it at every call.

        `stiffness`, over [struts; payload twist], determines where a free strut goes; `limits`,
        lower and upper, are of the strut displacements, shape (6,) each; `allocate` as in
        :class:`ftc.PrioritizedMapping`.

        Raises:
            ValueError: Free or loose struts without stiffness: an unstable singularity. A strut
                locked off centre in incremental form: its displacement is in no increment.
        """
        self.geometry = geometry
        self.jacobian = jacobian
        if stiffness is None and (goal.free or goal.spring_lost):
            raise ValueError(
                "stiffness must be given for a goal with free or loose struts, got None"
            )
        own = HexapodGeometry(geometry, constant=jacobian == "constant", stiffness=stiffness)
        how = {"limits": limits, "when_limited": when_limited, "allocate": allocate}
        super().__init__(own, goal, MAJOR, SECONDARY, form, task_coordinates, **how)


def nominal_plant(model: mujoco.MjModel) -> tuple[LinearPlant, Array]:
    """The sound plant, linear, and W_a's strut displacements per (alpha, beta) at J_0, (6, 2).

    Raises:
        sim.ModelError: The machine is not a hexapod.
    """
    equal = StrutMapping(hexapod(model), Goal(joint_weight=(1.0,) * 6), "constant")
    sound = Plant(model)
    return linearize(sound.model, sound.data), equal.major_gain()


def nominal_loops(model: mujoco.MjModel, bench: TestbedConfig) -> tuple[Loop, Loop]:
    """The compensators, designed once on the sound plant with W_a and J_0.

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
    """The controller of this machine for a goal.

    Args:
        testbed: The machine, the constants around it, compensators.
        goal: Weights, and the failures that are known.
        jacobian: Where the mapping takes its Jacobian from.
        form: How eq. (41) becomes a displacement.
        feedforward: Whether the reference itself is demanded; in the paper it is not.
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
