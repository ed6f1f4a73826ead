"""What the actuators of a model move: one active velocity each, or one for several."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.array import Array
from sim.errors import ModelError
from sim.model import name_of

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
_MUSCLE = int(mujoco.mjtGain.mjGAIN_MUSCLE)
_FIXED, _NO_BIAS = int(mujoco.mjtGain.mjGAIN_FIXED), int(mujoco.mjtBias.mjBIAS_NONE)
_GROUPS = 31
"""Groups of actuators that `opt.disableactuator` can switch off."""


@dataclass(frozen=True, eq=False)
class Drive:
    """One active velocity, and the actuators that move it.

    Attributes:
        model: The model, of which names and forces are read when asked for.
        ids: Numbers of the actuators.
        gear: Of each: its length grows by gear times the velocity, its force acts gear times.
        outputs: Of each, in `data.actuator_force`. The row of the first in `data.actuator_moment`,
            divided by its gear, gives the velocity from the joints'.
        joint: The slide or hinge joint driven; None for any other transmission.
        tendon: The tendon driven, or None.
    """

    model: mujoco.MjModel
    ids: tuple[int, ...]
    gear: tuple[float, ...]
    outputs: tuple[int, ...]
    joint: int | None
    tendon: int | None

    @cached_property
    def actuators(self) -> tuple[str, ...]:
        """Names of the actuators, "number k" where they have none."""
        return tuple(name_of(self.model.actuator(k)) for k in self.ids)

    @cached_property
    def name(self) -> str:
        """Of the joint or tendon; for other transmissions of the first actuator."""
        name = ""
        if self.joint is not None:
            name = self.model.joint(self.joint).name
        elif self.tendon is not None:
            name = self.model.tendon(self.tendon).name
        return name or self.actuators[0]

    @cached_property
    def force_range(self) -> tuple[float, float]:
        """Of all together along the velocity, [N] or [N m]; infinite where unlimited.

        The limit of a joint's or tendon's total counts; of a tendon's only if all its actuators
        have one gear, since MuJoCo limits their sum before the gears.
        """
        model, joint, tendon = self.model, self.joint, self.tendon
        each = zip(self.ids, self.outputs, self.gear, strict=True)
        span = np.sum([np.sort(g * _force_range(model, k, out)) for k, out, g in each], axis=0)
        if joint is not None and model.jnt_actfrclimited[joint]:
            span = np.clip(span, *model.jnt_actfrcrange[joint])
        if tendon is not None and model.tendon_actfrclimited[tendon] and len(set(self.gear)) == 1:
            span = np.clip(span, *np.sort(self.gear[0] * model.tendon_actfrcrange[tendon]))
        least, most = span.tolist()
        return least, most

    @property
    def one_sided(self) -> int:
        """1 or -1 where the actuators push in this direction of the velocity only; 0 is both."""
        least, most = self.force_range
        return int(least >= 0.0) - int(most <= 0.0)


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


def drives(model: mujoco.MjModel, *, disabled: bool = False) -> tuple[Drive, ...]:
    """The active velocities of a model, in the order of their first actuators.

    Actuators of one joint, of one tendon, or with parallel gears at one site or ball joint share a
    velocity. Those that `opt.disableactuator` switches off move nothing.

    Args:
        model: The model.
        disabled: Whether actuators that are switched off count all the same.

    Raises:
        ModelError: An actuator that adheres to contacts, or one of gear 0.
    """
    shared: dict[_Moved, list[_Output]] = {}
    for k in range(model.nactuator):
        if disabled or not is_disabled(model, k):
            for output in _outputs(model, k):
                shared.setdefault(output.moved, []).append(output)
    return tuple(_drive(model, outputs) for outputs in shared.values())


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


def actuated_velocities(model: mujoco.MjModel) -> NDArray[np.intp]:
    """Velocity index of each actuator, disabled ones too, of a machine with one on each joint.

    Raises:
        ModelError: An actuator not on a slide or hinge joint, one of gear 0, or two on one joint.
    """
    for drive in (of_model := drives(model, disabled=True)):
        if drive.joint is None:
            raise ModelError(
                f'actuator "{drive.actuators[0]}" does not drive a slide or hinge joint'
            )
        if len(drive.actuators) > 1:
            both = " and ".join(f'"{name}"' for name in drive.actuators)
            raise ModelError(f'actuators {both} drive the same joint "{drive.name}"')
    return model.jnt_dofadr[[drive.joint for drive in of_model]].astype(np.intp)


def drive_rows(model: mujoco.MjModel, data: mujoco.MjData, some: Sequence[Drive]) -> Array:
    """Rows (len(some), nv) whose products with qvel are the velocities of some drives.

    `data` has been through `mj_transmission`.
    """
    if not some:
        return np.zeros((0, model.nv))
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
        gear = math.copysign(math.hypot(*gears), next(filter(None, gears), 0.0))
        direction = tuple(round(g / gear, 12) for g in gears) if gear else ()
    if not gear:
        raise ModelError(f"{_called(model, k)} has gear 0 and moves nothing: take it out")
    return [_Output(_Moved(kind, end, other_end, direction), gear, k, first)]


def _drive(model: mujoco.MjModel, outputs: list[_Output]) -> Drive:
    moved, gear, ids, numbers = zip(*outputs, strict=True)
    kind, end, _, direction = moved[0]
    joint = end if kind == _JOINT and not direction else None
    return Drive(model, ids, gear, numbers, joint, end if kind == _TENDON else None)


def _force_range(model: mujoco.MjModel, actuator: int, output: int) -> Array:
    """Least and most of the force that one output exerts, (2,)."""
    least, most = -np.inf, np.inf
    if model.actuator_forcelimited[output]:
        least, most = model.actuator_forcerange[output]
    control = int(model.actuator_ctrladr[actuator])
    if model.actuator_gaintype[actuator] == _MUSCLE:
        most = min(most, 0.0)  # it pulls
    elif (
        model.actuator_gaintype[actuator] == _FIXED
        and model.actuator_biastype[actuator] == _NO_BIAS
        and model.actuator_ctrllimited[control]
    ):
        ends = np.sort(model.actuator_gainprm[actuator, 0] * model.actuator_ctrlrange[control])
        least, most = max(least, ends[0]), min(most, ends[1])
    return np.array([least, most])


def _called(model: mujoco.MjModel, actuator: int) -> str:
    return f'actuator "{name_of(model.actuator(actuator))}"'
