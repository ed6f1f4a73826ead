"""Elements and states of a model: found by name, checked, brought up to date."""

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
    """State in which a model starts by default: its first keyframe, or else `qpos0`."""
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    return data


def weightless(model: mujoco.MjModel) -> mujoco.MjModel:
    """Copy a model without gravity, and without the preload of springs that carried the weight."""
    check.instance("model", model, mujoco.MjModel)
    orbiting = copy.copy(model)
    orbiting.opt.gravity[:] = 0.0
    orbiting.qpos_spring[:] = orbiting.qpos0
    return orbiting


def element_id(model: mujoco.MjModel, kind: str, name: str) -> int:
    """Find the number of a "site", "joint", "body", "geom", "equality" or "actuator" by its name.

    Raises:
        ModelError: There is none of that name; the message lists some, and the most similar one.
        ValueError: No such kind.
    """
    check.instance("model", model, mujoco.MjModel)
    check.choice("kind", kind, _COUNTS)
    try:
        return getattr(model, kind)(check.instance("name", name, str)).id
    except KeyError:
        names = names_of_kind(model, kind)
        near = "".join(f'; did you mean "{each}"?' for each in get_close_matches(name, names, n=1))
        said = f'the model has no {kind} named "{name}"; it has: {listed(names)}{near}'
        raise ModelError(said) from None


def names_of_kind(model: mujoco.MjModel, kind: str) -> list[str]:
    """All names of elements of a kind, as of :func:`element_id`."""
    every = (getattr(model, kind)(k).name for k in range(getattr(model, _COUNTS[kind])))
    return [name for name in every if name]


def listed(names: Sequence[str]) -> str:
    """Names for a sentence: a dozen, and how many more there are."""
    named = [name for name in names if name]
    more = f" and {len(named) - _MOST_LISTED} more" if len(named) > _MOST_LISTED else ""
    return (", ".join(named[:_MOST_LISTED]) or "none") + more


def name_of(element: Any) -> str:
    """Name of an element as `model.joint(k)` gives it, or its number where it has none."""
    return element.name or f"number {element.id}"


def joint_name(model: mujoco.MjModel, joint: int) -> str:
    """Name of a joint, or of its body where it has none."""
    return model.joint(joint).name or name_of(model.body(model.jnt_bodyid[joint]))


def check_state(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Refuse a state that is not finite, or of another model: MuJoCo would write past arrays."""
    check_size("data", model, data)
    if not (check.is_moderate(data.qpos) or np.isfinite(data.qpos).all()):  # the first is faster
        raise ValueError(f"data.qpos must be finite, got {check.short_repr(data.qpos.tolist())}")


def check_size(argument: str, model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Refuse a state, finite or not, of a model of other size."""
    check.instance("model", model, mujoco.MjModel)
    check.instance(argument, data, mujoco.MjData)
    if data.model is not model and _sizes(data.model) != _sizes(model):
        raise ValueError(f"{argument} must be of this model, got that of a model of other size")


def _sizes(model: mujoco.MjModel) -> list[int]:
    names = ("nq", "nv", "nu", "na", "nbody", "njnt", "ngeom", "nsite", "neq", "ntendon", "nM")
    return [getattr(model, name) for name in names]


def bring_up_to_date(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Compute what Jacobians need of `mj_fwdPosition`: no contacts, no mass matrix."""
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
    """Call functions of MuJoCo once more if something sleeps, and as if nothing did.

    They leave out tendons, transmissions and constraints of trees that sleep, which follow from
    frames of their bodies that are up to date.
    """
    trees, velocities = data.ntree_awake, data.nv_awake
    if trees == model.ntree:
        return
    data.ntree_awake, data.nv_awake = model.ntree, model.nv
    for function in functions:
        function(model, data)
    data.ntree_awake, data.nv_awake = trees, velocities
