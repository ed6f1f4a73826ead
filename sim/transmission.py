"""What the actuators of a model move: one active velocity each, or one for several."""

from dataclasses import dataclass
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.array import Array
from sim.errors import ModelError
from sim.model import name_of

_TRN = mujoco.mjtTrn
_ONE_AXIS = frozenset({int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE)})
_ON_JOINT = frozenset({int(_TRN.mjTRN_JOINT), int(_TRN.mjTRN_JOINTINPARENT)})
_MUSCLE = int(mujoco.mjtGain.mjGAIN_MUSCLE)
_FIXED, _NO_BIAS = int(mujoco.mjtGain.mjGAIN_FIXED), int(mujoco.mjtBias.mjBIAS_NONE)
_GROUPS = 31
"""Groups of actuators that `opt.disableactuator` can switch off."""


@dataclass(frozen=True)
class Drive:
    """One active velocity, and the actuators that move it.

    Attributes:
        name: Of the joint or tendon; for other transmissions of the first actuator.
        actuators: Their names, "number k" where they have none.
        ids: Their numbers in the model.
        gear: Of each: its length grows by gear times the velocity, its force acts gear times.
        joint: The slide or hinge joint driven; None for any other transmission.
        tendon: The tendon driven, or None.
        output: First output of the first actuator, whose row of `data.actuator_moment`, divided by
            its gear, gives the velocity from the joints'.
        force_range: Of all together along the velocity, [N] or [N m]; infinite where unlimited.
    """

    name: str
    actuators: tuple[str, ...]
    ids: tuple[int, ...]
    gear: tuple[float, ...]
    joint: int | None
    tendon: int | None
    output: int
    force_range: tuple[float, float]

    @property
    def one_sided(self) -> int:
        """1 or -1 where the actuators push in this direction of the velocity only; 0 is both."""
        least, most = self.force_range
        return int(least >= 0.0) - int(most <= 0.0)


class _Output(NamedTuple):
    """One output of an enabled actuator: what tells its velocity from others, and its gear."""

    moved: tuple[object, ...]
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
    shared: dict[tuple[object, ...], list[_Output]] = {}
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


def drive_row(model: mujoco.MjModel, data: mujoco.MjData, drive: Drive) -> Array:
    """Row (nv,) whose product with qvel is the velocity of the drive, at the present transmission.

    `data` has been through `mj_transmission`.
    """
    row = np.zeros(model.nv)
    start = data.moment_rowadr[drive.output]
    entries = slice(start, start + data.moment_rownnz[drive.output])
    row[data.moment_colind[entries]] = data.actuator_moment[entries]
    return row / drive.gear[0]


def _outputs(model: mujoco.MjModel, k: int) -> list[_Output]:
    """The outputs of an actuator; only an orientation servo has more than one."""
    kind, first = int(model.actuator_trntype[k]), int(model.actuator_outadr[k])
    ends = tuple(model.actuator_trnid[k].tolist())
    if kind == _TRN.mjTRN_BODY:
        raise ModelError(
            f"{_called(model, k)} adheres to whatever touches it, which is no velocity: take it "
            "out of the model, or disable its group and pin what it holds"
        )
    if kind == _TRN.mjTRN_SO3:
        return [_Output((kind, ends, i), 1.0, k, first + i) for i in range(3)]
    gear = model.actuator_gear[first]
    moved, size = _moved(model, k, kind, ends, gear)
    if size == 0.0:
        raise ModelError(f"{_called(model, k)} has gear 0 and moves nothing: take it out")
    return [_Output(moved, size, k, first)]


def _moved(
    model: mujoco.MjModel, k: int, kind: int, ends: tuple[int, ...], gear: Array
) -> tuple[tuple[object, ...], float]:
    """What an actuator moves, the same for all that share its velocity, and its gear along it."""
    if kind in _ON_JOINT and int(model.jnt_type[ends[0]]) in _ONE_AXIS:
        return ("joint", ends[0]), float(gear[0])
    if kind == _TRN.mjTRN_TENDON:
        return ("tendon", ends[0]), float(gear[0])
    if kind == _TRN.mjTRN_SLIDERCRANK:
        return (kind, ends, float(model.actuator_cranklength[k])), float(gear[0])
    # A ball or free joint, or a site: the velocity along a direction of three or six numbers, the
    # same for opposite ones.
    size = float(np.linalg.norm(gear))
    if not size:
        return (), 0.0
    size = float(np.copysign(size, gear[np.flatnonzero(gear)[0]]))
    return (kind, ends, tuple(np.round(gear / size, 12).tolist())), size


def _drive(model: mujoco.MjModel, outputs: list[_Output]) -> Drive:
    first = outputs[0]
    names = tuple(name_of(model.actuator(o.actuator)) for o in outputs)
    least, most = np.sum([_force_range(model, o) for o in outputs], axis=0).tolist()
    joint, tendon, name = None, None, ""
    if first.moved[0] == "joint":
        joint = int(model.actuator_trnid[first.actuator, 0])
        name = model.joint(joint).name
        if model.jnt_actfrclimited[joint]:
            least, most = np.clip((least, most), *model.jnt_actfrcrange[joint]).tolist()
    elif first.moved[0] == "tendon":
        tendon = int(model.actuator_trnid[first.actuator, 0])
        name = model.tendon(tendon).name
        if model.tendon_actfrclimited[tendon]:
            least, most = np.clip((least, most), *model.tendon_actfrcrange[tendon]).tolist()
    return Drive(
        name=name or names[0],
        actuators=names,
        ids=tuple(o.actuator for o in outputs),
        gear=tuple(o.gear for o in outputs),
        joint=joint,
        tendon=tendon,
        output=first.output,
        force_range=(least, most),
    )


def _force_range(model: mujoco.MjModel, output: _Output) -> tuple[float, float]:
    """Least and most of the force that one output exerts along its velocity."""
    k, least, most = output.actuator, -np.inf, np.inf
    if model.actuator_forcelimited[output.output]:
        least, most = model.actuator_forcerange[output.output]
    control = int(model.actuator_ctrladr[k])
    if model.actuator_gaintype[k] == _MUSCLE:
        most = min(most, 0.0)  # it pulls
    elif (
        model.actuator_gaintype[k] == _FIXED
        and model.actuator_biastype[k] == _NO_BIAS
        and model.actuator_ctrllimited[control]
    ):
        ends = sorted(model.actuator_gainprm[k, 0] * model.actuator_ctrlrange[control])
        least, most = max(least, ends[0]), min(most, ends[1])
    least, most = sorted((output.gear * least, output.gear * most))
    return float(least), float(most)


def _called(model: mujoco.MjModel, actuator: int) -> str:
    return f'actuator "{name_of(model.actuator(actuator))}"'
