"""Actuators of a model: the velocities that they drive, their force laws, their locks."""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cached_property
from itertools import chain
from typing import NamedTuple

import mujoco
import numpy as np

from sim.array import Array
from sim.errors import ModelError
from sim.mjcf.model import name_of, with_sleepers

_TRN, _JNT, _GAIN, _BIAS = mujoco.mjtTrn, mujoco.mjtJoint, mujoco.mjtGain, mujoco.mjtBias
_ON_JOINT = frozenset({_TRN.mjTRN_JOINT, _TRN.mjTRN_JOINTINPARENT})
_COUPLES = {mujoco.mjtEq.mjEQ_JOINT: "joint", mujoco.mjtEq.mjEQ_TENDON: "tendon"}
_OTHER_GAINS = {
    _GAIN.mjGAIN_AFFINE: "an actuator of variable gain",
    _GAIN.mjGAIN_MUSCLE: "a muscle",
    _GAIN.mjGAIN_DCMOTOR: "a motor with electric dynamics",
    _GAIN.mjGAIN_PID: "a PID controller",
    _GAIN.mjGAIN_SO3: "an orientation servo of three controls",
}

_DIGITS = 9
"""Digits to which directions at one site or ball joint must agree to share a velocity."""
STEPS = 2
"""Time constant of a lock, in physics steps: the stiffest that MuJoCo integrates."""

Lockable = tuple[str, int]
"""Element that a lock can hold: "joint" (slide or hinge) or "tendon", and its number."""


@dataclass(frozen=True, eq=False)
class Drive:
    """Active velocity and the actuators that move it.

    Attributes:
        ids: Numbers of the actuators.
        gear: Gear of each actuator, which multiplies the velocity to the rate of its length, and
            its force to that along the velocity.
        outputs: Index of each actuator in `data.actuator_force`. The first row in
            `data.actuator_moment`, divided by the gear, maps qvel to the velocity.
        joint: Number of the slide or hinge that is driven; None if there is none.
        has_length: Whether `data.actuator_length` is a length whose gradient is the velocity's
            row: true for joints, tendons and slider-cranks.
    """

    model: mujoco.MjModel
    ids: tuple[int, ...]
    gear: tuple[float, ...]
    outputs: tuple[int, ...]
    joint: int | None
    tendon: int | None
    has_length: bool

    @cached_property
    def actuators(self) -> tuple[str, ...]:
        """Names of the actuators; "number k" for one without a name."""
        return tuple(name_of(self.model.actuator(k)) for k in self.ids)

    @cached_property
    def name(self) -> str:
        """Name of the joint or tendon; the first actuator's name for other transmissions."""
        part = self.lockable
        return (part and getattr(self.model, part[0])(part[1]).name) or self.actuators[0]

    @property
    def lockable(self) -> Lockable | None:
        """Joint or tendon that a lock can hold; None for any other transmission."""
        return lockable_by(self.model, self.ids[0])

    @cached_property
    def unit(self) -> str:
        """Unit of the displacement: "rad" for rotations and tendons that sum angles, else "m"."""
        if self.lockable:
            turns = is_turn(self.model, self.joint, self.tendon)
        else:
            model, k = self.model, self.ids[0]
            force, moment = np.split(model.actuator_gear[self.outputs[0]], 2)
            kind = _TRN(model.actuator_trntype[k])
            if _is_on_ball(model, k):
                force, moment = moment, force  # the first three are its axis
            has_both = kind in _ON_JOINT or kind == _TRN.mjTRN_SITE
            turns = kind == _TRN.mjTRN_SO3 or (has_both and moment.any() and not force.any())
        return "rad" if turns else "m"

    @cached_property
    def force_range(self) -> tuple[float, float]:
        """Range of the total force along the velocity, [N] or [N m]; infinite where unlimited.

        Limits of the total at a joint or tendon are included; at a tendon only if all its
        actuators have the same gear, since MuJoCo limits their sum before the gears.
        """
        model, joint, tendon = self.model, self.joint, self.tendon
        pairs = zip(self.ids, self.gear, strict=True)
        span = np.sum([np.sort(g * _force_range(model, k)) for k, g in pairs], axis=0)
        if joint is not None and model.jnt_actfrclimited[joint]:
            span = np.clip(span, *model.jnt_actfrcrange[joint])
        if tendon is not None and model.tendon_actfrclimited[tendon] and len(set(self.gear)) == 1:
            span = np.clip(span, *np.sort(self.gear[0] * model.tendon_actfrcrange[tendon]))
        least, most = span.tolist()
        return least, most

    @property
    def one_sided(self) -> int:
        """Sign of the only direction in which the actuators can push; 0 if they push in both."""
        least, most = self.force_range
        return int(least >= 0.0) - int(most <= 0.0)


def is_turn(model: mujoco.MjModel, joint: int | None, tendon: int | None) -> bool:
    """Return whether a joint rotates, or a tendon only sums angles; otherwise it is a length."""
    joints = [joint] if joint is not None else []
    if tendon is not None:
        first = int(model.tendon_adr[tendon])
        parts = slice(first, first + int(model.tendon_num[tendon]))
        if (model.wrap_type[parts] == mujoco.mjtWrap.mjWRAP_JOINT).all():
            joints = model.wrap_objid[parts].tolist()
    return bool(joints) and all(_JNT(model.jnt_type[joint]) == _JNT.mjJNT_HINGE for joint in joints)


def force_limits(model: mujoco.MjModel, actuator: int) -> tuple[float, float]:
    """Return the least and greatest force that the file allows each output of an actuator."""
    if not model.actuator_forcelimited[actuator]:
        return -np.inf, np.inf
    least, most = model.actuator_forcerange[actuator].tolist()
    # Of several outputs the norm is limited.
    return -most if model.actuator_outnum[actuator] > 1 else least, most


def _force_range(model: mujoco.MjModel, actuator: int) -> Array:
    """Return the least and greatest force that each output of an actuator can exert, (2,)."""
    least, most = force_limits(model, actuator)
    control = int(model.actuator_ctrladr[actuator])
    gain, bias = _GAIN(model.actuator_gaintype[actuator]), _BIAS(model.actuator_biastype[actuator])
    is_motor = gain == _GAIN.mjGAIN_FIXED and bias == _BIAS.mjBIAS_NONE
    if gain == _GAIN.mjGAIN_MUSCLE:
        most = min(most, 0.0)  # a muscle only pulls
    elif is_motor and model.actuator_ctrllimited[control]:
        ends = np.sort(model.actuator_gainprm[actuator, 0] * model.actuator_ctrlrange[control])
        least, most = max(least, ends[0]), min(most, ends[1])
    return np.array([least, most])


def number_of(name: str, names: Sequence[Sequence[str]]) -> int:
    """Return the number of an actuator given by a name, or by its number in digits.

    `names` has the names of each actuator (own, joint or tendon), its own first, with priority.

    Raises:
        ValueError: No actuator has this name; the message suggests the nearest one.
    """
    backwards = [*enumerate(names)][::-1]  # for equal names the first actuator is kept
    numbers = {str(k): k for k, _ in backwards}
    numbers |= {label: k for k, labels in backwards for label in labels}
    numbers |= {labels[0]: k for k, labels in backwards}
    if name in numbers:
        return numbers[name]
    near = get_close_matches(name, chain(*names), 1)
    own = ", ".join(labels[0] for labels in names)
    hint = f'did you mean "{near[0]}"?' if near else f"it has {own}"
    raise ValueError(f'the robot has no actuator or joint "{name:.80}"; {hint}')


def names_of(some: Sequence[Drive]) -> tuple[tuple[str, ...], ...]:
    """Return all names of each drive, the display name first; display names are unique.

    The display name is that of a single named actuator, else that of the joint or tendon.
    """
    given = [k for k, d in enumerate(some) if len(d.ids) == 1 and d.model.actuator(d.ids[0]).name]
    own = [
        (*d.actuators, d.name) if k in given else (d.name, *d.actuators) for k, d in enumerate(some)
    ]
    first = dict[int, str]()
    for k in (*given, *(k for k in range(len(own)) if k not in given)):
        free = (name for name in own[k] if name not in first.values())
        first[k] = next(free, f"{own[k][0]} ({k})")
    return tuple(tuple(dict.fromkeys((first[k], *names))) for k, names in enumerate(own))


_Motion = tuple[mujoco.mjtTrn, int, int, tuple[float, ...]]
"""Kind, ends and direction of a transmission: equal for all actuators of one velocity."""


def drives(
    model: mujoco.MjModel, *, disabled: bool = False, among: Collection[int] | None = None
) -> tuple[Drive, ...]:
    """List the active velocities of a model, in the order of their first actuators.

    Actuators of one joint, of one tendon, or with parallel gears at one site or ball joint share a
    velocity; at a site, a ball or a free joint it is that along the gear of the first of them.

    Args:
        model: Any model.
        disabled: Whether to include actuators that `opt.disableactuator` switches off.
        among: Numbers of the actuators to include; None is all.

    Raises:
        ModelError: An actuator adheres to contacts, or has gear 0.
    """
    shared: dict[_Motion, list[tuple[float, int, int]]] = {}
    for k in range(model.nactuator) if among is None else among:
        off = is_disabled(model, k)
        if not off or (disabled and _TRN(model.actuator_trntype[k]) != _TRN.mjTRN_BODY):
            for motion, gear, output in _outputs(model, k):
                shared.setdefault(motion, []).append((gear, k, output))
    return tuple(_drive(model, motion, of) for motion, of in shared.items())


def required_drives(
    model: mujoco.MjModel, among: Collection[int] | None = None
) -> tuple[Drive, ...]:
    """List the active velocities as :func:`drives` does; raise ModelError if there are none."""
    if enabled := drives(model, among=among):
        return enabled
    raise ModelError("the model has no enabled actuator, so nothing can be commanded: add one")


def extra_drives(of_model: tuple[Drive, ...]) -> tuple[Drive, ...]:
    """Select the drives that move no single joint; their velocities follow those of the joints."""
    return tuple(drive for drive in of_model if drive.joint is None)


def is_disabled(model: mujoco.MjModel, actuator: int) -> bool:
    """Return whether `opt.disableactuator` switches the actuator off."""
    group = int(model.actuator_group[actuator])
    return 0 <= group < 31 and bool(model.opt.disableactuator >> group & 1)  # all groups it has


def drive_rows(model: mujoco.MjModel, data: mujoco.MjData, some: Sequence[Drive]) -> Array:
    """Return the rows (k, nv) that map qvel to the velocities of k drives.

    `mj_transmission` must have been called on `data`.
    """
    if not some:
        return np.zeros((0, model.nv))
    with_sleepers(model, data, mujoco.mj_tendon, mujoco.mj_transmission)
    moments = moments_of(model, data)[[d.outputs[0] for d in some]]
    return moments / np.array([[d.gear[0]] for d in some])


def moments_of(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    """Return the moment arms of all actuator outputs, (nout, nv), as they are in `data`."""
    moments = np.zeros((model.nout, model.nv))
    places = data.moment_rownnz, data.moment_rowadr, data.moment_colind
    mujoco.mju_sparse2dense(moments, data.actuator_moment, *places)
    return moments


def _outputs(model: mujoco.MjModel, k: int) -> list[tuple[_Motion, float, int]]:
    """List motion, gear and number of each output of an actuator (orientation servo: three)."""
    kind, first = _TRN(model.actuator_trntype[k]), int(model.actuator_outadr[k])
    end, other_end = model.actuator_trnid[k].tolist()
    if kind == _TRN.mjTRN_BODY:
        raise ModelError(
            f"{_called(model, k)} adheres to bodies in contact and drives no velocity: remove it "
            "from the model, or disable its group and pin what it holds"
        )
    if kind == _TRN.mjTRN_SO3:
        return [((kind, end, other_end, (i,)), 1.0, first + i) for i in range(3)]
    gears = model.actuator_gear[first].tolist()
    gear, direction = gears[0], ()
    if part := lockable_by(model, k):
        kind = _TRN.mjTRN_JOINT if part[0] == "joint" else kind
    elif kind == _TRN.mjTRN_SLIDERCRANK:
        direction = (float(model.actuator_cranklength[k]),)
    else:
        # A ball or free joint, or a site: the velocity along a direction of three or six numbers.
        # Opposite directions share one velocity.
        used = gears[: 3 if _is_on_ball(model, k) else 6]
        size = math.hypot(*used)
        # The first component larger than the round-off of a sine or cosine.
        gear = math.copysign(size, next((g for g in used if abs(g) > 10.0**-_DIGITS * size), 0.0))
        direction = tuple(round(g / gear, _DIGITS) for g in used) if gear else ()
    if not gear:
        raise ModelError(f"{_called(model, k)} has gear 0 and moves nothing: remove it")
    return [((kind, end, other_end, direction), gear, first)]


def _is_on_ball(model: mujoco.MjModel, actuator: int) -> bool:
    """Return whether an actuator turns a ball joint: three numbers of its gear are used."""
    joint = int(model.actuator_trnid[actuator, 0])
    is_on_joint = _TRN(model.actuator_trntype[actuator]) in _ON_JOINT
    return is_on_joint and _JNT(model.jnt_type[joint]) == _JNT.mjJNT_BALL


def _drive(model: mujoco.MjModel, motion: _Motion, outputs: list[tuple[float, int, int]]) -> Drive:
    gear, ids, numbers = zip(*outputs, strict=True)
    of, number = lockable_by(model, ids[0]) or ("", 0)
    has_length = bool(of) or motion[0] == _TRN.mjTRN_SLIDERCRANK
    if not has_length and len(motion[3]) > 1:  # their sign came from the first component
        gear = tuple(math.copysign(1.0, gear[0]) * size for size in gear)
    ends = number if of == "joint" else None, number if of == "tendon" else None
    return Drive(model, ids, gear, numbers, *ends, has_length)


def _called(model: mujoco.MjModel, actuator: int) -> str:
    return f'actuator "{name_of(model.actuator(actuator))}"'


class Law(NamedTuple):
    """Force law before the gear: gain control + constant + per_length length + per_speed speed.

    A torque motor has a gain only, a position servo a negative `per_length`.
    """

    gain: float
    constant: float = 0.0
    per_length: float = 0.0
    per_speed: float = 0.0


def law_of(model: mujoco.MjModel, actuator: int) -> Law:
    """Read the force law of an actuator.

    Raises:
        ModelError: The law has another form or gain zero, or the actuator has an internal state.
    """
    called = _called(model, actuator)
    gain, bias = _GAIN(model.actuator_gaintype[actuator]), _BIAS(model.actuator_biastype[actuator])
    if gain != _GAIN.mjGAIN_FIXED or bias not in (_BIAS.mjBIAS_NONE, _BIAS.mjBIAS_AFFINE):
        raise ModelError(
            f"{called} is {_OTHER_GAINS.get(gain, 'user-defined')}: only servos and motors of "
            "fixed gain and linear feedback are commanded by displacements"
        )
    if model.actuator_actnum[actuator]:
        raise ModelError(
            f"{called} has an internal state, so its command cannot be its displacement"
        )
    if not model.actuator_gainprm[actuator, 0]:
        raise ModelError(f"{called} has gain 0, so it cannot be commanded: remove it")
    feedback = model.actuator_biasprm[actuator, :3].tolist() if bias == _BIAS.mjBIAS_AFFINE else ()
    return Law(float(model.actuator_gainprm[actuator, 0]), *feedback)


def lock_name(actuator: int) -> str:
    """Return the default name of the lock of actuator 0..nu-1."""
    return f"lock{actuator + 1}"


def locked_by(model: mujoco.MjModel, equality: int) -> Lockable | None:
    """Return the joint or tendon that the equality fixes on its own; None for other equalities."""
    kind = _COUPLES.get(mujoco.mjtEq(model.eq_type[equality]))
    alone = model.eq_obj2id[equality] == -1
    return (kind, int(model.eq_obj1id[equality])) if kind and alone else None


def lockable_by(model: mujoco.MjModel, actuator: int) -> Lockable | None:
    """Return the slide, hinge or tendon that an actuator moves; None for other transmissions."""
    end, kind = int(model.actuator_trnid[actuator, 0]), _TRN(model.actuator_trntype[actuator])
    if kind in _ON_JOINT and _JNT(model.jnt_type[end]) in (_JNT.mjJNT_SLIDE, _JNT.mjJNT_HINGE):
        return "joint", end
    return ("tendon", end) if kind == _TRN.mjTRN_TENDON else None


def add_locks(spec: mujoco.MjSpec, model: mujoco.MjModel) -> bool:
    """Add an inactive lock for each actuated joint or tendon without one; return if one was added.

    `spec`, from which `model` was compiled, is changed; the caller compiles it again.
    """
    taken = {model.equality(k).name for k in range(model.neq)}
    locked, before = {locked_by(model, k) for k in range(model.neq)}, len(spec.equalities)
    types = {kind: type_ for type_, kind in _COUPLES.items()}
    for k in range(model.nactuator):
        part, name = lockable_by(model, k), lock_name(k)
        if part is None or part in locked:
            continue
        kind, of = part[0], getattr(model, part[0])(part[1]).name
        if name in taken:
            text = f'the lock of {kind} "{of}" cannot be added: another equality is named "{name}"'
            raise ModelError(text)
        locked.add(part)
        lock = spec.add_equality(name=name, type=types[kind], name1=of, active=False)
        stiffen(lock, model.opt.timestep)
    return len(spec.equalities) > before


def weakens_locks(model: mujoco.MjModel) -> bool:
    """Return whether the integrator applies dampers after locks and so moves locked joints."""
    integrator, flags = model.opt.integrator, model.opt.disableflags
    if integrator == mujoco.mjtIntegrator.mjINT_EULER:
        explicit = mujoco.mjtDisableBit.mjDSBL_EULERDAMP | mujoco.mjtDisableBit.mjDSBL_DAMPER
        return bool(model.dof_damping.any() and not flags & explicit)
    kinds = (mujoco.mjtIntegrator.mjINT_IMPLICIT, mujoco.mjtIntegrator.mjINT_IMPLICITFAST)
    return integrator in kinds


def stiffness_of(model: mujoco.MjModel, equality: int) -> float:
    """Return the approximate restoring acceleration of an equality per displacement, [1/s^2]."""
    (time_s, damping), most = model.eq_solref[equality], model.eq_solimp[equality, 1]
    return float(-time_s / most**2 if time_s < 0 else 1 / (most * time_s * damping) ** 2)


def stiffen(equality: mujoco.MjsEquality, timestep_s: float) -> None:
    """Make an equality as stiff as the time step [s] allows."""
    equality.solref = [STEPS * timestep_s, 1.0]
    equality.solimp = [0.9999, 0.9999, 0.001, 0.5, 2]
