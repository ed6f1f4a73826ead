"""Actuators that a plant can command and that can fail: their joints, locks and switches."""

from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

import argument_checks as check
from sim.errors import ModelError
from sim.locks import joint_locked_by, lock_name
from sim.model import element_id
from sim.transmission import actuated_velocities

_OFF = 30
"""Group of the actuators that are switched off: the last that `opt.disableactuator` switches."""


def actuated_joints(model: mujoco.MjModel) -> NDArray[np.intp]:
    """Joint of each actuator, shape (nu,).

    Raises:
        ModelError: There is no actuator; one is not alone on a slide or hinge joint; or one has a
            gear other than 1: its control would not be the displacement of its joint.
    """
    if not model.nu:
        raise ModelError("the model has no actuator; a plant needs at least one")
    actuated_velocities(model)  # refuses what is not one actuator on one joint
    for k in np.flatnonzero(model.actuator_gear[:, 0] != 1.0):
        name, gear = model.actuator(k).name, model.actuator_gear[k, 0]
        raise ModelError(
            f'actuator "{name}" must have gear 1, its control being a displacement; got {gear:g}'
        )
    return model.actuator_trnid[:, 0].astype(np.intp)


def locks_of(
    model: mujoco.MjModel, joints: NDArray[np.intp], names: Sequence[str] | None
) -> list[int]:
    """Id of the equality that locks each joint (nu,); None is `lock1`, `lock2`, ...

    Raises:
        ModelError: No such equality, or one that does not hold this joint alone.
        ValueError: Another number of names than of actuators.
        TypeError: `names` is not a list or tuple of names.
    """
    if names is None:
        return [_default_lock(model, k, int(joint)) for k, joint in enumerate(joints)]
    check.instance("locks", names, list, tuple)
    if len(names) != len(joints):
        raise ValueError(
            f"locks must name an equality for each of {len(joints)} actuators, got {len(names)}"
        )
    return [
        _lock(model, check.instance("locks", name, str), int(joint))
        for name, joint in zip(names, joints, strict=True)
    ]


def reserve_off_group(model: mujoco.MjModel) -> None:
    """Make sure that :func:`switch_off` switches nothing else off.

    Actuators that work and are in its group move to one that no option switches.
    """
    if not model.opt.disableactuator >> _OFF & 1:
        model.actuator_group[model.actuator_group == _OFF] = _OFF + 1


def switch_off(model: mujoco.MjModel, actuator: int) -> None:
    """Make the force of this actuator exactly zero; the model has its group reserved."""
    model.actuator_group[actuator] = _OFF
    model.opt.disableactuator |= 1 << _OFF


def _default_lock(model: mujoco.MjModel, actuator: int, joint: int) -> int:
    name = lock_name(actuator)
    if all(model.equality(k).name != name for k in range(model.neq)):
        raise ModelError(
            f'the model has no equality named "{name}" to lock the joint '
            f'"{model.joint(joint).name}"; load_model(path, add_locks=True) adds one, '
            "locks= takes other names"
        )
    return _lock(model, name, joint)


def _lock(model: mujoco.MjModel, name: str, joint: int) -> int:
    lock = element_id(model, "equality", name)
    if joint_locked_by(model, lock) != joint:
        raise ModelError(f'equality "{name}" must lock the joint "{model.joint(joint).name}" alone')
    return lock
