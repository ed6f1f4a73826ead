"""Torque motors and velocity servos as position servos."""

import copy
import math
from collections.abc import Collection

import mujoco
import numpy as np

import argument_checks as check
from sim.closing.equalities import check_closures, closure_rows
from sim.errors import ModelError
from sim.mjcf.drive import Drive, Law, drive_rows, drives, law_of
from sim.mjcf.joints import mass_of
from sim.mjcf.model import check_state, start_of
from sim.plant.linear import allowed

_FASTEST = 0.5
"""Largest natural frequency and damping rate times the time step: beyond, a step overshoots."""


def servoed(
    model: mujoco.MjModel,
    *,
    natural_frequency_hz: float,
    damping_ratio: float = 1.0,
    data: mujoco.MjData | None = None,
    among: Collection[int] | None = None,
) -> mujoco.MjModel:
    """Copy a model with torque motors and velocity servos made position servos.

    Those of joints, tendons and slider-cranks. Stiffness and damping of a servo give the drive
    alone, the other drives held, the natural frequency and damping ratio; springs and dampers of
    the mechanism come on top. The control becomes the target of the actuator's length, gear times
    displacement, without a range; the range that a motor had limits the force. Other actuators
    stay as they are. In place of Euler's method the model gets `implicitfast`, since joints that
    share inertia lose speed many times faster than each drive alone, and would overshoot.

    Args:
        model: The model to copy.
        natural_frequency_hz: Undamped, of each drive.
        damping_ratio: 1 is critical.
        data: The pose, closed, at which inertias are taken; None is :func:`start_of` the model.
        among: Numbers of the actuators that count, all others without force; None is all.

    Raises:
        ValueError: The frequency is too high for the time step.
        ModelError: As :func:`jacobians`; or no drive feels a length.
    """
    check.instance("model", model, mujoco.MjModel)
    natural_frequency_hz = check.number(
        "natural_frequency_hz", natural_frequency_hz, check.SMALLEST
    )
    omega = 2.0 * math.pi * natural_frequency_hz
    damping_ratio = check.number("damping_ratio", damping_ratio, 0.0)
    rate = omega * max(1.0, 2.0 * damping_ratio)
    if rate * model.opt.timestep > _FASTEST:
        most = natural_frequency_hz * _FASTEST / (rate * model.opt.timestep)
        raise ValueError(
            f"natural_frequency_hz must be at most {most:.3g} with the model's time step of "
            f"{model.opt.timestep:g} s, got {natural_frequency_hz:g}"
        )
    if among is not None:
        among = sorted({*check.indices("among", among, model.nactuator, distinct=False)})
    servo, of_model = copy.copy(model), drives(model, among=among)
    state = start_of(model) if data is None else copy.copy(data)
    check_state(model, state)
    check_closures(model, state, among=among)
    mujoco.mj_fwdPosition(model, state)
    driven = [_lacks_position(model, drive) for drive in of_model]
    if of_model and not any(driven) and not any(drive.has_length for drive in of_model):
        raise ModelError(
            f'actuator "{of_model[0].actuators[0]}" feels no length that a position servo could '
            "hold, at a site or on a ball or free joint, nor does any other: use force mappings"
        )
    # Each drive's with the others held; what no drive moves stays as slow as the loops allow.
    Z = allowed(closure_rows(model, state))
    motion = Z @ np.linalg.pinv(drive_rows(model, state, of_model) @ Z)
    inertias = np.einsum("ij,ik,kj->j", motion, mass_of(model, state), motion)
    for drive, inertia, is_driven in zip(of_model, inertias, driven, strict=True):
        if is_driven:
            squares = sum(gear * gear for gear in drive.gear)
            stiffness = inertia * omega**2 / squares
            damping = 2.0 * damping_ratio * inertia * omega / squares
            for k in drive.ids:
                _close_loop(servo, k, stiffness, damping)
    if any(driven) and servo.opt.integrator == mujoco.mjtIntegrator.mjINT_EULER:
        servo.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    return servo


def _lacks_position(model: mujoco.MjModel, drive: Drive) -> bool:
    """Whether all its actuators are motors or velocity servos, which could feel a length."""
    if not drive.has_length:
        return False
    try:
        return not any(law_of(model, k).per_length for k in drive.ids)
    except ModelError:  # muscles and others, which a plant refuses in its own words
        return False


def _close_loop(model: mujoco.MjModel, actuator: int, stiffness: float, damping: float) -> None:
    """Make a motor a position servo; the range of a torque motor's control becomes its force's."""
    control, law = model.actuator_ctrladr[actuator], law_of(model, actuator)
    if model.actuator_ctrllimited[control] and law == Law(law.gain):
        span = np.sort(law.gain * model.actuator_ctrlrange[control])
        if model.actuator_forcelimited[actuator]:
            span = span.clip(*model.actuator_forcerange[actuator])
        model.actuator_forcerange[actuator], model.actuator_forcelimited[actuator] = span, True
    model.actuator_ctrllimited[control] = False
    model.actuator_gainprm[actuator, 0] = stiffness
    model.actuator_biasprm[actuator, :3] = 0.0, -stiffness, -damping
    model.actuator_biastype[actuator] = mujoco.mjtBias.mjBIAS_AFFINE
