"""How far each actuator may be commanded: its stroke, and the coil current that holds it there."""

import mujoco
import numpy as np
from numpy.typing import ArrayLike

import argument_checks as check
from sim.actuators import actuated_joints
from sim.amplifier import Amplifier
from sim.array import Array
from sim.ranges import ranges


def displacement_limits(
    model: mujoco.MjModel, amplifier: Amplifier, current_limit_a: ArrayLike | None = None
) -> tuple[Array, Array]:
    """Displacements at which actuators can rest: within the stroke, and within the current.

    At rest a coil balances its suspension, so a displacement l takes the current
    newton_per_m l / newton_per_a. What bends besides (flexures, the shifted weight) is neglected:
    0.1 % of the current in the hexapod. An actuator that is locked rests anywhere without current:
    its limits do not apply, and mappings of a failed mechanism leave them out.

    Args:
        model: Each actuator alone on a slide or hinge joint, gear 1; its stroke is the joint's
            range, infinite where the joint has none.
        amplifier: The drive chain of each actuator. 100 % of its input, its saturation and the
            largest code of its converter limit the current.
        current_limit_a: A smaller limit, for all or each of the actuators, shape () or (n,): what a
            hot coil may carry, for example. None is the amplifier's alone.

    Returns:
        Lower and upper displacement from the nominal position, shape (n,) each, [m].

    Raises:
        ModelError: There is no actuator, one has no joint of its own, or another gear.
        ValueError: A current is negative or not finite, or their number is wrong.
        TypeError: `model` or `amplifier` is of another type.
    """
    check.instance("model", model, mujoco.MjModel)
    check.instance("amplifier", amplifier, Amplifier)
    joints = actuated_joints(model)
    stroke = ranges(model).joint[model.jnt_dofadr[joints]]
    lower, upper = stroke.T - model.qpos0[model.jnt_qposadr[joints]]
    full_m = amplifier.full_input_a * amplifier.newton_per_a / amplifier.newton_per_m
    # The chain itself says what its converter leaves of full input: one code less upwards.
    least_m, most_m = amplifier.displacement_m(amplifier.input_percent(full_m * np.array([-2, 2])))
    if current_limit_a is not None:
        currents = check.not_negative("current_limit_a", current_limit_a)
        if currents.shape not in ((), joints.shape):
            raise ValueError(
                f"current_limit_a must be one number or {len(joints)}, got shape {currents.shape}"
            )
        held_m = currents * amplifier.newton_per_a / amplifier.newton_per_m
        least_m, most_m = np.maximum(least_m, -held_m), np.minimum(most_m, held_m)
    return np.maximum(lower, least_m), np.minimum(upper, most_m)
