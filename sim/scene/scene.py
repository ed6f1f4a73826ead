"""Scene of a file: the part that a task involves, its surroundings, and their equilibrium."""

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
from sim.scene.equilibrium import ground_contacts, is_in_equilibrium, settled, stand

_FREE, _SLIDE = int(mujoco.mjtJoint.mjJNT_FREE), int(mujoco.mjtJoint.mjJNT_SLIDE)
_INSIDE = 0.05
"""Fraction of its range by which a start beyond it is moved inside: both directions are needed."""
_OVERLAPS = 1e-3
"""Fraction of the model's extent by which bodies overlap in a collision."""
_OTHER_START = "start elsewhere, at a keyframe for one"
_MOVED = 1e-3
"""Displacement of a joint, [rad] or [m], above which it is reported."""


@dataclass(frozen=True)
class Scene:
    """Model file in a state of rest, with the part that a task involves.

    Attributes:
        model: Model of the whole file, for the physics.
        start: State of `model` at rest.
        frame: Frame of the task.
        part: Part that the task involves, if the physics was simulated to find `start`, which then
            has the controls that keep it at rest. None is the whole file, in balance at `start`.
        task_model: Model of that part alone, for its controller.
        task_start: State of `task_model` in the same pose; its loops are closed exactly, which in
            the physics have small gaps.
        start_warnings: Sentences on a start beyond ranges or in collision, and on joints that
            moved until all was at rest.
    """

    model: mujoco.MjModel
    start: mujoco.MjData
    frame: str | Body
    part: Part | None
    task_model: mujoco.MjModel
    task_start: mujoco.MjData
    start_warnings: tuple[str, ...]


def robot_scene(
    file: str | Path,
    frame: str | Body,
    axes: str | None,
    initial_state: Callable[[mujoco.MjModel], mujoco.MjData],
    pinned: Sequence[Pin] = (),
    servo_hz: float | None = None,
    settle: bool = True,
) -> Scene:
    """Load a file, find its equilibrium, and split it into the part of a task and all else.

    If the file has objects, a hand or springs outside the task, or a start that is not in balance,
    the physics is simulated until all is at rest: see :func:`sim.scene.equilibrium.settled`.

    Args:
        file: Path of an MJCF file.
        frame: Frame of the task, a site or a body; a name is that of a site if there is one.
        axes: Site whose axes express the task; None is the world.
        initial_state: Function that returns the start state of a model, loops open or not.
        pinned: Frames that are fixed to the world.
        servo_hz: Natural frequency of position servos that replace torque motors; None keeps these.
        settle: Whether the scene must be at rest; False, for kinematics alone, uses the start with
            closed loops without checking its balance.

    Raises:
        sim.ModelError, sim.ClosureError: The file or a frame is unusable, or there is no rest.
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
        raise ModelError(f"no actuator moves {called}: choose a frame on the robot")
    if servo_hz is not None:
        model = servoed(model, natural_frequency_hz=servo_hz, data=start, among=part.actuators)
        part = replace(part, model=model)
    is_balanced = settle and is_in_equilibrium(part, start)
    balanced = not part.other_bodies and (not settle or (is_balanced and not pinned))
    rested = start if balanced or not settle else _rested(part, start, was_balanced=is_balanced)
    texts = _beyond_ranges(part, stated), _in_collision(part, start), _moved(part, stated, rested)
    start_warnings = tuple(filter(None, texts))
    if balanced:
        return Scene(model, start, frame, None, model, start, start_warnings)
    task_model = reduced(spec, part, rested) if part.other_bodies else model
    task_start = mujoco.MjData(task_model)
    task_start.qpos[:] = rested.qpos[part.positions]
    task_start = assemble(task_model, task_start)
    return Scene(model, rested, frame, part, task_model, task_start, start_warnings)


def _compiled(
    file: str | Path,
    frame: str | Body,
    initial_state: Callable[[mujoco.MjModel], mujoco.MjData],
    pinned: Sequence[Pin],
) -> tuple[mujoco.MjSpec, mujoco.MjModel, str | Body, Array]:
    """Load a file with locks and pins; return task frame and initial joint positions as well."""
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


def _rested(part: Part, start: mujoco.MjData, *, was_balanced: bool) -> mujoco.MjData:
    """Return the state in which all is at rest; `was_balanced` is True for a balanced start."""
    if (part.model.jnt_type == _FREE).any():  # the physics would only let it fall
        _check_balance(part, start, of="free joint")
    rested = settled(part, start)
    if was_balanced and not is_in_equilibrium(part, rested):
        moves = _moved(part, start.qpos, rested)
        raise ModelError(
            f"the servos balance the start but do not hold it: {moves}; make them stiffer (--servo "
            "or servo_hz= for torque motors) or pin more (pinned)"
        )
    _check_balance(part, rested)
    return rested


def _clamp(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Move joints that start beyond their ranges inside, by :data:`_INSIDE`."""
    some = _beyond(model, data.qpos)
    at, (low, high) = model.jnt_qposadr[some], model.jnt_range[some].T
    margin = _INSIDE * (high - low)
    data.qpos[at] = data.qpos[at].clip(low + margin, high - margin)


def _beyond(model: mujoco.MjModel, qpos: Array) -> NDArray[np.intp]:
    """Return the joints whose positions are beyond their ranges."""
    some = np.flatnonzero(model.jnt_limited.astype(bool) & one_axis(model))
    given, (low, high) = qpos[model.jnt_qposadr[some]], model.jnt_range[some].T
    return some[(given < low) | (given > high)]


def _beyond_ranges(part: Part, stated: Array) -> str:
    """Return a sentence on joints of the part that start beyond their ranges; empty if none."""
    model = part.model
    mine = set(np.delete(model.dof_jntid, part.other_velocities).tolist())
    texts = [
        f"{joint_name(model, j)} at {stated[model.jnt_qposadr[j]]:.3g}, its range "
        f"{model.jnt_range[j, 0]:.3g} to {model.jnt_range[j, 1]:.3g} "
        f"{'m' if model.jnt_type[j] == _SLIDE else 'rad'}"
        for j in _beyond(model, stated).tolist()
        if j in mine
    ]
    where = f"the start is beyond joint ranges and is moved inside: {listed(texts)}"
    return f"{where}; {_OTHER_START}" if texts else ""


def _in_collision(part: Part, start: mujoco.MjData) -> str:
    """Return a sentence on bodies of the part that overlap at the start; empty if none."""
    model, deep = part.model, dict[str, None]()
    for contact in start.contact[: start.ncon]:
        bodies = [int(model.geom_bodyid[geom]) for geom in contact.geom if geom >= 0]
        rigid = {int(model.body_weldid[body]) for body in bodies}
        if contact.dist < -_OVERLAPS * model.stat.extent and rigid & part.bodies:
            deep[" and ".join(name_of(model.body(body)) for body in bodies)] = None
    return f"the start is in collision: {listed(list(deep))}; {_OTHER_START}" if deep else ""


def _check_balance(part: Part, start: mujoco.MjData, of: str = "") -> None:
    """Check that a part is in balance; raise ModelError with pins that would help."""
    model = part.model
    result = balance(model, start, drives(model, among=part.actuators), part.other_velocities)
    if result.joint is not None and of in result.moves:
        feet = ground_contacts(part, start) or [name_of(model.body(model.jnt_bodyid[result.joint]))]
        raise ModelError(f"{result.moves}: fix bodies on the ground, pinned {','.join(feet)}")


def _moved(part: Part, stated: Array, rested: mujoco.MjData) -> str:
    """Return a sentence on joints of the part that moved until all was at rest; empty if none."""
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
    """Compile a model of the part alone, with all other joints welded at their pose in `data`.

    Elements that act on other joints are removed. Joints, actuators and equalities of the part keep
    their names and order, and the servos that `part.model` got after `spec` was compiled; `spec` is
    not changed. Positions in `data` are up to date.
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
    for fewer, actuator in enumerate(part.actuators):  # a lock has the number of its actuator
        if lock := locks.get(lock_name(actuator)):
            lock.name = lock_name(fewer)
    part_model, ids = spec.compile(), list(part.actuators)
    part_model.opt.integrator = model.opt.integrator
    for names, here, there in (
        ("gainprm biasprm biastype forcerange forcelimited", slice(None), ids),
        ("ctrlrange ctrllimited", part_model.actuator_ctrladr, model.actuator_ctrladr[ids]),
    ):
        for name in names.split():
            field = f"actuator_{name}"
            getattr(part_model, field)[here] = getattr(model, field)[there]
    return part_model


def _place(body: mujoco.MjsBody, model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Set a body's pose relative to its parent to that in `data`."""
    at, above = body.id, int(model.body_parentid[body.id])
    body.pos = data.xmat[above].reshape(3, 3).T @ (data.xpos[at] - data.xpos[above])
    inverse = np.empty(4)
    mujoco.mju_negQuat(inverse, data.xquat[above])
    mujoco.mju_mulQuat(inverse, inverse, data.xquat[at])
    body.quat = inverse
    body.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
