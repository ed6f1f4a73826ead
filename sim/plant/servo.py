"""Conversion of torque motors and velocity servos to position servos."""

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
"""Largest natural frequency or damping rate times the time step; faster drives overshoot."""


def servoed(
    model: mujoco.MjModel,
    *,
    natural_frequency_hz: float,
    damping_ratio: float = 1.0,
    data: mujoco.MjData | None = None,
    among: Collection[int] | None = None,
) -> mujoco.MjModel:
    """Copy a model and convert its torque motors and velocity servos to position servos.

    This applies to motors on joints, tendons and slider-cranks. Stiffness and damping of a servo
    give the drive, with the other drives fixed, the natural frequency and damping ratio; springs
    and dampers of the mechanism add to them. The control becomes the target of the actuator's
    length, gear times displacement, without a range; the control range of a motor becomes a force
    range. Other actuators stay unchanged. Euler's method is replaced by `implicitfast`: coupled
    joints lose speed many times faster than each drive alone, and would overshoot.

    Args:
        model: The model to copy.
        natural_frequency_hz: Undamped natural frequency of each drive.
        damping_ratio: Damping ratio of each drive; 1 is critical.
        data: Closed pose at which inertias are taken; None is :func:`start_of` the model.
        among: Numbers of the actuators to convert; the others exert no force. None is all.

    Raises:
        ValueError: The frequency is too high for the time step.
        ModelError: As for :func:`jacobians`; or no actuator measures a length.
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
    driven = [_needs_feedback(model, drive) for drive in of_model]
    if of_model and not any(driven) and not any(drive.has_length for drive in of_model):
        raise ModelError(
            f'actuator "{of_model[0].actuators[0]}", at a site or on a ball or free joint, '
            "measures no length that a position servo could control, nor does any other: use force "
            "mappings"
        )
    # Motion of each drive with the others fixed and the least motion of undriven joints.
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


def _needs_feedback(model: mujoco.MjModel, drive: Drive) -> bool:
    """Return whether all actuators of a drive are motors or velocity servos with a length."""
    if not drive.has_length:
        return False
    try:
        return not any(law_of(model, k).per_length for k in drive.ids)
    except ModelError:  # muscles and others, which Plant rejects
        return False


def _close_loop(model: mujoco.MjModel, actuator: int, stiffness: float, damping: float) -> None:
    """Convert a motor to a position servo; a torque motor's control range limits the force."""
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
