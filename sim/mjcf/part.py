"""Bodies and actuators of a model that a task involves, found from its structure."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.mjcf.frame import Located
from sim.mjcf.model import joint_name

_EQ, _TRN, _WRAP = mujoco.mjtEq, mujoco.mjtTrn, mujoco.mjtWrap

Bodies = frozenset[int]
"""Numbers of bodies that have joints."""


@dataclass(frozen=True)
class Part:
    """Part of a model: some bodies with joints, and the actuators that move only these."""

    model: mujoco.MjModel
    bodies: Bodies
    actuators: tuple[int, ...]

    @cached_property
    def other_bodies(self) -> tuple[int, ...]:
        """Bodies with joints outside the part."""
        every = np.flatnonzero(self.model.body_dofnum).tolist()
        return tuple(body for body in every if body not in self.bodies)

    @cached_property
    def other_velocities(self) -> NDArray[np.intp]:
        """Indices of the velocities outside the part."""
        return np.flatnonzero(np.isin(self.model.dof_bodyid, self.other_bodies)).astype(np.intp)

    @cached_property
    def other_equalities(self) -> tuple[int, ...]:
        """Numbers of the equalities that involve bodies outside the part."""
        other_bodies, model = frozenset(self.other_bodies), self.model
        return tuple(k for k in range(model.neq) if equality_bodies(model, k) & other_bodies)

    @cached_property
    def positions(self) -> NDArray[np.intp]:
        """Indices in `qpos` of the joints of the part."""
        sizes = np.diff([*self.model.jnt_qposadr, self.model.nq])
        bodies = np.repeat(self.model.jnt_bodyid, sizes)
        return np.flatnonzero(~np.isin(bodies, self.other_bodies)).astype(np.intp)

    @cached_property
    def left_out(self) -> tuple[str, ...]:
        """Names of the joints outside the part; of their bodies where joints have no name."""
        model = self.model
        joints = np.flatnonzero(np.isin(model.jnt_bodyid, self.other_bodies))
        return tuple(dict.fromkeys(joint_name(model, int(j)) for j in joints))


def task_part(model: mujoco.MjModel, frames: Iterable[Located], active: Iterable[int]) -> Part:
    """Find the part of a model that moves the frames of a task.

    It has the joints that carry a frame, and all joints coupled to these by equalities of the
    numbers `active`, by tendons that exert forces, or by actuators, directly or through others. A
    hand carried by an arm is not coupled to the arm's joints and is not included.
    """
    chains = [bodies for frame in frames if (bodies := _above(model, frame.body))]
    part = frozenset[int]().union(*chains)
    moved = [moved_bodies(model, k) for k in range(model.nactuator)]
    ties = [*(equality_bodies(model, k) for k in active), *_tendons(model), *moved]
    while reached := [tie for tie in ties if tie & part and not tie <= part]:
        part = part.union(*reached)
    actuators = tuple(k for k, bodies in enumerate(moved) if bodies and bodies <= part)
    return Part(model, part, actuators)


def _above(model: mujoco.MjModel, body: int) -> Bodies:
    """Return the bodies with joints on the chain to a body, itself included."""
    carriers = []
    while body:
        if model.body_dofnum[body]:
            carriers.append(body)
        body = int(model.body_parentid[body])
    return frozenset(carriers)


def _between(model: mujoco.MjModel, bodies: Iterable[int]) -> Bodies:
    """Return the bodies with joints that move some bodies relative to one another."""
    chains = [_above(model, body) for body in bodies]
    return frozenset[int]().union(*chains) - frozenset.intersection(*chains)


def _of_joint(model: mujoco.MjModel, joint: int) -> Bodies:
    return frozenset([int(model.jnt_bodyid[joint])])


def tendon_bodies(model: mujoco.MjModel, tendon: int) -> Bodies:
    """Return the bodies with joints that change the length of a tendon."""
    wraps = range(model.tendon_adr[tendon], model.tendon_adr[tendon] + model.tendon_num[tendon])
    kinds, ends = model.wrap_type[wraps], model.wrap_objid[wraps]
    joints = (_of_joint(model, int(end)) for end in ends[kinds == _WRAP.mjWRAP_JOINT])
    sites = model.site_bodyid[ends[kinds == _WRAP.mjWRAP_SITE]].tolist()
    along = _between(model, sites) if sites else frozenset[int]()
    return along.union(*joints)


def equality_bodies(model: mujoco.MjModel, equality: int) -> Bodies:
    """Return the bodies with joints that an equality couples."""
    kind = _EQ(model.eq_type[equality])
    ends = [int(end) for end in (model.eq_obj1id[equality], model.eq_obj2id[equality]) if end >= 0]
    if kind in (_EQ.mjEQ_CONNECT, _EQ.mjEQ_WELD):
        sites = model.eq_objtype[equality] == mujoco.mjtObj.mjOBJ_SITE
        return _between(model, model.site_bodyid[ends].tolist() if sites else ends)
    if kind in (_EQ.mjEQ_FLEX, _EQ.mjEQ_FLEXVERT, _EQ.mjEQ_FLEXSTRAIN):
        of = "node" if model.flex_interp[ends[0]] else "vert"  # nodes, if any, move its vertices
        start, count = (getattr(model, f"flex_{of}{field}")[ends[0]] for field in ("adr", "num"))
        return _between(model, getattr(model, f"flex_{of}bodyid")[start : start + count].tolist())
    of_end = {_EQ.mjEQ_JOINT: _of_joint, _EQ.mjEQ_TENDON: tendon_bodies}.get(kind)
    return frozenset[int]().union(*(of_end(model, end) for end in ends)) if of_end else frozenset()


def _tendons(model: mujoco.MjModel) -> Iterator[Bodies]:
    """Iterate over the bodies coupled by tendons with a spring, damper, friction or limit."""
    fields = "stiffness", "damping", "frictionloss", "limited"
    pulls = np.any([getattr(model, f"tendon_{field}") for field in fields], axis=0)
    return (tendon_bodies(model, int(k)) for k in np.flatnonzero(pulls))


def moved_bodies(model: mujoco.MjModel, actuator: int) -> Bodies:
    """Return the bodies with joints on which an actuator acts."""
    kind = _TRN(model.actuator_trntype[actuator])
    end, other = model.actuator_trnid[actuator].tolist()
    if kind in (_TRN.mjTRN_JOINT, _TRN.mjTRN_JOINTINPARENT):
        return _of_joint(model, end)
    if kind == _TRN.mjTRN_TENDON:
        return tendon_bodies(model, end)
    if kind == _TRN.mjTRN_BODY:  # adhesion moves no joint
        return frozenset()
    at = [int(model.site_bodyid[end])]
    return _between(model, [*at, int(model.site_bodyid[other]) if other >= 0 else 0])
