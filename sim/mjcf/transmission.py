"""What the actuators of a model move: one active velocity each, or one for several."""

import math
from collections.abc import Collection, Sequence
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.array import Array
from sim.errors import ModelError
from sim.mjcf.drive import Drive
from sim.mjcf.model import name_of, with_sleepers

_TRN = mujoco.mjtTrn
_JOINT, _IN_PARENT, _CRANK, _TENDON, _BODY, _TURN = (  # as integers, which compare 10 times faster
    int(kind)
    for kind in (
        *(_TRN.mjTRN_JOINT, _TRN.mjTRN_JOINTINPARENT, _TRN.mjTRN_SLIDERCRANK),
        *(_TRN.mjTRN_TENDON, _TRN.mjTRN_BODY, _TRN.mjTRN_SO3),
    )
)
_ON_JOINT = frozenset({_JOINT, _IN_PARENT})
_ONE_AXIS = frozenset({int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE)})
_BALL = int(mujoco.mjtJoint.mjJNT_BALL)
_DIGITS = 9
"""Of directions that are parallel."""
_PARALLEL = 10.0**-_DIGITS
_GROUPS = 31
"""Groups of actuators that `opt.disableactuator` can switch off."""


class _Moved(NamedTuple):
    """What an actuator moves: equal for all that share a velocity."""

    kind: int
    end: int
    other_end: int
    direction: tuple[float, ...]


class _Output(NamedTuple):
    """One output of an actuator, and its gear."""

    moved: _Moved
    gear: float
    actuator: int
    output: int


def drives(
    model: mujoco.MjModel, *, disabled: bool = False, among: Collection[int] | None = None
) -> tuple[Drive, ...]:
    """The active velocities of a model, in the order of their first actuators.

    Actuators of one joint, of one tendon, or with parallel gears at one site or ball joint share a
    velocity; at a site, a ball or a free joint it is that along the gear of the first of them.
    Those that `opt.disableactuator` switches off move nothing.

    Args:
        model: The model.
        disabled: Whether actuators that are switched off count all the same, if they move
            anything.
        among: Numbers of the actuators that count; None is all.

    Raises:
        ModelError: An actuator that adheres to contacts, or one of gear 0.
    """
    shared: dict[_Moved, list[_Output]] = {}
    for k in range(model.nactuator) if among is None else among:
        off = is_disabled(model, k)
        if not off or (disabled and int(model.actuator_trntype[k]) != _BODY):
            for output in _outputs(model, k):
                shared.setdefault(output.moved, []).append(output)
    return tuple(_drive(model, outputs) for outputs in shared.values())


def required_drives(model: mujoco.MjModel) -> tuple[Drive, ...]:
    """The same, one at least.

    Raises:
        ModelError: There is none; or as of :func:`drives`.
    """
    found = drives(model)
    if not found:
        message = "the model has no enabled actuator, so nothing can be commanded: add one"
        raise ModelError(message)
    return found


def extra_drives(of_model: tuple[Drive, ...]) -> tuple[Drive, ...]:
    """Those that are no joint: each has a velocity of its own, after the joints'."""
    return tuple(drive for drive in of_model if drive.joint is None)


def is_disabled(model: mujoco.MjModel, actuator: int) -> bool:
    """Whether `opt.disableactuator` switches the actuator off."""
    group = int(model.actuator_group[actuator])
    return 0 <= group < _GROUPS and bool(model.opt.disableactuator >> group & 1)


def simple_velocities(model: mujoco.MjModel) -> NDArray[np.intp] | None:
    """Velocity index of each actuator where each drives a slide or hinge of its own, else None."""
    joint = model.actuator_trnid[:, 0]
    if (
        not model.opt.disableactuator
        and _ON_JOINT.issuperset(model.actuator_trntype.tolist())
        and _ONE_AXIS.issuperset(model.jnt_type[joint].tolist())
        and model.actuator_gear[:, 0].all()
        and len(set(joint.tolist())) == len(joint)
    ):
        return model.jnt_dofadr[joint].astype(np.intp)
    return None


def drive_rows(model: mujoco.MjModel, data: mujoco.MjData, some: Sequence[Drive]) -> Array:
    """Rows (len(some), nv) whose products with qvel are the velocities of some drives.

    `data` has been through `mj_transmission`.
    """
    if not some:
        return np.zeros((0, model.nv))
    with_sleepers(model, data, mujoco.mj_tendon, mujoco.mj_transmission)
    moments = np.zeros((model.nout, model.nv))
    mujoco.mju_sparse2dense(
        moments, data.actuator_moment, data.moment_rownnz, data.moment_rowadr, data.moment_colind
    )
    return moments[[d.outputs[0] for d in some]] / np.array([[d.gear[0]] for d in some])


def _outputs(model: mujoco.MjModel, k: int) -> list[_Output]:
    """The outputs of an actuator; only an orientation servo has more than one."""
    kind, first = int(model.actuator_trntype[k]), int(model.actuator_outadr[k])
    end, other_end = model.actuator_trnid[k].tolist()
    if kind == _BODY:
        raise ModelError(
            f"{_called(model, k)} adheres to whatever touches it, which is no velocity: take it "
            "out of the model, or disable its group and pin what it holds"
        )
    if kind == _TURN:
        axes = (_Moved(kind, end, other_end, (i,)) for i in range(3))
        return [_Output(axis, 1.0, k, first + i) for i, axis in enumerate(axes)]
    gears = model.actuator_gear[first].tolist()
    gear, direction = gears[0], ()
    if kind in _ON_JOINT and int(model.jnt_type[end]) in _ONE_AXIS:
        kind = _JOINT
    elif kind == _CRANK:
        direction = (float(model.actuator_cranklength[k]),)
    elif kind != _TENDON:
        # A ball or free joint, or a site: the velocity along a direction of three or six numbers,
        # the same for opposite ones.
        used = gears[: 3 if kind in _ON_JOINT and int(model.jnt_type[end]) == _BALL else 6]
        size = math.hypot(*used)
        # The first that is more than round-off of a sine or cosine.
        gear = math.copysign(size, next((g for g in used if abs(g) > _PARALLEL * size), 0.0))
        direction = tuple(round(g / gear, _DIGITS) for g in used) if gear else ()
    if not gear:
        raise ModelError(f"{_called(model, k)} has gear 0 and moves nothing: take it out")
    return [_Output(_Moved(kind, end, other_end, direction), gear, k, first)]


def _drive(model: mujoco.MjModel, outputs: list[_Output]) -> Drive:
    moved, gear, ids, numbers = zip(*outputs, strict=True)
    kind, end, _, direction = moved[0]
    joint = end if kind == _JOINT and not direction else None
    tendon = end if kind == _TENDON else None
    has_length = joint is not None or kind in (_TENDON, _CRANK)
    if direction and not has_length:  # their sign came from the direction's first component
        gear = tuple(math.copysign(1.0, gear[0]) * each for each in gear)
    return Drive(model, ids, gear, numbers, joint, tendon, has_length)


def _called(model: mujoco.MjModel, actuator: int) -> str:
    return f'actuator "{name_of(model.actuator(actuator))}"'
