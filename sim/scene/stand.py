"""Frames of a file that stand: pinned to the world by equalities, in the physics too."""

import copy
from collections import Counter
from collections.abc import Sequence

import mujoco
import numpy as np

from sim.closing.pin import Pin
from sim.mjcf.frame import located
from sim.mjcf.locks import stiffen
from sim.mjcf.model import name_of
from sim.mjcf.part import Part

_LOOKED_S, _FALL_S = 0.02, 1.0
"""How often contacts are looked for, and how long."""
_FLAT = 2
"""Points of contact on which a body stands without turning."""


def stand(
    spec: mujoco.MjSpec, model: mujoco.MjModel, data: mujoco.MjData, pins: Sequence[Pin]
) -> None:
    """Pin frames to the world where they are in `data`, as stiffly as the time step allows.

    What is pinned no longer touches what stands on its own: two constraints for one foot would push
    each other.

    Args:
        spec: As it was compiled; it is changed, and compiled anew by the caller.
        model: That.
        data: Its state, positions up to date.
        pins: The frames.

    Raises:
        sim.ModelError: A frame that does not exist.
    """
    frames = [located(model, "pinned", pin.frame) for pin in pins]
    by_number = {body.id: body for body in spec.bodies}  # none has one any more after a change
    for k, (pin, frame) in enumerate(zip(pins, frames, strict=True)):
        there, here = f"pinned{k}_in_the_world", f"pinned{k}"
        quat_wxyz = np.empty(4)
        mujoco.mju_mat2Quat(quat_wxyz, frame.rotation(data).flatten())
        spec.worldbody.add_site(name=there, pos=frame.position_m(data), quat=quat_wxyz)
        body = by_number[frame.body]
        if frame.is_site:
            here = str(pin.frame)
        else:
            body.add_site(name=here)
        kind = mujoco.mjtEq.mjEQ_WELD if pin.weld else mujoco.mjtEq.mjEQ_CONNECT
        equality = spec.add_equality(name=f"pin{k}", type=kind)
        equality.objtype, equality.name1, equality.name2 = mujoco.mjtObj.mjOBJ_SITE, here, there
        stiffen(equality, model.opt.timestep)
    rigid = model.body_weldid  # bodies without a joint between them are one
    stands = {int(rigid[frame.body]) for frame in frames} - {0}
    for here in np.flatnonzero(np.isin(rigid, list(stands))).tolist():
        for there in np.flatnonzero(rigid == 0).tolist():
            for number in (here, there):
                by_number[number].name = by_number[number].name or f"body{number}_of_the_file"
            spec.add_exclude(bodyname1=by_number[there].name, bodyname2=by_number[here].name)


def standing(part: Part, data: mujoco.MjData) -> list[str]:
    """Bodies that stand on the ground, or come to when let fall, as pins are written.

    Those that touch it at one point can turn about it.
    """
    model, points = part.model, Counter[int]()
    data, steps = copy.copy(data), max(1, round(_LOOKED_S / model.opt.timestep))
    for _ in range(round(_FALL_S / _LOOKED_S)):
        if data.ncon:
            break
        mujoco.mj_step(model, data, steps)
    mujoco.mj_step(model, data, steps)  # until all of a foot is down
    for one, other in data.contact.geom:
        for here, there in ((one, other), (other, one)):
            if here >= 0 and there >= 0 and not model.body_weldid[model.geom_bodyid[there]]:
                points[int(model.geom_bodyid[here])] += 1
    roots = {int(model.body_rootid[body]) for body in part.bodies}
    return [
        name_of(model.body(body)) + ("" if count >= _FLAT else ":point")
        for body, count in sorted(points.items())
        if model.body_rootid[body] in roots
    ]
