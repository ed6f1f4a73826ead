"""Drives that a plant can command and that can fail: their locks and switches."""

from collections.abc import Collection, Mapping, Sequence

import mujoco

import argument_checks as check
from sim.array import Array
from sim.errors import ModelError
from sim.mjcf.drive import Drive
from sim.mjcf.locks import Lockable, lock_name, lockable_by, locked_by
from sim.mjcf.model import element_id
from sim.mjcf.transmission import drives

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


def activate_lock(model: mujoco.MjModel, data: mujoco.MjData, drive: Drive, equality: int) -> None:
    """Hold the joint or tendon of a drive where it is; `data` is up to date.

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
    if part.kind == "joint":
        qpos = model.jnt_qposadr[part.id]
        model.eq_data[equality, 0] = data.qpos[qpos] - model.qpos0[qpos]
    else:
        model.eq_data[equality, 0] = data.ten_length[part.id] - model.tendon_length0[part.id]
    data.eq_active[equality] = True


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


def strengths_of(model: mujoco.MjModel) -> dict[str, Array]:
    """All that a failure changes of a model."""
    names = (*_OF_ACTUATORS, "jnt_stiffness", "tendon_stiffness", "eq_data")
    return {name: getattr(model, name).copy() for name in names}


def restore(model: mujoco.MjModel, drive: Drive, strengths: Mapping[str, Array]) -> None:
    """Give a drive its force and its spring as they were; its lock is not of the model."""
    ids = list(drive.ids)
    for name in _OF_ACTUATORS:
        getattr(model, name)[ids] = strengths[name][ids]
    if drive.joint is not None:
        model.jnt_stiffness[drive.joint] = strengths["jnt_stiffness"][drive.joint]
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
