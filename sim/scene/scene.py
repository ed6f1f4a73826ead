"""A file as a robot at work: the part that a task involves, what is beside it, where all rests."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.array import Array
from sim.closing.assembly import assemble
from sim.closing.fixed import Pin
from sim.errors import ModelError
from sim.mjcf.drive import add_locks, drives, lock_name, required_drives
from sim.mjcf.frame import Body, find_frame, located
from sim.mjcf.joints import one_axis
from sim.mjcf.load import load_spec
from sim.mjcf.model import joint_name, listed, name_of
from sim.mjcf.part import Part, task_part, tendon_bodies
from sim.plant.actuators import balance
from sim.plant.servo import servoed
from sim.scene.equilibrium import is_in_equilibrium, settled, stand, ground_contacts

_FREE, _SLIDE = int(mujoco.mjtJoint.mjJNT_FREE), int(mujoco.mjtJoint.mjJNT_SLIDE)
_INSIDE = 0.05
"""Part of its range by which a joint begins inside: at its limit it could move one way only."""
_OVERLAPS = 1e-3
"""Part of the model's extent by which bodies must overlap to be in collision."""
_OTHER_START = "start elsewhere, at a keyframe for one"
_MOVED = 1e-3
"""Displacement of a joint, [rad] or [m], that is worth a sentence."""


@dataclass(frozen=True)
class Scene:
    """A file at rest, and what of it a task involves.

    Attributes:
        whole: Model of everything, for the physics.
        start: Its state at rest.
        frame: Of the task.
        part: What the task involves, where the physics has come to rest; `start` then has the
            controls that keep it there. None is everything, which its actuators hold at `start`.
        own: Model of that part alone, for its controller.
        own_start: Its state, the same, loops closed: in the physics they give a little.
        moved: How the start differs from the reference, or is in collision, and what moved until
            all came to rest, in words.
    """

    whole: mujoco.MjModel
    start: mujoco.MjData
    frame: str | Body
    part: Part | None
    own: mujoco.MjModel
    own_start: mujoco.MjData
    moved: tuple[str, ...]


def robot_scene(
    file: str | Path,
    frame: str | Body,
    axes: str | None,
    initial_state: Callable[[mujoco.MjModel], mujoco.MjData],
    pinned: Sequence[Pin] = (),
    servo_hz: float | None = None,
    settle: bool = True,
) -> Scene:
    """Split a file at rest into what a task involves and all else.

    Where the file has props, a hand or a spring beside the task, or a start that its actuators
    do not hold, the physics runs until all rests: see :func:`sim.scene.equilibrium.settled`.

    Args:
        file: MJCF.
        frame: Of the task: a site, or a body; a name is that of a site if there is one.
        axes: Site whose axes express it; None is the world.
        begin: Makes the state in which a model begins, loops open or not.
        pinned: Frames that stand.
        servo_hz: Natural frequency of position servos for torque motors; None is without.
        settle: Whether it must rest; False is for kinematics alone, which take it where it begins,
            loops closed, whatever holds it.

    Raises:
        sim.ModelError, sim.ClosureError: The file or a frame is unusable, or something moves.
    """
    spec, model, frame, stated = _compiled(file, frame, initial_state, pinned)
    required_drives(model)
    start = initial_state(model)
    _clamp(model, start)
    start = assemble(model, start)
    mujoco.mj_forward(model, start)
    frames = [located(model, "site", frame)]
    frames += [] if axes is None else [located(model, "axes", axes)]
    part = task_part(model, frames, np.flatnonzero(start.eq_active).tolist())
    if not part.actuators:
        called = frame.name if isinstance(frame, Body) else frame
        raise ModelError(f"no actuator moves {called}: take a frame that the robot carries")
    if servo_hz is not None:
        used = part.actuators
        model = servoed(model, natural_frequency_hz=servo_hz, data=start, among=used)
        part = replace(part, model=model)
    in_equilibrium = settle and is_in_equilibrium(part, start)
    balanced = not part.other_bodies and (not settle or (in_equilibrium and not pinned))
    rested = start if balanced or not settle else _rested(part, start, in_equilibrium=in_equilibrium)
    sentences = _beyond_ranges(part, stated), _in_collision(part, start), _moved(part, stated, rested)
    moved = tuple(filter(None, sentences))
    if balanced:
        return Scene(model, start, frame, None, model, start, moved)
    own = reduced(spec, part, rested) if part.other_bodies else model
    own_start = mujoco.MjData(own)
    own_start.qpos[:] = rested.qpos[part.positions]
    return Scene(model, rested, frame, part, own, assemble(own, own_start), moved)


def _compiled(
    file: str | Path,
    frame: str | Body,
    initial_state: Callable[[mujoco.MjModel], mujoco.MjData],
    pinned: Sequence[Pin],
) -> tuple[mujoco.MjSpec, mujoco.MjModel, str | Body, Array]:
    """The file with locks and pins, the task frame, and the joint positions in the file."""
    spec, model = load_spec(file)
    frame = find_frame(model, "site", frame)
    pins = [replace(pin, frame=find_frame(model, "pinned", pin.frame)) for pin in pinned]
    data = initial_state(model)
    stated = data.qpos.copy()
    _clamp(model, data)
    mujoco.mj_fwdPosition(model, data)
    stand(spec, model, data, pins)
    if add_locks(spec, model) or pinned:
        model = spec.compile()
    return spec, model, frame, stated


def _rested(part: Part, start: mujoco.MjData, *, in_equilibrium: bool) -> mujoco.MjData:
    """State in which all comes to rest; `held` says whether the start is balanced."""
    if (part.model.jnt_type == _FREE).any():  # the physics would only show it fall
        _refuse_what_moves(part, start, of="free joint")
    rested = settled(part, start)
    if in_equilibrium and not is_in_equilibrium(part, rested):
        moves = _moved(part, start.qpos, rested)
        raise ModelError(
            f"the servos balance the start and do not keep it: {moves}; make them stiffer (--servo "
            "or servo_hz= for torque motors) or pin more (pinned)"
        )
    _refuse_what_moves(part, rested)
    return rested


def _clamp(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Put joints that begin beyond their ranges inside, by :data:`_INSIDE`."""
    some = _beyond(model, data.qpos)
    at, (low, high) = model.jnt_qposadr[some], model.jnt_range[some].T
    margin = _INSIDE * (high - low)
    data.qpos[at] = data.qpos[at].clip(low + margin, high - margin)


def _beyond(model: mujoco.MjModel, qpos: Array) -> NDArray[np.intp]:
    """Joints that stand beyond their ranges."""
    some = np.flatnonzero(model.jnt_limited.astype(bool) & one_axis(model))
    given, (low, high) = qpos[model.jnt_qposadr[some]], model.jnt_range[some].T
    return some[(given < low) | (given > high)]


def _beyond_ranges(part: Part, stated: Array) -> str:
    """Sentence on joints of the part that start beyond their ranges; empty if none does."""
    model = part.model
    mine = set(np.delete(model.dof_jntid, part.other_velocities).tolist())
    texts = [
        f"{joint_name(model, j)} at {stated[model.jnt_qposadr[j]]:.3g}, its range "
        f"{model.jnt_range[j, 0]:.3g} to {model.jnt_range[j, 1]:.3g}"
        for j in _beyond(model, stated).tolist()
        if j in mine
    ]
    where = f"the start is beyond ranges, and begins inside them instead: {listed(texts)}"
    return f"{where}; {_OTHER_START}" if texts else ""


def _in_collision(part: Part, start: mujoco.MjData) -> str:
    """Sentence on bodies of the part that overlap at the start; empty if none do."""
    model, deep = part.model, dict[str, None]()
    for contact in start.contact[: start.ncon]:
        bodies = [int(model.geom_bodyid[geom]) for geom in contact.geom if geom >= 0]
        rigid = {int(model.body_weldid[body]) for body in bodies}
        if contact.dist < -_OVERLAPS * model.stat.extent and rigid & part.bodies:
            deep[" and ".join(name_of(model.body(body)) for body in bodies)] = None
    return f"the start is in collision: {listed(list(deep))}; {_OTHER_START}" if deep else ""


def _refuse_what_moves(part: Part, start: mujoco.MjData, of: str = "") -> None:
    """Refuse a part that its actuators do not hold, and say which pins would."""
    model = part.model
    result = balance(model, start, drives(model, among=part.actuators), part.other_velocities)
    if result.joint is not None and of in result.moves:
        body = name_of(model.body(model.jnt_bodyid[result.joint]))
        feet = ground_contacts(part, start) or [body]
        raise ModelError(f"{result.moves}: pin what stands, pinned {','.join(feet)}")


def _moved(part: Part, stated: Array, rested: mujoco.MjData) -> str:
    """Sentence on joints of the part that moved until all came to rest; empty if none did."""
    model, displacement = part.model, np.empty(part.model.nv)
    mujoco.mj_differentiatePos(model, displacement, 1.0, stated, rested.qpos)
    displacement[part.other_velocities] = 0.0
    moves = []
    for joint in dict.fromkeys(model.dof_jntid[np.abs(displacement) > _MOVED].tolist()):
        moved = np.abs(displacement[model.dof_jntid == joint])
        lengths = {_SLIDE: 1, _FREE: 3}.get(int(model.jnt_type[joint]), 0)
        parts = {"m": moved[:lengths], "rad": moved[lengths:]}
        far = (f"{part.max():.2g} {unit}" for unit, part in parts.items() if len(part))
        moves.append(f"{joint_name(model, joint)} by {' and '.join(far)}")
    return f"came to rest away from its start: {listed(moves)}" if moves else ""


def reduced(spec: mujoco.MjSpec, part: Part, data: mujoco.MjData) -> mujoco.MjModel:
    """Compile a model without the joints that are no part of the task, as if welded in `data`.

    What acts on them is gone. Names stay, and so do the joints, actuators and equalities of the
    part, in their order, with the servos that `part.model` has got since `spec` was compiled, which
    stays as it is; positions of `data` are up to date.
    """
    model, other_bodies = part.model, frozenset(part.other_bodies)
    spec = spec.copy()
    spec.compiler.fusestatic = False
    bodies = [body for body in spec.bodies if body.id in other_bodies]
    for body in bodies:
        _place(body, model, data)
    gone = [
        *spec.sensors,
        *spec.keys,
        *(element for element in spec.actuators if element.id not in part.actuators),
        *(element for element in spec.equalities if element.id in part.other_equalities),
        *(element for element in spec.tendons if tendon_bodies(model, element.id) & other_bodies),
        *(joint for body in bodies for joint in body.joints),
    ]
    locks = {element.name: element for element in spec.equalities}
    for element in gone:
        spec.delete(element)
    for fewer, actuator in enumerate(part.actuators):  # named by numbers, which are others now
        if lock := locks.get(lock_name(actuator)):
            lock.name = lock_name(fewer)
    own, ids = spec.compile(), list(part.actuators)
    own.opt.integrator = model.opt.integrator
    for names, here, there in (
        ("gainprm biasprm biastype forcerange forcelimited", slice(None), ids),
        ("ctrlrange ctrllimited", own.actuator_ctrladr, model.actuator_ctrladr[ids]),
    ):
        for name in names.split():
            getattr(own, f"actuator_{name}")[here] = getattr(model, f"actuator_{name}")[there]
    return own


def _place(body: mujoco.MjsBody, model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Give a body the pose in its parent that it has in `data`."""
    at, above = body.id, int(model.body_parentid[body.id])
    to_parent = data.xmat[above].reshape(3, 3).T
    body.pos = to_parent @ (data.xpos[at] - data.xpos[above])
    inverse = np.empty(4)
    mujoco.mju_negQuat(inverse, data.xquat[above])
    mujoco.mju_mulQuat(inverse, inverse, data.xquat[at])
    body.quat = inverse
    body.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
