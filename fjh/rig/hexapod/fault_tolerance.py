"""Fault tolerance of the hexapod: springs, failure atlas, dithers, diagnosis, supervisor."""

from dataclasses import replace

import mujoco
import numpy as np
import scipy.linalg

from fjh.rig.classification import Classification, classifications
from fjh.rig.hexapod.columns import MAJOR
from fjh.rig.hexapod.testbed import TestbedConfig
from ftc import Unused
from ftc.fdi import Dither, Fault, NominalModel
from prioritized import ConstrainedSystem, FailureAtlas
from sim import Array, Jacobians, Plant, jacobians
from sim.mjcf import element_id, joint_stiffness

STRUTS = tuple((f"strut{k}", f"coil{k}") for k in range(1, 7))
"""Names of the hexapod's actuators: in text, and in its MJCF file."""


def strut_and_payload_stiffness(model: mujoco.MjModel) -> Array:
    """Return the stiffness over [six strut displacements; payload twist in base axes], (12, 12).

    The suspensions are springs of the struts; the flexures act as springs of the payload.
    """
    jac, stiffness = _nominal_jacobians(model), joint_stiffness(model)
    flexures = stiffness.copy()
    flexures[jac.active] = 0.0
    # With the payload as the active joint of the mechanism, the passive rates follow it.
    free_joint = model.body_dofadr[element_id(model, "body", "payload")] + np.arange(6)
    kin = ConstrainedSystem(jac.J_T, jac.J_C, free_joint).kinematics()
    follow = kin.passive_gain @ np.linalg.inv(kin.J)  # passive rates per payload twist
    at_payload = follow.T @ (flexures[kin.passive, None] * follow)
    return scipy.linalg.block_diag(np.diag(stiffness[jac.active]), at_payload)


def _nominal_jacobians(model: mujoco.MjModel) -> Jacobians:
    return jacobians(model, mujoco.MjData(model), site="payload", axes="base")


def elastic_system(
    model: mujoco.MjModel, suspension: dict[int, float] | None = None
) -> ConstrainedSystem:
    """Return the mechanism of 42 velocities with its springs, at the nominal pose.

    Args:
        model: The hexapod.
        suspension: Stiffness of some struts' suspensions [N]/[m], by strut 0..5.
    """
    jac = _nominal_jacobians(model)
    system = ConstrainedSystem(jac.J_T, jac.J_C, jac.active, stiffness=joint_stiffness(model))
    return with_suspension(system, suspension or {})


def with_suspension(system: ConstrainedSystem, suspension: dict[int, float]) -> ConstrainedSystem:
    """Return an elastic system with other suspensions [N]/[m] of some struts 0..5."""
    stiffness = np.array(system.stiffness)
    for strut, value in suspension.items():
        velocity = system.active[strut]
        stiffness[velocity, velocity] = value
    return replace(system, stiffness=stiffness)


def pointing_classifications(atlas: FailureAtlas) -> list[Classification]:
    """Return the classes of the pointing task in the hexapod's atlas."""
    return classifications(atlas, task="pointing", body="payload")


HEAVE = (1.0,) * 6
"""Direction of the dither: all six struts lengthen together and move the payload along the line of
sight.

The six columns of J_m add up to zero, statically and, by the threefold symmetry of the machine, at
any frequency. If one strut does not move, the rest of the sum points along its own column: six
directions in the plane of (alpha, beta), 60 degrees apart, one for each strut.
"""

STILL = Dither(0.0, 0.0, HEAVE)

DITHER = Dither(0.5e-6, 20.0, HEAVE)
"""Dither of the hexapod: a failed strut causes 1.2 urad, four times the detector's noise. Its
frequency is above the loops' crossovers, below which the loops suppress it; below the modes from 32
Hz on, near which the linear model is less exact; and high enough for inertia to move a free strut.
"""

UNUSED: Unused = "locked"
"""Behavior of struts without force: the springs of their suspensions hold them."""


def nominal_model(
    model: mujoco.MjModel, bench: TestbedConfig, *, strut_sensors: bool = False
) -> NominalModel:
    """Return the linear model of the healthy machine.

    Args:
        model: The machine.
        bench: Periods and noise.
        strut_sensors: Whether the outputs are the six strut gauges after (alpha, beta), or (alpha,
            beta) alone.
    """
    import control  # late, as in ftc.compensator

    plant = Plant(model)
    linear = plant.linear()
    rows = [linear.C_twist[MAJOR]]
    noise = [np.full(2, bench.detector_noise_m / bench.focal_length_m)]
    if strut_sensors:
        rows.append(linear.C_active)
        noise.append(np.full(len(linear.C_active), bench.strut_sensor_noise_m))
    return NominalModel(
        plant=control.ss(linear.A, linear.B, np.vstack(rows), 0),
        displacement=linear.C_active,
        noise=np.concatenate(noise),
        period_s=bench.control_period_s,
        step_s=float(model.opt.timestep),
        spring=linear.spring,
        preload=linear.preload,
        floor=linear.B_floor[len(linear.A) // 2 :],
        names=[name for name, _ in STRUTS],
    )


def fault_text(fault: Fault | None) -> str:
    """Return a fault as text with its strut numbered from 1, such as "strut 1 weak to 50 %"."""
    if fault is None:
        return "healthy"
    remaining = f" to {100 * fault.effectiveness:.0f} %" if fault.kind == "weak" else ""
    return f"strut {fault.actuator + 1} {fault.kind}{remaining}"
