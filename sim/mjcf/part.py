"""Which joints and actuators of a file a task involves, by its structure alone."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.mjcf.frame import Located
from sim.mjcf.model import joint_name

_EQ, _TRN, _WRAP = mujoco.mjtEq, mujoco.mjtTrn, mujoco.mjtWrap
_BETWEEN_BODIES = int(_EQ.mjEQ_CONNECT), int(_EQ.mjEQ_WELD)
_OF_JOINTS, _OF_TENDONS = int(_EQ.mjEQ_JOINT), int(_EQ.mjEQ_TENDON)
_OF_FLEXES = int(_EQ.mjEQ_FLEX), int(_EQ.mjEQ_FLEXVERT), int(_EQ.mjEQ_FLEXSTRAIN)
_ON_JOINT = int(_TRN.mjTRN_JOINT), int(_TRN.mjTRN_JOINTINPARENT)
_ON_TENDON, _ON_BODY = int(_TRN.mjTRN_TENDON), int(_TRN.mjTRN_BODY)
_WRAPPED_JOINT, _WRAPPED_SITE = int(_WRAP.mjWRAP_JOINT), int(_WRAP.mjWRAP_SITE)
_SITE = int(mujoco.mjtObj.mjOBJ_SITE)

Bodies = frozenset[int]
"""Bodies that have joints."""


@dataclass(frozen=True)
class Part:
    """What of a model a task involves.

    Attributes:
        model: The model.
        bodies: Those with joints that are part of it.
        actuators: Numbers of those that move these bodies and no others.
    """

    model: mujoco.MjModel
    bodies: Bodies
    actuators: tuple[int, ...]

    @cached_property
    def rest(self) -> tuple[int, ...]:
        """Bodies with joints that are no part of it."""
        every = np.flatnonzero(self.model.body_dofnum).tolist()
        return tuple(body for body in every if body not in self.bodies)

    @cached_property
    def still(self) -> NDArray[np.intp]:
        """Velocities that are no part of it."""
        return np.flatnonzero(np.isin(self.model.dof_bodyid, self.rest)).astype(np.intp)

    @cached_property
    def apart(self) -> tuple[int, ...]:
        """Equalities that are no part of it."""
        rest, model = frozenset(self.rest), self.model
        return tuple(k for k in range(model.neq) if equality_bodies(model, k) & rest)

    @cached_property
    def positions(self) -> NDArray[np.intp]:
        """Places in `qpos` of the joints that are part of it."""
        joints = np.repeat(
            np.arange(self.model.njnt), np.diff([*self.model.jnt_qposadr, self.model.nq])
        )
        return np.flatnonzero(~np.isin(self.model.jnt_bodyid[joints], self.rest)).astype(np.intp)

    @cached_property
    def left_out(self) -> tuple[str, ...]:
        """Names of the joints that are no part of it, of bodies where joints have none."""
        model = self.model
        joints = np.flatnonzero(np.isin(model.jnt_bodyid, self.rest))
        return tuple(dict.fromkeys(joint_name(model, int(j)) for j in joints))


def task_part(model: mujoco.MjModel, frames: Iterable[Located], active: Iterable[int]) -> Part:
    """What the task of these frames involves: whatever moves them, and whatever that is tied to.

    The joints that carry a frame; those that an active equality, or a tendon that pulls, ties to
    them, along the way from one end of the tie to the other; and so on. A hand that an arm carries
    is tied to nothing that moves the arm, and is no part of it.

    Args:
        model: The model.
        frames: Of the task, and of its axes.
        active: Numbers of the equalities that are active.
    """
    carried = [bodies for frame in frames if (bodies := _above(model, frame.body))]
    part = frozenset[int]().union(*carried)
    moved = [moved_bodies(model, k) for k in range(model.nactuator)]
    ties = [*(equality_bodies(model, k) for k in active), *_tendons(model), *moved]
    while reached := [tie for tie in ties if tie & part and not tie <= part]:
        part = part.union(*reached)
    actuators = tuple(k for k, bodies in enumerate(moved) if bodies and bodies <= part)
    return Part(model, part, actuators)


def _above(model: mujoco.MjModel, body: int) -> Bodies:
    """Bodies with joints that carry a body, itself among them."""
    found = []
    while body:
        if model.body_dofnum[body]:
            found.append(body)
        body = int(model.body_parentid[body])
    return frozenset(found)


def _between(model: mujoco.MjModel, bodies: Iterable[int]) -> Bodies:
    """Bodies with joints that move some bodies against one another."""
    chains = [_above(model, body) for body in bodies]
    return frozenset[int]().union(*chains) - frozenset.intersection(*chains)


def _of_joint(model: mujoco.MjModel, joint: int) -> Bodies:
    return frozenset([int(model.jnt_bodyid[joint])])


def tendon_bodies(model: mujoco.MjModel, tendon: int) -> Bodies:
    """Bodies with joints that change the length of a tendon."""
    wraps = range(model.tendon_adr[tendon], model.tendon_adr[tendon] + model.tendon_num[tendon])
    kinds, ends = model.wrap_type[wraps], model.wrap_objid[wraps]
    joints = (_of_joint(model, int(end)) for end in ends[kinds == _WRAPPED_JOINT])
    sites = model.site_bodyid[ends[kinds == _WRAPPED_SITE]].tolist()
    along = _between(model, sites) if sites else frozenset[int]()
    return along.union(*joints)


def equality_bodies(model: mujoco.MjModel, equality: int) -> Bodies:
    """Bodies with joints that an equality ties to one another."""
    kind = int(model.eq_type[equality])
    both = model.eq_obj1id[equality], model.eq_obj2id[equality]
    ends = [int(end) for end in both if end >= 0]
    if kind in _BETWEEN_BODIES:
        sites = model.eq_objtype[equality] == _SITE
        return _between(model, model.site_bodyid[ends].tolist() if sites else ends)
    if kind in _OF_FLEXES:
        return _between(model, _flex_bodies(model, ends[0]))
    of = {_OF_JOINTS: _of_joint, _OF_TENDONS: tendon_bodies}.get(kind)
    return frozenset[int]().union(*(of(model, end) for end in ends)) if of else frozenset()


def _flex_bodies(model: mujoco.MjModel, flex: int) -> list[int]:
    """Bodies of the vertices of a flex, or of its nodes where these move it."""
    of = "node" if model.flex_interp[flex] else "vert"
    start, count = (getattr(model, f"flex_{of}{field}")[flex] for field in ("adr", "num"))
    return sorted(set(getattr(model, f"flex_{of}bodyid")[start : start + count].tolist()))


def _tendons(model: mujoco.MjModel) -> Iterator[Bodies]:
    """What a tendon ties by itself: with a spring, a damper, friction or a limit."""
    pulls = (
        model.tendon_stiffness.astype(bool)
        | model.tendon_damping.astype(bool)
        | model.tendon_frictionloss.astype(bool)
        | model.tendon_limited.astype(bool)
    )
    return (tendon_bodies(model, int(k)) for k in np.flatnonzero(pulls))


def moved_bodies(model: mujoco.MjModel, actuator: int) -> Bodies:
    """Bodies with joints on which an actuator acts."""
    kind = int(model.actuator_trntype[actuator])
    end, other = model.actuator_trnid[actuator].tolist()
    if kind in _ON_JOINT:
        return _of_joint(model, end)
    if kind == _ON_TENDON:
        return tendon_bodies(model, end)
    if kind == _ON_BODY:  # adhesion: it moves nothing
        return frozenset()
    at = [int(model.site_bodyid[end])]
    return _between(model, [*at, int(model.site_bodyid[other]) if other >= 0 else 0])
