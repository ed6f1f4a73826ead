"""Elements and states of a model: look-up by name, checks, updates of derived quantities."""

import copy
from collections.abc import Callable, Sequence
from difflib import get_close_matches
from typing import Any

import mujoco
import numpy as np

import argument_checks as check
from sim.errors import ModelError

_MOST_LISTED = 12
_COUNTS = {"site": "nsite", "joint": "njnt", "body": "nbody", "equality": "neq", "geom": "ngeom"}
_COUNTS["actuator"] = "nactuator"  # not nu: an orientation servo has three controls


def start_of(model: mujoco.MjModel) -> mujoco.MjData:
    """Return the default start state of a model: its first keyframe, or else `qpos0`."""
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    return data


def weightless(model: mujoco.MjModel) -> mujoco.MjModel:
    """Copy a model without gravity and without spring preload."""
    check.instance("model", model, mujoco.MjModel)
    orbiting = copy.copy(model)
    orbiting.opt.gravity[:] = 0.0
    orbiting.qpos_spring[:] = orbiting.qpos0
    return orbiting


def element_id(model: mujoco.MjModel, kind: str, name: str) -> int:
    """Find the number of a "site", "joint", "body", "geom", "equality" or "actuator" by its name.

    Raises:
        ModelError: No element has this name; the message lists names, the most similar one last.
        ValueError: There is no such kind.
    """
    check.instance("model", model, mujoco.MjModel)
    check.choice("kind", kind, _COUNTS)
    try:
        return getattr(model, kind)(check.instance("name", name, str)).id
    except KeyError:
        names = names_of_kind(model, kind)
        matches = get_close_matches(name, names, n=1)
        near = "".join(f'; did you mean "{match}"?' for match in matches)
        message = f'the model has no {kind} named "{name}"; it has: {listed(names)}{near}'
        raise ModelError(message) from None


def names_of_kind(model: mujoco.MjModel, kind: str) -> list[str]:
    """List the names of all elements of a kind (see :func:`element_id`)."""
    every = (getattr(model, kind)(k).name for k in range(getattr(model, _COUNTS[kind])))
    return [name for name in every if name]


def listed(names: Sequence[str]) -> str:
    """Join names for a sentence: at most a dozen, then the number of others."""
    given = [name for name in names if name]
    more = f" and {len(given) - _MOST_LISTED} more" if len(given) > _MOST_LISTED else ""
    return (", ".join(given[:_MOST_LISTED]) or "none") + more


def name_of(element: Any) -> str:
    """Return the name of an element such as `model.joint(k)`, or "number k" without a name."""
    return element.name or f"number {element.id}"


def joint_name(model: mujoco.MjModel, joint: int) -> str:
    """Return the name of a joint, or of its body if the joint has none."""
    return model.joint(joint).name or name_of(model.body(model.jnt_bodyid[joint]))


def check_state(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Check that a state is finite and of this model: MuJoCo would write past arrays."""
    check_size("data", model, data)
    if not (check.is_moderate(data.qpos) or np.isfinite(data.qpos).all()):  # the first is faster
        raise ValueError(f"data.qpos must be finite, got {check.short_repr(data.qpos.tolist())}")


def check_size(argument: str, model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Check that a state, finite or not, belongs to a model of the same size."""
    check.instance("model", model, mujoco.MjModel)
    check.instance(argument, data, mujoco.MjData)
    if data.model is not model and _sizes(data.model) != _sizes(model):
        raise ValueError(f"{argument} must be of this model, got that of a model of other size")


def _sizes(model: mujoco.MjModel) -> list[int]:
    names = ("nq", "nv", "nu", "na", "nbody", "njnt", "ngeom", "nsite", "neq", "ntendon", "nM")
    return [getattr(model, name) for name in names]


def bring_up_to_date(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Compute the parts of `mj_fwdPosition` that Jacobians need: no contacts, no mass matrix."""
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    if model.nflex:
        mujoco.mj_flex(model, data)
    if model.ntendon:
        mujoco.mj_tendon(model, data)
    if model.neq:
        mujoco.mj_makeConstraint(model, data)
    with_sleepers(model, data, mujoco.mj_tendon, mujoco.mj_makeConstraint)


def with_sleepers(
    model: mujoco.MjModel, data: mujoco.MjData, *functions: Callable[..., None]
) -> None:
    """Call functions of MuJoCo again, with all trees awake, if some kinematic tree sleeps.

    MuJoCo skips tendons, transmissions and constraints of sleeping trees, although the frames of
    their bodies are up to date.
    """
    trees, velocities = data.ntree_awake, data.nv_awake
    if trees == model.ntree:
        return
    data.ntree_awake, data.nv_awake = model.ntree, model.nv
    for function in functions:
        function(model, data)
    data.ntree_awake, data.nv_awake = trees, velocities
