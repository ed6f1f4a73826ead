"""Drives that a plant can command and that can fail: their locks and switches."""

import copy
import math
from collections.abc import Collection, Mapping, Sequence

import mujoco
import numpy as np

import argument_checks as check
from sim.array import Array
from sim.errors import ModelError
from sim.mjcf.drive import Drive
from sim.mjcf.dynamics import mass_of
from sim.mjcf.locks import (
    STEPS,
    Lockable,
    lock_name,
    lockable_by,
    locked_by,
    stiffness_of,
    weakens_locks,
)
from sim.mjcf.model import element_id
from sim.mjcf.transmission import drive_rows, drives

_HEAVY = 1e6
"""Inertia of a locked joint, in its own, where the integrator weakens its lock: others cannot drag
it along, and feel it as they feel one that is locked."""
_MOTION_HZ, _GIVES_WAY = 1.0, 0.03
"""Of a motion, and the part of it by which a lock that holds may still give way."""
_OFF = 30
"""Group of the actuators that are switched off: the last that `opt.disableactuator` switches."""


def plant_drives(model: mujoco.MjModel, among: Collection[int] | None = None) -> tuple[Drive, ...]:
    """The drives of a model, one at least, of some actuators; None is all.

    Raises:
        ModelError: There is none; or as :func:`drives`.
    """
    if found := drives(model, among=among):
        return found
    raise ModelError("the model has no actuator; a plant needs at least one")


def locks_of(
    model: mujoco.MjModel, drives: tuple[Drive, ...], names: Sequence[str] | None
) -> list[int]:
    """Id of the equality that locks each drive (n,), -1 without; None is `lock1`, `lock2`, ...

    Raises:
        ModelError: No such equality, or one that does not hold this joint or tendon alone. A drive
            that is no joint may have none.
        ValueError: Another number of names than of drives.
        TypeError: `names` is not a list or tuple of names.
    """
    if names is None:
        return [_default_lock(model, drive) for drive in drives]
    check.instance("locks", names, list, tuple)
    if len(names) != len(drives):
        raise ValueError(
            f"locks must name an equality for each of {len(drives)} actuators, got {len(names)}"
        )
    return [
        _lock(model, check.instance("locks", name, str), lockable_by(model, drive.ids[0]))
        for name, drive in zip(names, drives, strict=True)
    ]


def enable_locks(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Let locks act in a model whose flags disable equalities, none of which is active."""
    flags, bit = model.opt.disableflags, mujoco.mjtDisableBit
    if data.eq_active.any() or not flags & (bit.mjDSBL_EQUALITY | bit.mjDSBL_CONSTRAINT):
        return
    if flags & bit.mjDSBL_CONSTRAINT:  # what else it disables stays so
        flags |= bit.mjDSBL_FRICTIONLOSS | bit.mjDSBL_LIMIT | bit.mjDSBL_CONTACT
    model.opt.disableflags = flags & ~(bit.mjDSBL_EQUALITY | bit.mjDSBL_CONSTRAINT)


def lockable(model: mujoco.MjModel, drive: Drive, equality: int) -> Lockable:
    """The joint or tendon of a drive, which this equality locks.

    Raises:
        ModelError: The drive has no lock.
    """
    part = lockable_by(model, drive.ids[0])
    if part is None:
        raise ModelError(
            f'actuator "{drive.name}" cannot be locked: it moves neither a slide or hinge joint '
            "nor a tendon, and only these have locks"
        )
    if equality < 0:
        raise _missing_lock(lock_name(_first(model, part)), part)
    return part


def activate_lock(model: mujoco.MjModel, data: mujoco.MjData, drive: Drive, equality: int) -> None:
    """Hold the joint or tendon of a drive where it is; `data` is up to date.

    Raises:
        ModelError: The drive has no lock.
    """
    part = lockable(model, drive, equality)
    if part.kind == "joint":
        qpos, dof = model.jnt_qposadr[part.id], model.jnt_dofadr[part.id]
        model.eq_data[equality, 0] = data.qpos[qpos] - model.qpos0[qpos]
        if weakens_locks(model) and not data.eq_active[equality]:
            model.dof_armature[dof] = _HEAVY * mass_of(model, data)[dof, dof]
            model.dof_invweight0[dof] = 1.0 / model.dof_armature[dof]
    else:
        model.eq_data[equality, 0] = data.ten_length[part.id] - model.tendon_length0[part.id]
    data.eq_active[equality] = True


def yields(
    model: mujoco.MjModel, data: mujoco.MjData, drive: Drive, equality: int, stiffness: float
) -> str | None:
    """By how much the lock of a drive gives way, and why, in words; None: it holds, or is none.

    An estimate at the pose of `data`, which is up to date: what stops the drive, how far its own
    actuator of this stiffness then pulls it, and how far others drag it.
    """
    part = lockable_by(model, drive.ids[0])
    if equality < 0 or part is None:
        return None
    step_s, impedance = model.opt.timestep, model.eq_solimp[equality, 0]
    time_s = max(1 / math.sqrt(stiffness_of(model, equality)), STEPS * step_s)
    omega, on_tendon, dragged = 2 * math.pi * _MOTION_HZ, part.kind == "tendon", 0.0
    soft = omega / 2 * time_s / math.e
    if on_tendon or not weakens_locks(model):
        inverse = model.tendon_invweight0 if on_tendon else model.dof_invweight0[model.jnt_dofadr]
        pulled = (1 / impedance - 1) * stiffness * inverse[part.id] * time_s**2
        soft += pulled / (1 + pulled)
    if on_tendon and weakens_locks(model):
        dragged = (omega * time_s) ** 2 * (1 / _kept_of_force(model, data, drive) - 1)
    if soft + dragged < _GIVES_WAY:
        return None
    if dragged > soft:
        called = mujoco.mjtIntegrator(model.opt.integrator).name[6:].lower()
        cause = f"{called} drags it along at time steps of {1e3 * step_s:g} ms: "
        cause += 'integrator="discrete" or shorter steps hold it'
    else:
        cause = f"it has a time constant of {1e3 * time_s:.3g} ms and an impedance of "
        cause += f"{impedance:g}: an impedance of 0.9999 and {STEPS} shorter time steps hold it"
    return (
        f'the lock of {part.kind} "{part.name}" gives way, by about '
        f"{100 * min(soft + dragged, 1):.0f} % of a motion of {_MOTION_HZ:g} Hz, as {cause}"
    )


def _kept_of_force(model: mujoco.MjModel, data: mujoco.MjData, drive: Drive) -> float:
    """Part of a force along a drive that a step of the integrator leaves of it."""
    row, moved = drive_rows(model, data, [drive])[0], []
    for force in (0.0, 1.0):
        probe = copy.copy(data)
        probe.qfrc_applied += force * row
        mujoco.mj_step(model, probe)
        moved.append([row @ probe.qvel, row @ probe.qacc])
    speed, acceleration = np.subtract(*moved[::-1])
    return float(speed / (model.opt.timestep * acceleration))


def reserve_off_group(model: mujoco.MjModel) -> None:
    """Make sure that :func:`switch_off` switches nothing else off.

    Actuators that work and are in its group move to one that no option switches.
    """
    if not model.opt.disableactuator >> _OFF & 1:
        model.actuator_group[model.actuator_group == _OFF] = _OFF + 1


def switch_off(model: mujoco.MjModel, drive: Drive) -> None:
    """Make the force of this drive exactly zero; the model has its group reserved."""
    model.actuator_group[list(drive.ids)] = _OFF
    model.opt.disableactuator |= 1 << _OFF


def take_spring(model: mujoco.MjModel, drive: Drive) -> None:
    """Take the spring of the joint or tendon of a drive away."""
    if drive.joint is not None:
        model.jnt_stiffness[drive.joint] = 0.0
    elif drive.tendon is not None:
        model.tendon_stiffness[drive.tendon] = 0.0


_OF_ACTUATORS = "actuator_group", "actuator_gainprm", "actuator_biasprm"
_OF_VELOCITIES = "dof_armature", "dof_invweight0"


def strengths_of(model: mujoco.MjModel) -> dict[str, Array]:
    """All that a failure changes of a model."""
    names = (*_OF_ACTUATORS, *_OF_VELOCITIES, "jnt_stiffness", "tendon_stiffness", "eq_data")
    return {name: getattr(model, name).copy() for name in names}


def restore(model: mujoco.MjModel, drive: Drive, strengths: Mapping[str, Array]) -> None:
    """Give a drive its force and its spring as they were; its lock is not of the model."""
    ids = list(drive.ids)
    for name in _OF_ACTUATORS:
        getattr(model, name)[ids] = strengths[name][ids]
    if drive.joint is not None:
        model.jnt_stiffness[drive.joint] = strengths["jnt_stiffness"][drive.joint]
        dof = model.jnt_dofadr[drive.joint]
        for name in _OF_VELOCITIES:
            getattr(model, name)[dof] = strengths[name][dof]
    elif drive.tendon is not None:
        model.tendon_stiffness[drive.tendon] = strengths["tendon_stiffness"][drive.tendon]


def _first(model: mujoco.MjModel, part: Lockable) -> int:
    """The first actuator of a joint or tendon, after which its lock is named."""
    return next(k for k in range(model.nactuator) if lockable_by(model, k) == part)


def _default_lock(model: mujoco.MjModel, drive: Drive) -> int:
    part = lockable_by(model, drive.ids[0])
    if part is None:
        return -1
    name = lock_name(_first(model, part))
    if any(model.equality(k).name == name for k in range(model.neq)):
        return _lock(model, name, part)
    if own := [k for k in range(model.neq) if locked_by(model, k) == part]:
        return own[0]
    if part.kind == "joint":
        raise _missing_lock(name, part)
    return -1


def _missing_lock(name: str, part: Lockable) -> ModelError:
    return ModelError(
        f'the model has no equality named "{name}" to lock the {part.kind} "{part.name}"; '
        "load_model(path, add_locks=True) adds one, locks= takes other names"
    )


def _lock(model: mujoco.MjModel, name: str, part: Lockable | None) -> int:
    lock = element_id(model, "equality", name)
    if part is None or locked_by(model, lock) != part:
        held = "nothing: its actuator has no lock" if part is None else _alone(part)
        raise ModelError(f'equality "{name}" must lock {held}')
    return lock


def _alone(part: Lockable) -> str:
    return f'the {part.kind} "{part.name}" alone'
