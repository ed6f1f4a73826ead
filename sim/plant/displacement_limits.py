"""How far each actuator may be commanded: its stroke, its ranges, and the current of its coil."""

import mujoco
import numpy as np
from numpy.typing import ArrayLike

import argument_checks as check
from sim.array import Array
from sim.mjcf.drive import Drive
from sim.mjcf.ranges import ranges
from sim.plant.actuators import plant_drives
from sim.plant.amplifier import Amplifier
from sim.plant.commands import Commands, commands_of, displacement_range


def displacement_limits(
    model: mujoco.MjModel, amplifier: Amplifier, current_limit_a: ArrayLike | None = None
) -> tuple[Array, Array]:
    """Displacements at which actuators can rest: within their ranges, and within the current.

    At rest a coil balances its suspension, so a displacement l takes the current
    newton_per_m l / newton_per_a. What bends besides (flexures, the shifted weight) is neglected:
    0.1 % of the current in the hexapod. An actuator that is locked rests anywhere without current:
    its limits do not apply, and mappings of a failed mechanism leave them out.

    Args:
        model: As for :class:`Plant`. Ranges are those of the joint or tendon, of the control and
            of the force that holds its spring; infinite where it states none.
        amplifier: The drive chain of each actuator. 100 % of its input, its saturation and the
            largest code of its converter limit the current.
        current_limit_a: A smaller limit, for all or each of the actuators, shape () or (n,): what a
            hot coil may carry, for example. None is the amplifier's alone.

    Returns:
        Lower and upper displacement from the nominal position, shape (n,) each, [m].

    Raises:
        ModelError: As :class:`Plant` for its actuators.
        ValueError: A current is negative or not finite, or their number is wrong.
        TypeError: `model` or `amplifier` is of another type.
    """
    check.instance("model", model, mujoco.MjModel)
    check.instance("amplifier", amplifier, Amplifier)
    data, drives = mujoco.MjData(model), plant_drives(model)
    mujoco.mj_forward(model, data)
    lower, upper = rest_limits(model, data, drives, commands_of(model, data, drives))
    full_m = amplifier.full_input_a * amplifier.newton_per_a / amplifier.newton_per_m
    # The chain itself says what its converter leaves of full input: one code less upwards.
    least_m, most_m = amplifier.displacements(amplifier.inputs(full_m * np.array([-2, 2])))
    if current_limit_a is not None:
        currents = check.not_negative("current_limit_a", current_limit_a)
        if currents.shape not in ((), lower.shape):
            raise ValueError(
                f"current_limit_a must be one number or {len(lower)}, got shape {currents.shape}"
            )
        held_m = currents * amplifier.newton_per_a / amplifier.newton_per_m
        least_m, most_m = np.maximum(least_m, -held_m), np.minimum(most_m, held_m)
    return np.maximum(lower, least_m), np.minimum(upper, most_m)


def rest_limits(
    model: mujoco.MjModel, data: mujoco.MjData, drives: tuple[Drive, ...], commands: Commands
) -> tuple[Array, Array]:
    """The same from the pose of `data` and without an amplifier: (n,) each, [m] or [rad]."""
    limits, stroke = ranges(model), np.tile([-np.inf, np.inf], (len(drives), 1))
    for row, drive in zip(stroke, drives, strict=True):
        if drive.joint is not None:
            here = data.qpos[model.jnt_qposadr[drive.joint]]
            row[:] = limits.joint[model.jnt_dofadr[drive.joint]] - here
        elif drive.tendon is not None:
            row[:] = limits.tendon[drive.tendon] - data.ten_length[drive.tendon]
    least, most = displacement_range(commands, model, drives)
    return np.maximum(stroke[:, 0], least), np.minimum(stroke[:, 1], most)
