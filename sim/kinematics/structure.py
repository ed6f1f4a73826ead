"""What of the Jacobians no pose changes: closures, active velocities, what is connected."""

from collections.abc import Iterable
from copy import copy
from itertools import count
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

import argument_checks as check
from sim.array import Array
from sim.closing.equalities import Closures
from sim.errors import ModelError
from sim.mjcf.drive import Drive
from sim.mjcf.model import bring_up_to_date, element_id, name_of
from sim.mjcf.ranges import turning
from sim.mjcf.transmission import drives, extra_drives, required_drives, simple_velocities

_ROUND_OFF = 1e-13
"""Part of the largest entry of a Jacobian, or of 1, that is zero but for round-off."""


class Structure(NamedTuple):
    """What of the Jacobians no pose changes; arrays are read-only, because ticks share them.

    Attributes:
        closures: The active equalities.
        active: Velocity index of each active velocity, shape (n,): of those with actuators, then of
            those that are variables without one.
        gear: Of the first actuator of each, 1 where there is none, shape (n,).
        extra: Those drives that are no joint.
        variables: How many have no actuator.
    """

    closures: Closures
    active: NDArray[np.intp]
    gear: Array
    extra: tuple[Drive, ...]
    variables: int


def variables_of(
    model: mujoco.MjModel, active: bool | Iterable[str | int]
) -> NDArray[np.intp] | None:
    """Velocities that are to be variables without an actuator, ascending; None is all without one.

    Raises:
        ModelError: A joint that does not exist, with the nearest that does.
        ValueError: A number out of range.
        TypeError: Something of another kind.
    """
    if isinstance(active, bool):
        return None if active else np.zeros(0, dtype=np.intp)
    found = set[int]()
    for item in check.members("active", active, str, int, np.integer):
        is_name = isinstance(item, str)
        joint = element_id(model, "joint", item) if is_name else check.index("active", item)
        if joint >= model.njnt:
            raise ValueError(f"active must have numbers of joints below {model.njnt}, got {joint}")
        found |= set(np.flatnonzero(model.dof_jntid == joint).tolist())
    return np.array(sorted(found), dtype=np.intp)


def structure(
    model: mujoco.MjModel, closed: Closures, variables: NDArray[np.intp] | None
) -> Structure:
    """The structure of a model with these closures, and these variables without an actuator.

    Raises:
        ModelError: A model without enabled actuators and without variables; an actuator that is no
            velocity; a variable that has an actuator.
    """
    active, gear, extra = simple_velocities(model), model.actuator_gear[:, 0].copy(), ()
    if active is None or not len(active):
        needed = variables is not None and not len(variables)
        of_model = required_drives(model) if needed else drives(model)
        extra = extra_drives(of_model)
        after, first = count(model.nv), model.jnt_dofadr
        numbers = [next(after) if d.joint is None else int(first[d.joint]) for d in of_model]
        active = np.array(numbers, dtype=np.intp)
        gear = np.array([drive.gear[0] for drive in of_model])
    if variables is None:
        variables = np.setdiff1d(np.arange(model.nv), active)
    elif len(both := np.intersect1d(variables, active)):
        joint = name_of(model.joint(int(model.dof_jntid[both[0]])))
        raise ModelError(f'active must name joints without an actuator, got "{joint}"')
    active = np.append(active, variables)
    gear = np.append(gear, np.ones(len(variables)))
    for shared in (active, gear):
        shared.setflags(write=False)
    return Structure(closed, active, gear, extra, len(variables))


def elsewhere(model: mujoco.MjModel, data: mujoco.MjData) -> mujoco.MjData:
    """A state near by where no entry of a Jacobian vanishes that does not at every pose."""
    there, size = copy(data), np.where(turning(model), 0.3, 0.1 * model.stat.extent)
    motion = size * np.random.default_rng(0).uniform(0.5, 1.5, size=model.nv)
    mujoco.mj_integratePos(model, there.qpos, motion, 1.0)
    bring_up_to_date(model, there)
    return there


def unmoved(J_T: Array, J_C: Array, active: NDArray[np.intp]) -> bool:
    """Whether no active velocity has to do with these rows, through whatever closures."""
    reached = np.asarray((np.abs(J_T) > _ROUND_OFF * np.abs(J_T).max(initial=1.0)).any(axis=0))
    links = np.abs(J_C) > _ROUND_OFF * np.abs(J_C).max(initial=1.0)
    while not reached[active].any():
        linked = np.asarray(reached | ((links @ reached) @ links))
        if (linked == reached).all():
            return True
        reached = linked
    return False
