"""A file as a robot at work: what the task involves, what stands beside it, and where all rests."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.array import Array
from sim.closing.assembly import assemble
from sim.closing.pin import Pin
from sim.errors import ModelError
from sim.mjcf.frame import Body, Located, frame_named, located
from sim.mjcf.locks import add_locks
from sim.mjcf.model import joint_name, listed, load_spec, name_of
from sim.mjcf.part import Part, task_part
from sim.mjcf.ranges import one_axis
from sim.mjcf.transmission import drives, required_drives
from sim.plant.holding import balance
from sim.plant.servo import servoed
from sim.scene.reduced import reduced
from sim.scene.rest import is_held, settled
from sim.scene.stand import stand, standing

_OF_ACTUATORS = "actuator_gainprm", "actuator_biasprm", "actuator_biastype"
_OF_OUTPUTS = "actuator_forcerange", "actuator_forcelimited"
_OF_CONTROLS = "actuator_ctrlrange", "actuator_ctrllimited"

_FREE, _SLIDE = int(mujoco.mjtJoint.mjJNT_FREE), int(mujoco.mjtJoint.mjJNT_SLIDE)
_INSIDE = 0.05
"""Part of its range by which a joint begins inside: at its limit it could move one way only."""
_OVERLAPS = 1e-3
"""Part of the model's extent by which bodies must overlap to be in collision."""
_ELSEWHERE = "start elsewhere, at a keyframe for one"
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
        own: Model of that part alone, for its controller; the whole where nothing is left out.
        own_start: Its state, the same, loops closed: in the physics they give a little.
        moved: How the start differs from what was asked for, or is in collision, and what moved
            until all came to rest, in words.
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
    begin: Callable[[mujoco.MjModel], mujoco.MjData],
    pinned: Sequence[Pin] = (),
    servo_hz: float | None = None,
    settle: bool = True,
) -> Scene:
    """A file at rest, split into what a task involves and the rest.

    Where the file has props, a hand or a spring beside the task, or a start that its actuators
    do not hold, the physics runs until all rests: see :func:`sim.scene.rest.settled`.

    Args:
        file: MJCF.
        frame: Of the task: a site, or a body; a name is that of a site if there is one.
        axes: Site whose axes express it; None is the world.
        begin: Where a model begins, loops open or not.
        pinned: Frames that stand.
        servo_hz: Natural frequency of position servos for torque motors; None leaves them as they
            are.
        settle: Whether it must rest; False is for kinematics alone, which take it where it begins,
            loops closed, whatever holds it.

    Raises:
        sim.ModelError, sim.ClosureError: The file, a frame, or what does not rest.
    """
    spec, model, frame, stated = _compiled(file, frame, begin, pinned)
    required_drives(model)
    start = begin(model)
    _clamp(model, start)
    start = assemble(model, start)
    mujoco.mj_forward(model, start)
    part = task_part(model, _frames(model, frame, axes), np.flatnonzero(start.eq_active).tolist())
    if not part.actuators:
        called = frame.name if isinstance(frame, Body) else frame
        raise ModelError(f"no actuator moves {called}: take a frame that the robot carries")
    if servo_hz is not None:
        used = part.actuators
        model = servoed(model, natural_frequency_hz=servo_hz, data=start, among=used)
        part = replace(part, model=model)
    held = settle and is_held(part, start)
    begun = (*_beyond_ranges(part, stated), *_in_collision(part, start))
    if not part.rest and (not settle or (held and not pinned)):
        moved = (*begun, *_moved(part, stated, start))
        return Scene(model, start, frame, None, model, start, moved)
    rested = _rested(part, start, held=held) if settle else start
    own = model
    if part.rest:
        own = reduced(spec, part, rested)
        _take_actuators(own, part)
    own_start = mujoco.MjData(own)
    own_start.qpos[:] = rested.qpos[part.positions]
    moved = (*begun, *_moved(part, stated, rested))
    return Scene(model, rested, frame, part, own, assemble(own, own_start), moved)


def _compiled(
    file: str | Path,
    frame: str | Body,
    begin: Callable[[mujoco.MjModel], mujoco.MjData],
    pinned: Sequence[Pin],
) -> tuple[mujoco.MjSpec, mujoco.MjModel, str | Body, Array]:
    """The file with locks and pins, the task frame, and the joint positions in the file."""
    spec, model = load_spec(file)
    frame = frame_named(model, "site", frame)
    pins = [replace(pin, frame=frame_named(model, "pinned", pin.frame)) for pin in pinned]
    data = begin(model)
    stated = data.qpos.copy()
    _clamp(model, data)
    mujoco.mj_fwdPosition(model, data)
    stand(spec, model, data, pins)
    if add_locks(spec, model) or pinned:
        model = spec.compile()
    return spec, model, frame, stated


def _rested(part: Part, start: mujoco.MjData, *, held: bool) -> mujoco.MjData:
    """Where all comes to rest; `held` says whether the start is balanced."""
    _refuse_a_falling_base(part, start)
    rested = settled(part, start)
    if held and not is_held(part, rested):
        left = "; ".join(_moved(part, start.qpos, rested))
        raise ModelError(
            f"the servos balance the start and do not keep it: {left}; make them stiffer (--servo "
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


def _beyond_ranges(part: Part, stated: Array) -> tuple[str, ...]:
    """That the start is beyond ranges of joints of the part, in one sentence; none where not."""
    model = part.model
    mine = set(np.delete(model.dof_jntid, part.still).tolist())
    said = [
        f"{joint_name(model, j)} at {stated[model.jnt_qposadr[j]]:.3g}, its range "
        f"{model.jnt_range[j, 0]:.3g} to {model.jnt_range[j, 1]:.3g}"
        for j in _beyond(model, stated).tolist()
        if j in mine
    ]
    if not said:
        return ()
    where = f"the start is beyond ranges, and begins inside them instead: {listed(said)}"
    return (f"{where}; {_ELSEWHERE}",)


def _in_collision(part: Part, start: mujoco.MjData) -> tuple[str, ...]:
    """That bodies of the part overlap at the start, in one sentence; none where none do."""
    model, deep = part.model, dict[str, None]()
    for contact in start.contact[: start.ncon]:
        bodies = [int(model.geom_bodyid[geom]) for geom in contact.geom if geom >= 0]
        rigid = {int(model.body_weldid[body]) for body in bodies}
        if contact.dist < -_OVERLAPS * model.stat.extent and rigid & part.bodies:
            deep[" and ".join(name_of(model.body(body)) for body in bodies)] = None
    if not deep:
        return ()
    return (f"the start is in collision: {listed(list(deep))}; {_ELSEWHERE}",)


def _frames(model: mujoco.MjModel, frame: str | Body, axes: str | None) -> list[Located]:
    of_axes = [] if axes is None else [located(model, "axes", axes)]
    return [located(model, "site", frame), *of_axes]


def _take_actuators(own: mujoco.MjModel, part: Part) -> None:
    """Give the model of a part the servos that its whole has got, and their integrator."""
    whole, ids = part.model, list(part.actuators)
    own.opt.integrator = whole.opt.integrator
    for name in _OF_ACTUATORS:
        getattr(own, name)[:] = getattr(whole, name)[ids]
    for name in _OF_OUTPUTS:
        getattr(own, name)[own.actuator_outadr] = getattr(whole, name)[whole.actuator_outadr[ids]]
    for name in _OF_CONTROLS:
        getattr(own, name)[own.actuator_ctrladr] = getattr(whole, name)[whole.actuator_ctrladr[ids]]


def _refuse_a_falling_base(part: Part, start: mujoco.MjData) -> None:
    """Refuse a floating base that nothing holds: the physics would only show it fall."""
    if (part.model.jnt_type[part.model.dof_jntid] == _FREE).any():
        _refuse_what_moves(part, start, of="free joint")


def _refuse_what_moves(part: Part, start: mujoco.MjData, of: str = "") -> None:
    """Refuse a part that its actuators do not hold, and say which pins would."""
    model = part.model
    found = balance(model, start, drives(model, among=part.actuators), part.still)
    if found.joint is not None and of in found.moves:
        body = name_of(model.body(model.jnt_bodyid[found.joint]))
        feet = standing(part, start) or [body]
        raise ModelError(f"{found.moves}: pin what stands, pinned {','.join(feet)}")


def _moved(part: Part, stated: Array, rested: mujoco.MjData) -> tuple[str, ...]:
    """Joints of the part that moved until all came to rest, in one sentence; none where none."""
    model, way = part.model, np.empty(part.model.nv)
    mujoco.mj_differentiatePos(model, way, 1.0, stated, rested.qpos)
    way[part.still] = 0.0
    joints = [int(j) for j in dict.fromkeys(model.dof_jntid[np.abs(way) > _MOVED])]
    named = [f"{joint_name(model, j)} by {_farthest(model, j, way)}" for j in joints]
    if not named:
        return ()
    return (f"came to rest away from its start: {listed(named)}",)


def _farthest(model: mujoco.MjModel, joint: int, way: Array) -> str:
    """How far it moved, as an angle and as a distance, where it has either."""
    own, kind = np.abs(way[model.dof_jntid == joint]), model.jnt_type[joint]
    lengths = {_SLIDE: 1, _FREE: 3}.get(int(kind), 0)
    parts = {"m": own[:lengths], "rad": own[lengths:]}
    return " and ".join(f"{part.max():.2g} {unit}" for unit, part in parts.items() if len(part))
