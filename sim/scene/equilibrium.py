"""Equilibrium of a whole file, with contacts, springs and pinned frames."""

import copy
from collections import Counter
from collections.abc import Sequence

import mujoco
import numpy as np

from argument_checks.ties import greatest
from sim.array import Array
from sim.closing.fixed import Pin
from sim.errors import ModelError, has_diverged
from sim.mjcf.drive import Drive, drives, law_of, stiffen
from sim.mjcf.frame import located
from sim.mjcf.joints import ranges
from sim.mjcf.model import joint_name, name_of
from sim.mjcf.part import Part
from sim.plant.actuators import Balance, Commands, balance, beyond_ranges, commands_of

LONGEST_S, _EVERY_S = 10.0, 0.05
"""Longest simulation [s] until a file must be at rest, and interval between checks [s]."""
SLOW, _MOVES = 1e-8, 1e-2
"""Joint speed at rest, and speed that is an error at the end, [rad]/[s] or [m]/[s]."""
SLOW_OTHERS, _OTHERS_S = 1e-3, 2.0
"""Joint speed outside the part at rest, and time [s] after which it is no longer required."""
_LOOKED_S, _FALL_S = 0.02, 1.0
"""Interval [s] and duration [s] of the search for contacts of a falling robot."""


def is_in_equilibrium(part: Part, data: mujoco.MjData) -> bool:
    """Return whether the part is in balance in `data` with actuators within their ranges."""
    own, result, commands = _statics(part, data)
    return result.joint is None and not beyond_ranges(part.model, own, commands)


def settled(part: Part, start: mujoco.MjData) -> mujoco.MjData:
    """Simulate from `start`, with closed loops, until everything is at rest; return that state.

    Controls of the part balance `start` within their ranges, and the targets of all other position
    servos are their present lengths. The physics runs until no joint of the part is faster than
    :data:`SLOW` nor, in the first two seconds, any other joint faster than :data:`SLOW_OTHERS`, and
    for :data:`LONGEST_S` at most.

    Raises:
        ModelError: As for :class:`sim.Plant`; or the part does not come to rest.
    """
    model, data = part.model, mujoco.MjData(part.model)
    for field in ("qpos", "eq_active", "act", "mocap_pos", "mocap_quat", "ctrl"):
        getattr(data, field)[:] = getattr(start, field)
    mujoco.mj_forward(model, data)
    data.ctrl[:] = _holding(part, data)
    mine = np.setdiff1d(np.arange(model.nv), part.other_velocities)
    steps = max(1, round(_EVERY_S / model.opt.timestep))
    rests = False
    while data.time < LONGEST_S and not rests:
        mujoco.mj_step(model, data, steps)
        if has_diverged(data):
            raise ModelError(_diverges(model))
        other_speed = np.abs(data.qvel[part.other_velocities]).max(initial=0.0)
        speed = np.abs(data.qvel[mine])
        others_rest = other_speed < SLOW_OTHERS or data.time > _OTHERS_S
        rests = speed.max(initial=0.0) < SLOW and others_rest
    if (speed := np.abs(data.qvel[mine])).max(initial=0.0) > _MOVES:
        joint = int(model.dof_jntid[mine[greatest(speed)]])
        raise ModelError(
            f"the robot does not come to rest in {LONGEST_S:g} s: {joint_name(model, joint)} still "
            f"moves at {speed.max():.2g} rad/s or m/s; start elsewhere (keyframe) or pin it "
            "(pinned)"
        )
    data.time, data.qvel[:] = 0.0, 0.0
    mujoco.mj_forward(model, data)
    return data


def _diverges(model: mujoco.MjModel) -> str:
    """Return a sentence on diverging physics and what may prevent it."""
    kind = mujoco.mjtIntegrator(model.opt.integrator).name.removeprefix("mjINT_")
    other = "" if kind.startswith("IMPLICIT") else ", or implicitfast"
    return (
        "the file does not come to rest: its physics diverges, with a timestep of "
        f"{model.opt.timestep:g} s and the integrator {kind}; take a shorter timestep{other}"
    )


def _statics(part: Part, data: mujoco.MjData) -> tuple[tuple[Drive, ...], Balance, Commands]:
    own = drives(part.model, among=part.actuators)
    result = balance(part.model, data, own, part.other_velocities)
    return own, result, commands_of(part.model, data, own, result.forces)


def _holding(part: Part, data: mujoco.MjData) -> Array:
    """Return controls (nu,) within their ranges that keep `data` at rest."""
    model, (_, _, commands) = part.model, _statics(part, data)
    controls = commands.with_other_controls(data.ctrl).at_rest
    for k in set(range(model.nactuator)) - set(part.actuators):
        try:
            law = law_of(model, k)
        except ModelError:  # its control stays unchanged
            continue
        if law.per_length < 0.0:
            length = data.actuator_length[model.actuator_outadr[k]]
            target = -(law.constant + law.per_length * length) / law.gain
            controls[model.actuator_ctrladr[k]] = target
    return controls.clip(*ranges(model).control.T)


def stand(
    spec: mujoco.MjSpec, model: mujoco.MjModel, data: mujoco.MjData, pins: Sequence[Pin]
) -> None:
    """Pin frames to the world where they are in `data`, as stiffly as the time step allows.

    Contacts of pinned bodies with the world are excluded: two constraints of one foot would act
    against each other. `spec`, from which `model` was compiled, is changed; the caller compiles it
    again. Positions in `data` are up to date.
    """
    frames = [located(model, "pinned", pin.frame) for pin in pins]
    # Bodies lose their numbers when the specification changes.
    by_number = {body.id: body for body in spec.bodies}
    for k, (pin, frame) in enumerate(zip(pins, frames, strict=True)):
        there, here = f"pinned{k}_in_the_world", f"pinned{k}"
        quat_wxyz = np.empty(4)
        mujoco.mju_mat2Quat(quat_wxyz, frame.rotation(data).flatten())
        spec.worldbody.add_site(name=there, pos=frame.position_m(data), quat=quat_wxyz)
        body = by_number[frame.body]
        if frame.is_site:
            here = str(pin.frame)
        else:
            body.add_site(name=here)
        kind = mujoco.mjtEq.mjEQ_WELD if pin.weld else mujoco.mjtEq.mjEQ_CONNECT
        equality = spec.add_equality(name=f"pin{k}", type=kind)
        equality.objtype, equality.name1, equality.name2 = mujoco.mjtObj.mjOBJ_SITE, here, there
        stiffen(equality, model.opt.timestep)
    rigid = model.body_weldid  # bodies without a joint between them are one
    stands = {int(rigid[frame.body]) for frame in frames} - {0}
    for here in np.flatnonzero(np.isin(rigid, list(stands))).tolist():
        for there in np.flatnonzero(rigid == 0).tolist():
            for number in (here, there):
                by_number[number].name = by_number[number].name or f"body{number}_of_the_file"
            spec.add_exclude(bodyname1=by_number[there].name, bodyname2=by_number[here].name)


def ground_contacts(part: Part, data: mujoco.MjData) -> list[str]:
    """List the bodies of the part on the ground, or after falling to it, in the notation of pins.

    Bodies with one contact point get the suffix ":point", since they can turn about it.
    """
    model, points = part.model, Counter[int]()
    data, steps = copy.copy(data), max(1, round(_LOOKED_S / model.opt.timestep))
    for _ in range(round(_FALL_S / _LOOKED_S)):
        if data.ncon:
            break
        mujoco.mj_step(model, data, steps)
    mujoco.mj_step(model, data, steps)  # until a foot has all its contacts
    for one, other in data.contact.geom:
        for here, there in ((one, other), (other, one)):
            if here >= 0 and there >= 0 and not model.body_weldid[model.geom_bodyid[there]]:
                points[int(model.geom_bodyid[here])] += 1
    roots = {int(model.body_rootid[body]) for body in part.bodies}
    return [
        name_of(model.body(body)) + ("" if count >= 2 else ":point")
        for body, count in sorted(points.items())
        if model.body_rootid[body] in roots
    ]
