"""Actuators of a plant: static balance, controls for displacements, locks, force loss, repair."""

import copy
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from argument_checks.ties import greatest
from sim.array import Array
from sim.closing.equalities import closure_rows
from sim.errors import ModelError
from sim.mjcf.drive import (
    STEPS,
    Drive,
    Law,
    drive_rows,
    law_of,
    lock_name,
    lockable_by,
    locked_by,
    moments_of,
    stiffness_of,
    weakens_locks,
)
from sim.mjcf.joints import has_linear_spring, is_slack, mass_of, ranges
from sim.mjcf.model import name_of
from sim.plant.linear import allowed

_STEP, _SAME_SLOPE = 1e-6, 1e-4
"""Step of a central difference of lengths [rad] or [m]; relative tolerance of its slope."""
_HEAVY = 1e6
"""Factor on the inertia of a locked joint if the integrator weakens its lock: other joints then
cannot move it, and it acts on them like a locked joint."""
_MOTION_HZ, _LARGEST_YIELD = 1.0, 0.03
"""Frequency [Hz] of a test motion; fraction of it by which an acceptable lock may yield."""
_OFF = 30
"""Group of switched-off actuators, the last one of `opt.disableactuator`."""
_SERVO = (
    "sim.servoed(model, natural_frequency_hz=...), --servo HZ or servo_hz= makes it a position "
)
_SERVO += "servo"
_OF_ACTUATORS = "actuator_group", "actuator_gainprm", "actuator_biasprm"
_OF_VELOCITIES = "dof_armature", "dof_invweight0"
STRENGTHS = (*_OF_ACTUATORS, *_OF_VELOCITIES, "jnt_stiffness", "tendon_stiffness", "eq_data")
"""Fields of a model that failures change."""
_BALANCED = 1e-7
"""Fraction of the loads that may stay unbalanced, since joint axes are rounded."""
_WITHIN = 1e-6
"""Relative tolerance of ranges, and of powers that count as equal."""
_PREFERENCE = 1e-6
"""Weight of small forces relative to the error of the supported load."""
_KINDS = {mujoco.mjtJoint.mjJNT_FREE: "free joint", mujoco.mjtJoint.mjJNT_BALL: "ball joint"}


@dataclass(frozen=True, eq=False)
class Commands:
    """Controls and forces as functions of the commanded static displacements x (n,) of drives.

    Attributes:
        at_rest: Controls at x = 0, shape (nu,).
        per_displacement: Slope of the controls, shape (nu, n).
        force: Force of each output at x = 0, shape (nout,).
        force_slope: Slope of these forces, which balance springs, shape (nout, n).
        stiffness: Force of each drive per commanded displacement, the drive blocked, shape (n,).
        feedback: Decrease of that force per displacement and per speed, relative to `stiffness`,
            shape (n, 2): [1, kv/kp] for a servo alone, zeros for a motor against a spring.
    """

    at_rest: Array
    per_displacement: Array
    force: Array
    force_slope: Array
    stiffness: Array
    feedback: Array

    @cached_property
    def are_displacements(self) -> bool:
        """True if each control equals its drive's displacement, as for position servos."""
        slope = np.eye(len(self.at_rest))
        return not self.at_rest.any() and np.array_equal(self.per_displacement, slope)

    def with_other_controls(self, controls: Array) -> "Commands":
        """Return a copy in which controls that belong to no drive have these values (nu,)."""
        commanded = self.per_displacement.any(axis=1)
        return replace(self, at_rest=np.where(commanded, self.at_rest, controls))


def commands_of(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    drives: tuple[Drive, ...],
    forces: Array | None = None,
) -> Commands:
    """Return the controls that displace drives from the pose of `data`, which is up to date.

    Each actuator balances its own feedback; the actuators of one drive share the force of its
    spring in proportion to their gears, with the least sum of squares. In that pose the outputs
    exert the `forces` (nout,); None means zero controls.

    Raises:
        ModelError: No control displaces a drive.
    """
    at_rest, gains = np.zeros(model.nu), np.zeros((model.nu, len(drives)))
    force, slope = np.zeros(model.nout), np.zeros((model.nout, len(drives)))
    stiffness, feedback = np.zeros(len(drives)), np.zeros((len(drives), 2))
    for n, drive in enumerate(drives):
        laws = [law_of(model, k) for k in drive.ids]
        spring, _ = spring_of(model, data, drive)
        squares = sum(gear * gear for gear in drive.gear)
        for k, out, gear, law in zip(drive.ids, drive.outputs, drive.gear, laws, strict=True):
            feedback[n] -= gear * gear * np.array([law.per_length, law.per_speed])
            control, share = model.actuator_ctrladr[k], gear * spring / squares
            passive = law.constant + law.per_length * data.actuator_length[out]
            gains[control, n] = (share - law.per_length * gear) / law.gain
            slope[out, n] = share
            force[out] = passive if forces is None else forces[out]
            at_rest[control] = (force[out] - passive) / law.gain
        stiffness[n] = spring + feedback[n, 0]
        if stiffness[n] <= 0.0:
            raise ModelError(f'actuator "{drive.actuators[0]}" {_why_without(drive, laws)}')
        if not drive.has_length:
            _check_length(model, data, drive)
    feedback /= stiffness[:, None]
    return Commands(at_rest, gains, force, slope, stiffness, feedback)


def spring_of(model: mujoco.MjModel, data: mujoco.MjData, drive: Drive) -> tuple[float, float]:
    """Return stiffness and elongation of the spring of a drive's joint or tendon."""
    if drive.lockable is None:
        return 0.0, 0.0
    kind, k = drive.lockable
    if kind == "joint":
        at, is_linear = model.jnt_qposadr[k], has_linear_spring(model)[k]
        stiffness, stretch = model.jnt_stiffness[k], data.qpos[at] - model.qpos_spring[at]
    else:
        length, is_linear = data.ten_length[k], not model.tendon_stiffnesspoly[k].any()
        stiffness = 0.0 if is_slack(model, data, k) else model.tendon_stiffness[k]
        stretch = length - np.clip(length, *model.tendon_lengthspring[k])
    if not is_linear:
        raise ModelError(f'the spring of {kind} "{drive.name}" is not linear')
    return float(stiffness), float(stretch)


def _why_without(drive: Drive, laws: list[Law]) -> str:
    """Return why a control gives no displacement: neither position feedback nor spring."""
    if any(law.per_length > 0.0 for law in laws):
        return "pushes away from its target: its feedback must be negative"
    if any(law.per_speed for law in laws):
        start = "is a velocity servo, whose control is a speed: a plant is commanded by"
        return f"{start} displacements: {_SERVO}"
    if drive.has_length:
        return f"is a torque motor, and no displacement follows from a torque: {_SERVO}"
    return (
        "is a torque motor at a site, or on a ball or free joint, where no displacement follows "
        "from its force: a simulation needs a controller of the base. Its force mapping, "
        "attainable forces and limits are those of any actuator"
    )


def _check_length(model: mujoco.MjModel, data: mujoco.MjData, drive: Drive) -> None:
    """Check that a servo measures its own displacement.

    Without a reference site it measures none; a rotated reference site or ball joint gives another.
    """
    row, probe = drive_rows(model, data, [drive])[0], copy.copy(data)
    slope = np.zeros(model.nv)
    for k, velocity in enumerate(np.eye(model.nv)):
        for step in (_STEP, -_STEP):
            probe.qpos[:] = data.qpos
            mujoco.mj_integratePos(model, probe.qpos, velocity, step)
            mujoco.mj_fwdPosition(model, probe)
            slope[k] += probe.actuator_length[drive.outputs[0]] / (2 * step)
    if np.abs(slope / drive.gear[0] - row).max() > _SAME_SLOPE * np.abs(row).max():
        raise ModelError(
            f'actuator "{drive.actuators[0]}" measures a length that does not grow with its '
            "displacement: give its site a refsite that does not turn, its ball joint a pose near "
            "zero"
        )


def rest_limits(
    model: mujoco.MjModel, data: mujoco.MjData, drives: tuple[Drive, ...], commands: Commands
) -> tuple[Array, Array]:
    """Return lower and upper static displacements of drives, (n,) each, [m] or [rad].

    They are relative to the pose of `data`, within ranges of joint or tendon, control and force.
    """
    limits, bounds = ranges(model), np.empty((2, len(drives)))
    for n, drive in enumerate(drives):
        spans = [np.array([-np.inf, np.inf])]
        if drive.joint is not None:
            here = data.qpos[model.jnt_qposadr[drive.joint]]
            spans.append(limits.joint[model.jnt_dofadr[drive.joint]] - here)
        elif drive.tendon is not None:
            spans.append(limits.tendon[drive.tendon] - data.ten_length[drive.tendon])
        for k, out in zip(drive.ids, drive.outputs, strict=True):
            control = model.actuator_ctrladr[k]
            slope, force_slope = commands.per_displacement[control, n], commands.force_slope[out, n]
            if slope:
                spans.append(np.sort((limits.control[control] - commands.at_rest[control]) / slope))
            if force_slope:
                spans.append(np.sort((limits.force[out] - commands.force[out]) / force_slope))
        lower, upper = np.transpose(spans)
        bounds[:, n] = lower.max(), upper.min()
    return bounds[0], bounds[1]


class Balance(NamedTuple):
    """Forces (nout,) of outputs in static balance, and the joint that moves most if there is none.

    `moves` is a sentence on what moves that joint.
    """

    forces: Array
    joint: int | None = None
    moves: str = ""


def balance(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    drives: tuple[Drive, ...],
    still: NDArray[np.intp] | None = None,
) -> Balance:
    """Compute actuator forces of drives that keep the machine at rest in the pose of `data`.

    They balance gravity and springs through the closures, with the least norm, within the ranges of
    the forces if possible. Contacts, limits and dry friction, which creeps, support nothing; the
    velocities `still` (k,) are fixed by other means. `mj_forward` must have been called on `data`
    at zero velocity.
    """
    moments = moments_of(model, data)
    used = [out for drive in drives for out in drive.outputs]
    fixed = np.eye(model.nv)[[] if still is None else still]
    Z = allowed(np.vstack([closure_rows(model, data), fixed]))
    springs = data.qfrc_passive + data.qfrc_gravcomp * model.jnt_actgravcomp[model.dof_jntid]
    loads = np.stack([-data.qfrc_bias, springs], axis=1)  # separate, to report which one moves
    arms = Z.T @ moments[used].T
    shares = np.linalg.lstsq(arms, -Z.T @ loads, rcond=None)[0]
    low, high = ranges(model).force[used].T
    least, negligible = shares.sum(axis=1), _BALANCED * np.linalg.norm(loads)
    if ((least < low) | (least > high)).any():
        # Internal forces, which bear no load, may be redistributed.
        within = _within_ranges(arms, arms @ least, low, high)
        if np.linalg.norm(arms @ (within - least)) <= negligible:
            shares[:, 0] += within - least
    unbalanced = Z @ (Z.T @ loads + arms @ shares)
    forces = np.zeros(model.nout)
    forces[used] = shares.sum(axis=1)
    if np.linalg.norm(unbalanced.sum(axis=1)) <= negligible:
        return Balance(forces)
    return Balance(forces, *_what_moves(model, Z, mass_of(model, data), unbalanced))


def _within_ranges(arms: Array, load: Array, low: Array, high: Array) -> Array:
    """Return forces (k,) within ranges that support a load with nearly the least norm and error."""
    scale = np.linalg.norm(arms, 2) or 1.0
    rows = np.vstack([arms / scale, _PREFERENCE * np.eye(len(low))])
    wanted = np.concatenate([load / scale, np.zeros(len(low))])
    return lsq_linear(rows, wanted, (low, high), method="bvls").x


def _what_moves(model: mujoco.MjModel, Z: Array, mass: Array, unbalanced: Array) -> tuple[int, str]:
    """Return the joint with the largest power of unbalanced forces (nv, 2), and a sentence on it.

    The columns of `unbalanced` are due to gravity and to springs.
    """
    falls = Z @ np.linalg.solve(Z.T @ mass @ Z, Z.T @ unbalanced.sum(axis=1))
    # Force times acceleration has the same unit for hinges and slides.
    power = unbalanced * falls[:, None]
    joint = greatest(np.bincount(model.dof_jntid, power.sum(axis=1)), _WITHIN)
    of_gravity, of_springs = power[model.dof_jntid == joint].sum(axis=0)
    cause = "gravity" if of_gravity > of_springs else "a spring"
    kind = _KINDS.get(mujoco.mjtJoint(model.jnt_type[joint]), "joint")
    name = model.joint(joint).name
    called = f'"{name}"' if name else f'of body "{model.body(model.jnt_bodyid[joint]).name}"'
    return joint, f"{cause} moves the {kind} {called}: no actuator holds it"


def beyond_ranges(model: mujoco.MjModel, drives: tuple[Drive, ...], commands: Commands) -> str:
    """Return a sentence on an actuator that would exceed its range at rest; empty if none."""
    limits = ranges(model)
    for k, out in (pair for d in drives for pair in zip(d.ids, d.outputs, strict=True)):
        control = model.actuator_ctrladr[k]
        for what, value, (low, high) in (
            ("a force", commands.force[out], limits.force[out]),
            ("a control", commands.at_rest[control], limits.control[control]),
        ):
            slack = _WITHIN * (high - low)
            if not low - slack <= value <= high + slack:
                return (
                    f'actuator "{name_of(model.actuator(k))}" cannot hold the start: it takes '
                    f"{what} of {value:.4g}, outside {low:g}..{high:g}"
                )
    return ""


def lock_of(model: mujoco.MjModel, drive: Drive) -> int:
    """Return the number of the equality that locks a drive; -1 if there is none and it is no joint.

    Its name is `lock{k + 1}`, with k the first actuator of the joint or tendon; or it is any
    equality that fixes only this element.

    Raises:
        ModelError: A joint has no lock, or the equality of this name does anything else.
    """
    if drive.lockable is None:
        return -1
    name, called = _lock_name(model, drive), _called(drive)
    matches = [k for k in range(model.neq) if model.equality(k).name == name]
    own = [k for k in range(model.neq) if locked_by(model, k) == drive.lockable]
    if not set(matches) <= set(own):
        raise ModelError(f'equality "{name}" must lock the {called} alone')
    if not own and drive.joint is not None:
        raise no_lock(model, drive)
    return next(iter(matches + own), -1)


def _lock_name(model: mujoco.MjModel, drive: Drive) -> str:
    """Return the name of a drive's lock, after its element's first, even disabled, actuator."""
    numbers = range(model.nactuator)
    return lock_name(next(k for k in numbers if lockable_by(model, k) == drive.lockable))


def _called(drive: Drive) -> str:
    """Return kind and name of a drive's joint or tendon, as an equality names it."""
    kind, number = drive.lockable or ("", 0)
    return f'{kind} "{getattr(drive.model, kind)(number).name}"'


def no_lock(model: mujoco.MjModel, drive: Drive) -> ModelError:
    """Return the error for a drive that has no lock."""
    if drive.lockable is None:
        return ModelError(
            f'actuator "{drive.name}" cannot be locked: it moves neither a slide or hinge joint '
            "nor a tendon, and only these have locks"
        )
    return ModelError(
        f'the model has no equality named "{_lock_name(model, drive)}" to lock the '
        f"{_called(drive)}; load_model(path, add_locks=True) adds one"
    )


def enable_locks(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Clear the flags that would disable locks, unless an equality is active."""
    flags, bit = model.opt.disableflags, mujoco.mjtDisableBit
    if data.eq_active.any() or not flags & (bit.mjDSBL_EQUALITY | bit.mjDSBL_CONSTRAINT):
        return
    if flags & bit.mjDSBL_CONSTRAINT:  # its other effects are kept
        flags |= bit.mjDSBL_FRICTIONLOSS | bit.mjDSBL_LIMIT | bit.mjDSBL_CONTACT
    model.opt.disableflags = flags & ~(bit.mjDSBL_EQUALITY | bit.mjDSBL_CONSTRAINT)


def activate_lock(model: mujoco.MjModel, data: mujoco.MjData, drive: Drive, equality: int) -> None:
    """Lock the joint or tendon of a drive at its present position."""
    if drive.joint is not None:
        qpos, dof = model.jnt_qposadr[drive.joint], model.jnt_dofadr[drive.joint]
        model.eq_data[equality, 0] = data.qpos[qpos] - model.qpos0[qpos]
        if weakens_locks(model) and not data.eq_active[equality]:
            model.dof_armature[dof] = _HEAVY * mass_of(model, data)[dof, dof]
            model.dof_invweight0[dof] = 1.0 / model.dof_armature[dof]
    else:
        k = drive.tendon
        model.eq_data[equality, 0] = data.ten_length[k] - model.tendon_length0[k]
    data.eq_active[equality] = True


def lock_warning(
    model: mujoco.MjModel, data: mujoco.MjData, drive: Drive, equality: int, stiffness: float
) -> str | None:
    """Return a sentence on how much a drive's lock yields, and why; None if little or no lock.

    The yield is estimated at the pose of `data`, which is up to date, from the time constant of
    the lock, the pull of the drive's own actuator of this stiffness, and the drag by dampers.
    """
    if equality < 0:
        return None
    step_s, impedance = model.opt.timestep, model.eq_solimp[equality, 0]
    time_s = max(1 / math.sqrt(stiffness_of(model, equality)), STEPS * step_s)
    omega, of_tendon, dragged = 2 * math.pi * _MOTION_HZ, drive.joint is None, 0.0
    soft = omega / 2 * time_s / math.e
    if of_tendon or not weakens_locks(model):
        inverse = model.tendon_invweight0 if of_tendon else model.dof_invweight0[model.jnt_dofadr]
        number = drive.tendon if of_tendon else drive.joint
        pulled = (1 / impedance - 1) * stiffness * inverse[number] * time_s**2
        soft += pulled / (1 + pulled)
    if of_tendon and weakens_locks(model):
        dragged = (omega * time_s) ** 2 * (1 / _effective_force(model, data, drive) - 1)
    if soft + dragged < _LARGEST_YIELD:
        return None
    if dragged > soft:
        called = mujoco.mjtIntegrator(model.opt.integrator).name[6:].lower()
        cause = f"{called} moves it at time steps of {1e3 * step_s:g} ms: "
        cause += 'integrator="discrete" or shorter steps hold it'
    else:
        cause = f"it has a time constant of {1e3 * time_s:.3g} ms and an impedance of "
        cause += f"{impedance:g}: an impedance of 0.9999 and {STEPS} shorter time steps hold it"
    return (
        f"the lock of {_called(drive)} yields, by about "
        f"{100 * min(soft + dragged, 1):.0f} % of a motion of {_MOTION_HZ:g} Hz, as {cause}"
    )


def _effective_force(model: mujoco.MjModel, data: mujoco.MjData, drive: Drive) -> float:
    """Return the fraction of a force along a drive that one integrator step turns into speed."""
    row, moved = drive_rows(model, data, [drive])[0], []
    for force in (0.0, 1.0):
        probe = copy.copy(data)
        probe.qfrc_applied += force * row
        mujoco.mj_step(model, probe)
        moved.append([row @ probe.qvel, row @ probe.qacc])
    speed, acceleration = np.subtract(*moved[::-1])
    return float(speed / (model.opt.timestep * acceleration))


def reserve_off_group(model: mujoco.MjModel) -> None:
    """Move actuators out of the group of :func:`switch_off`, to one that is never disabled."""
    if not model.opt.disableactuator >> _OFF & 1:
        model.actuator_group[model.actuator_group == _OFF] = _OFF + 1


def switch_off(model: mujoco.MjModel, drive: Drive) -> None:
    """Set the force of a drive to exactly zero, after :func:`reserve_off_group`."""
    model.actuator_group[list(drive.ids)] = _OFF
    model.opt.disableactuator |= 1 << _OFF


def restore(model: mujoco.MjModel, drive: Drive, strengths: Mapping[str, Array]) -> None:
    """Restore force and spring of a drive; its lock is part of the state and stays."""
    places: dict[str, list[int]] = {name: list(drive.ids) for name in _OF_ACTUATORS}
    if drive.joint is not None:
        dof = int(model.jnt_dofadr[drive.joint])
        places |= {"jnt_stiffness": [drive.joint]} | {name: [dof] for name in _OF_VELOCITIES}
    elif drive.tendon is not None:
        places |= {"tendon_stiffness": [drive.tendon]}
    for name, rows in places.items():
        getattr(model, name)[rows] = strengths[name][rows]
