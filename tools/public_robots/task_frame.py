"""Which frame of an unknown robot is its task, and on which feet it stands: docs/refused.md."""

from collections.abc import Iterable

import mujoco
import numpy as np

from sim import Array

FOOT_HEIGHT = 0.1
"""Of the robot's height: ends of chains below are feet."""


class NoTask(ValueError):
    """The rule finds no frame."""


def task_frame(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[str, tuple[str, ...]]:
    """Name of the body at this pose, and of the feet, sites or bodies, if the base is free.

    Raises:
        NoTask: No actuator moves a body that has a name.
    """
    mujoco.mj_fwdPosition(model, data)
    moments = np.zeros((model.nout, model.nv))
    mujoco.mju_sparse2dense(
        moments, data.actuator_moment, data.moment_rownnz, data.moment_rowadr, data.moment_colind
    )
    # Velocities of each body's joints that an actuator moves.
    driven = np.bincount(model.dof_bodyid[moments.any(axis=0)], minlength=model.nbody)
    reach = np.zeros((model.nbody, 2))  # driven velocities, and metres, of the chain to each body
    for k in range(1, model.nbody):
        offset_m = np.linalg.norm(data.xpos[k] - data.xpos[model.body_parentid[k]])
        reach[k] = reach[model.body_parentid[k]] + (driven[k], offset_m)
    ends = [k for k in range(1, model.nbody) if driven[k] and not driven[_below(model, k)].any()]
    if not ends:
        raise NoTask("no actuator moves a joint")
    best = _longest(model, reach, range(1, model.nbody))
    base = int(model.body_rootid[best])
    joint = model.body_jntadr[base]
    if joint < 0 or model.jnt_type[joint] != mujoco.mjtJoint.mjJNT_FREE:
        return model.body(best).name, ()
    ends = [k for k in ends if model.body_rootid[k] == base]
    feet = _feet(model, data, base, ends)
    hands = [k for end in ends if end not in feet for k in (end, *_below(model, end))]
    frame = _longest(model, reach, hands) if hands else base
    return model.body(frame).name, tuple(feet.values())


def _below(model: mujoco.MjModel, body: int) -> list[int]:
    """Bodies that this one carries; they come after it."""
    below = [body]
    for k in range(body + 1, model.nbody):
        if model.body_parentid[k] in below:
            below.append(k)
    return below[1:]


def _longest(model: mujoco.MjModel, reach: Array, bodies: Iterable[int]) -> int:
    """Of some bodies the named one at the end of the longest chain, the first of equals."""
    named = [k for k in bodies if model.body(k).name]
    if not named:
        raise NoTask("no body of a chain that actuators move has a name")
    return max(named, key=lambda k: (*np.round(reach[k], 9), -k))


def _feet(model: mujoco.MjModel, data: mujoco.MjData, base: int, ends: list[int]) -> dict[int, str]:
    """By the body that ends a chain: its lowest site or body, or one above, that has a name."""
    lowest: dict[int, tuple[float, str]] = {}
    for end in ends:
        bodies = [end, *_below(model, end)]
        while not any(model.body(k).name for k in bodies) and bodies[0] != base:
            bodies.insert(0, int(model.body_parentid[bodies[0]]))
        frames = [(data.xpos[k][2], model.body(k).name) for k in bodies]
        sites = [k for k in range(model.nsite) if model.site_bodyid[k] in bodies]
        frames += [(data.site_xpos[k][2], model.site(k).name) for k in sites]
        if named := [frame for frame in frames if frame[1]]:
            lowest[end] = min(named)
    heights = [height for height, _ in lowest.values()]
    tree = [*data.xpos[model.body_rootid == base, 2], *heights]
    limit = min(heights, default=0.0) + FOOT_HEIGHT * (max(tree) - min(tree))
    return {end: name for end, (height, name) in lowest.items() if height <= limit}
