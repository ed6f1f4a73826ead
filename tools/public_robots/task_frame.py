"""Task frame and feet of an unknown robot, by the rule of docs/refused.md."""

from collections.abc import Iterable

import mujoco
import numpy as np

from sim import Array

FOOT_HEIGHT = 0.1
"""Fraction of the robot's height below which ends of chains are feet."""


class NoTask(ValueError):
    """Error for a robot in which the rule finds no task frame."""


def task_frame(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[str, tuple[str, ...]]:
    """Return the task's body at this pose, and the feet (sites or bodies) if the base is free.

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
    chain = np.zeros((model.nbody, 2))  # driven velocities, and metres, of the chain to each body
    for k in range(1, model.nbody):
        offset_m = np.linalg.norm(data.xpos[k] - data.xpos[model.body_parentid[k]])
        chain[k] = chain[model.body_parentid[k]] + (driven[k], offset_m)
    ends = [k for k in range(1, model.nbody) if driven[k] and not driven[_below(model, k)].any()]
    if not ends:
        raise NoTask("no actuator moves a joint")
    best = _longest(model, chain, range(1, model.nbody))
    base = int(model.body_rootid[best])
    joint = model.body_jntadr[base]
    if joint < 0 or model.jnt_type[joint] != mujoco.mjtJoint.mjJNT_FREE:
        return model.body(best).name, ()
    ends = [k for k in ends if model.body_rootid[k] == base]
    feet = _feet(model, data, base, ends)
    hands = [k for end in ends if end not in feet for k in (end, *_below(model, end))]
    frame = _longest(model, chain, hands) if hands else base
    return model.body(frame).name, tuple(feet.values())


def _below(model: mujoco.MjModel, body: int) -> list[int]:
    """Return the bodies in the subtree of a body, without it; their numbers are larger."""
    below = [body]
    for k in range(body + 1, model.nbody):
        if model.body_parentid[k] in below:
            below.append(k)
    return below[1:]


def _longest(model: mujoco.MjModel, chain: Array, bodies: Iterable[int]) -> int:
    """Return the body with a name at the end of the longest chain, the first of equals."""
    named_bodies = [k for k in bodies if model.body(k).name]
    if not named_bodies:
        raise NoTask("no body of a chain that actuators move has a name")
    return max(named_bodies, key=lambda k: (*np.round(chain[k], 9), -k))


def _feet(model: mujoco.MjModel, data: mujoco.MjData, base: int, ends: list[int]) -> dict[int, str]:
    """Map bodies at chain ends near the ground to their lowest site or body with a name."""
    lowest: dict[int, tuple[float, str]] = {}
    for end in ends:
        bodies = [end, *_below(model, end)]
        while not any(model.body(k).name for k in bodies) and bodies[0] != base:
            bodies.insert(0, int(model.body_parentid[bodies[0]]))
        frames = [(data.xpos[k][2], model.body(k).name) for k in bodies]
        sites = [k for k in range(model.nsite) if model.site_bodyid[k] in bodies]
        frames += [(data.site_xpos[k][2], model.site(k).name) for k in sites]
        if candidates := [frame for frame in frames if frame[1]]:
            lowest[end] = min(candidates)
    heights = [height for height, _ in lowest.values()]
    tree = [*data.xpos[model.body_rootid == base, 2], *heights]
    limit = min(heights, default=0.0) + FOOT_HEIGHT * (max(tree) - min(tree))
    return {end: name for end, (height, name) in lowest.items() if height <= limit}
