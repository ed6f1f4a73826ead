"""The model of a part of a file: all else stays where it is."""

import mujoco
import numpy as np

from sim.mjcf.locks import lock_name
from sim.mjcf.part import Part, tendon_bodies


def reduced(spec: mujoco.MjSpec, part: Part, data: mujoco.MjData) -> mujoco.MjModel:
    """The model without the joints that are no part of the task, at their positions in `data`.

    What they carried is as if welded there; what acts on them is gone. Names stay, and so do the
    joints, actuators and equalities of the part, in their order.

    Args:
        spec: Of the whole as it was compiled, which stays as it is.
        part: Of its compiled model.
        data: Its state, positions up to date.
    """
    model, rest = part.model, frozenset(part.rest)
    spec = spec.copy()
    spec.compiler.fusestatic = False
    bodies = [body for body in spec.bodies if body.id in rest]
    for body in bodies:
        _place(body, model, data)
    gone = [
        *spec.sensors,
        *spec.keys,
        *(each for each in spec.actuators if each.id not in part.actuators),
        *(each for each in spec.equalities if each.id in part.apart),
        *(each for each in spec.tendons if tendon_bodies(model, each.id) & rest),
        *(joint for body in bodies for joint in body.joints),
    ]
    locks = {each.name: each for each in spec.equalities}
    for each in gone:
        spec.delete(each)
    for fewer, actuator in enumerate(part.actuators):  # named by numbers, which are others now
        if lock := locks.get(lock_name(actuator)):
            lock.name = lock_name(fewer)
    return spec.compile()


def _place(body: mujoco.MjsBody, model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Give a body the pose in its parent that it has in `data`."""
    at, above = body.id, int(model.body_parentid[body.id])
    to_parent = data.xmat[above].reshape(3, 3).T
    body.pos = to_parent @ (data.xpos[at] - data.xpos[above])
    inverse = np.empty(4)
    mujoco.mju_negQuat(inverse, data.xquat[above])
    mujoco.mju_mulQuat(inverse, inverse, data.xquat[at])
    body.quat = inverse
    body.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
