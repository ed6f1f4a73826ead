"""An active velocity: what moves, which actuators move it, and with which forces."""

from collections.abc import Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cached_property
from itertools import chain

import mujoco
import numpy as np

from sim.array import Array
from sim.mjcf.model import name_of

_MUSCLE = int(mujoco.mjtGain.mjGAIN_MUSCLE)
_FIXED, _NO_BIAS = int(mujoco.mjtGain.mjGAIN_FIXED), int(mujoco.mjtBias.mjBIAS_NONE)

_OF_JOINT, _HINGE = int(mujoco.mjtWrap.mjWRAP_JOINT), int(mujoco.mjtJoint.mjJNT_HINGE)
_AT_SITE = int(mujoco.mjtTrn.mjTRN_SITE)


def number_of(name: str, names: Sequence[Sequence[str]]) -> int:
    """The first actuator that has this name, own names before others'.

    Args:
        name: Of a joint, tendon or actuator; or digits, which are its number where none has them
            for a name.
        names: Of each actuator, its own name first.

    Raises:
        ValueError: None has; the nearest is named.
    """
    for number, own in enumerate(names):
        if name == own[0]:
            return number
    for number, own in enumerate(names):
        if name in own:
            return number
    if name in (numbers := [str(number) for number in range(len(names))]):
        return numbers.index(name)
    near = get_close_matches(name, chain(*names), 1)
    known = ", ".join(own[0] for own in names)
    hint = f'did you mean "{near[0]}"?' if near else f"it has {known}"
    raise ValueError(f'the robot has no actuator or joint "{name:.80}"; {hint}')


def names_of(some: Sequence["Drive"]) -> tuple[tuple[str, ...], ...]:
    """All names of each drive, first the one for people, which no other drive has first.

    This is the file's own name of the actuator; of several actuators, or one without a name, that
    of their joint or tendon.
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
        has_length: Whether `data.actuator_length` is a length whose slope is the velocity's row:
            of joints, tendons and slider-cranks. Of others it is zero, or another quantity.
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
    def unit(self) -> str:
        """Of its displacement: "rad" if it turns, or its tendon only adds up angles, else "m"."""
        if self.joint is None and self.tendon is None:
            force, moment = np.split(self.model.actuator_gear[self.ids[0]], 2)
            of_site = self.model.actuator_trntype[self.ids[0]] == _AT_SITE
            return "rad" if of_site and moment.any() and not force.any() else "m"
        return "rad" if is_turn(self.model, self.joint, self.tendon) else "m"

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


def is_turn(model: mujoco.MjModel, joint: int | None, tendon: int | None) -> bool:
    """Whether a joint turns, or a tendon only adds up angles; otherwise it is a length."""
    joints = [joint] if joint is not None else []
    if tendon is not None:
        first = int(model.tendon_adr[tendon])
        parts = slice(first, first + int(model.tendon_num[tendon]))
        if (model.wrap_type[parts] == _OF_JOINT).all():
            joints = model.wrap_objid[parts].tolist()
    return bool(joints) and all(model.jnt_type[joint] == _HINGE for joint in joints)


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
