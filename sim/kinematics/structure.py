"""What of the Jacobians no pose changes: closures, active velocities, what is connected."""

from itertools import count
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.array import Array
from sim.closing.equalities import Closures
from sim.mjcf.drive import Drive
from sim.mjcf.transmission import extra_drives, required_drives, simple_velocities


class Structure(NamedTuple):
    """What of the Jacobians no pose changes; arrays are read-only, because ticks share them.

    Attributes:
        closures: The active equalities.
        active: Velocity index of each active velocity, shape (n,).
        gear: Of the first actuator of each, shape (n,).
        extra: Those drives that are no joint.
    """

    closures: Closures
    active: NDArray[np.intp]
    gear: Array
    extra: tuple[Drive, ...]


def bring_up_to_date(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """What Jacobians need of `mj_fwdPosition`: no contacts, no mass matrix."""
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    if model.nflex:
        mujoco.mj_flex(model, data)
    if model.ntendon:
        mujoco.mj_tendon(model, data)
    if model.neq:
        mujoco.mj_makeConstraint(model, data)


def structure(model: mujoco.MjModel, closed: Closures) -> Structure:
    """The structure of a model with these closures.

    Raises:
        ModelError: A model without enabled actuators, or an actuator that is no velocity.
    """
    active, gear, extra = simple_velocities(model), model.actuator_gear[:, 0].copy(), ()
    if active is None or not len(active):
        of_model = required_drives(model)
        extra = extra_drives(of_model)
        after, first = count(model.nv), model.jnt_dofadr
        numbers = [next(after) if d.joint is None else int(first[d.joint]) for d in of_model]
        active = np.array(numbers, dtype=np.intp)
        gear = np.array([drive.gear[0] for drive in of_model])
    for shared in (active, gear):
        shared.setflags(write=False)
    return Structure(closed, active, gear, extra)


def unmoved(J_T: Array, J_C: Array, active: NDArray[np.intp]) -> bool:
    """Whether no active velocity has to do with these rows, through whatever closures."""
    reached = np.asarray(J_T.any(axis=0))
    links = J_C != 0.0
    while not reached[active].any():
        linked = np.asarray(reached | ((links @ reached) @ links))
        if (linked == reached).all():
            return True
        reached = linked
    return False
