"""Loading MJCF models and finding their elements by name."""

import copy
import hashlib
import warnings
from collections.abc import Callable, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

import argument_checks as check
from sim.errors import ModelError
from sim.mjcf.locks import add_locks as add_locks_to
from sim.mjcf.numbers import check_numbers, check_text

_MOST_LISTED = 12

# The rooms are neighbours in a checkout and in site-packages alike.
MODELS = Path(__file__).parents[2] / "models"
"""Folder of the MJCF files that come with the package: arm, arms, fjh, hand, platform."""

HEXAPOD_MJCF = MODELS / "fjh.xml"


def load_model(path: str | Path | None = None, *, add_locks: bool = False) -> mujoco.MjModel:
    """Compile an MJCF or URDF file; without a path, the hexapod `models/fjh.xml`.

    A URDF file states no actuators: `docs/urdf.md` shows how to add them.

    A published file has no locks, which :class:`Plant` needs for position failures. `add_locks`
    gives each slide or hinge joint with an actuator an inactive joint equality that holds it alone,
    as stiff as the time step allows, unless it has one. It is named `lock{k + 1}` after the first
    actuator k of the joint. The file is not changed.

    Raises:
        ModelError: The file is missing or not valid; one of its numbers is NaN, infinite, beyond
            1e10, or negative where none may be, or the time step is not within 1e-7 and 1 s; or
            the name of a lock to be added is that of another equality.
        TypeError: An argument is of another type.
    """
    check.instance("add_locks", add_locks, bool)
    spec, model = load_spec(path)
    return spec.compile() if add_locks and add_locks_to(spec, model) else model


def load_spec(path: str | Path | None = None) -> tuple[mujoco.MjSpec, mujoco.MjModel]:
    """The same file to be changed, and as it is, compiled.

    Raises:
        ModelError, TypeError: As :func:`load_model`.
    """
    file = _file(path)
    check_text(file)
    try:
        with warnings.catch_warnings(record=True, action="always") as said:
            spec = mujoco.MjSpec.from_file(str(file))
            model = spec.compile()
    except ValueError as error:
        reason = " ".join(str(error).split())
        if "package://" in file.read_text(errors="replace"):
            reason += "; for meshes of package:// see docs/urdf.md: meshdir and strippath"
        raise ModelError(f"{file} is not a valid MJCF or URDF model: {reason}") from None
    check_numbers(file, model)
    for each in said:  # what is refused is refused in one sentence
        warnings.warn(each.message, each.category, stacklevel=3)
    return spec, model


def start_of(model: mujoco.MjModel) -> mujoco.MjData:
    """Where a model starts unless it is said: at its first keyframe, or else at `qpos0`."""
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    return data


def weightless(model: mujoco.MjModel) -> mujoco.MjModel:
    """The machine without gravity, and without the preload that carried the weight.

    Raises:
        TypeError: `model` is of another type.
    """
    check.instance("model", model, mujoco.MjModel)
    orbiting = copy.copy(model)
    orbiting.opt.gravity[:] = 0.0
    orbiting.qpos_spring[:] = orbiting.qpos0
    return orbiting


def model_sha256(path: str | Path | None = None) -> str:
    """SHA-256 of the MJCF file, which identifies the machine of a result.

    Raises:
        ModelError: The file is missing.
        TypeError: `path` is of another type.
    """
    return hashlib.sha256(_file(path).read_bytes()).hexdigest()


def element_id(model: mujoco.MjModel, kind: str, name: str) -> int:
    """Id of a named element, of one of MJCF's kinds.

    These are "site", "joint", "body", "geom", "equality" and "actuator".

    Raises:
        ModelError: There is none of that name; the message lists those there are, and repeats the
            most similar one.
        ValueError: No such kind.
        TypeError: `model` or a name is of another type.
    """
    check.instance("model", model, mujoco.MjModel)
    counts = {"site": "nsite", "joint": "njnt", "body": "nbody", "equality": "neq"}
    counts |= {"geom": "ngeom", "actuator": "nactuator"}  # an orientation servo has three controls
    check.choice("kind", kind, counts)
    try:
        return getattr(model, kind)(check.instance("name", name, str)).id
    except KeyError:
        every = (getattr(model, kind)(k).name for k in range(getattr(model, counts[kind])))
        names = [each for each in every if each]
        near = "".join(f'; did you mean "{each}"?' for each in get_close_matches(name, names, n=1))
        raise ModelError(
            f'the model has no {kind} named "{name}"; it has: {listed(names)}{near}'
        ) from None


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
    """Refuse a state that is not finite, or of another model: MuJoCo would write past its arrays.

    Raises:
        ValueError: `data` is of a model of other size, or its `qpos` is not finite.
        TypeError: One of them is of another type.
    """
    check_size("data", model, data)
    if not (check.is_moderate(data.qpos) or np.isfinite(data.qpos).all()):  # the first is faster
        raise ValueError(f"data.qpos must be finite, got {check.shown(data.qpos.tolist())}")


def check_size(argument: str, model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """The same of a state that need not be finite.

    Raises:
        ValueError, TypeError: As :func:`check_state`.
    """
    if not (isinstance(model, mujoco.MjModel) and isinstance(data, mujoco.MjData)):
        check.instance("model", model, mujoco.MjModel)
        check.instance(argument, data, mujoco.MjData)
    if data.model is not model and _sizes(data.model) != _sizes(model):
        raise ValueError(f"{argument} must be of this model, got that of a model of other size")


def with_sleepers(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    *functions: Callable[[mujoco.MjModel, mujoco.MjData], None],
) -> None:
    """Call functions of MuJoCo once more if something sleeps, and as if nothing did.

    They leave out tendons, transmissions and rows of constraints of trees that sleep. The frames of
    their bodies, from which these follow, are up to date; and the trees sleep on.
    """
    trees, velocities = data.ntree_awake, data.nv_awake
    if trees == model.ntree:
        return
    data.ntree_awake, data.nv_awake = model.ntree, model.nv
    for function in functions:
        function(model, data)
    data.ntree_awake, data.nv_awake = trees, velocities


def _sizes(model: mujoco.MjModel) -> list[int]:
    names = ("nq", "nv", "nu", "na", "nbody", "njnt", "ngeom", "nsite", "neq", "ntendon", "nM")
    return [getattr(model, name) for name in names]


def _file(path: str | Path | None) -> Path:
    file = HEXAPOD_MJCF if path is None else Path(check.instance("path", path, str, Path))
    try:
        found = file.is_file()
    except (OSError, ValueError):  # a name too long, or with a null character
        found = False
    if not found:
        raise ModelError(f"there is no MJCF or URDF file {check.shown(str(file))}")
    return file


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
    with_sleepers(model, data, mujoco.mj_tendon, mujoco.mj_makeConstraint)
