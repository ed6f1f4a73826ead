"""A state in which a whole file rests: props on their table, fingers on their springs."""

import mujoco
import numpy as np

from argument_checks.ties import greatest
from sim.array import Array
from sim.errors import ModelError
from sim.mjcf.drive import Drive
from sim.mjcf.law import law_of
from sim.mjcf.model import joint_name
from sim.mjcf.part import Part
from sim.mjcf.transmission import drives
from sim.plant.commands import Commands, commands_of
from sim.plant.holding import Balance, balance, refuse_beyond_ranges
from sim.warning import has_diverged

LONGEST_S = 10.0
"""Of physics, in which a file comes to rest."""
SLOW = 1e-8
"""Speed of the joints of a robot at rest, [rad]/[s] or [m]/[s]."""
SLOW_BESIDE = 1e-3
"""Speed of all else at rest."""
_MOVES = 1e-2
"""Speed of a joint of the robot that is no rest, after all that time."""
_BESIDE_S = 2.0
"""After which things beside the robot may still move."""
_EVERY_S = 0.05
"""How often that is looked at."""


def is_held(part: Part, data: mujoco.MjData) -> bool:
    """Whether the actuators of the part hold it where it stands in `data`, within their ranges.

    Raises:
        ModelError: As :class:`sim.Plant` for its actuators.
    """
    own, found, commands = _statics(part, data)
    try:
        refuse_beyond_ranges(part.model, own, commands)
    except ModelError:
        return False
    return found.joint is None


def settled(part: Part, start: mujoco.MjData) -> mujoco.MjData:
    """The state in which everything comes to rest from `start`, velocities zero.

    The actuators of the part hold it where it stands, as far as their ranges let them; position
    servos of all else hold what they move. The physics then runs until no joint of the part moves
    faster than :data:`SLOW`, nor in the first two seconds anything else than
    :data:`SLOW_BESIDE`, and :data:`LONGEST_S` at most.

    Args:
        part: Of the model.
        start: Where it begins, loops closed, derived quantities up to date.

    Raises:
        ModelError: As :class:`sim.Plant` for its actuators; or it does not come to rest.
    """
    model, data = part.model, mujoco.MjData(part.model)
    data.qpos[:], data.eq_active[:], data.act[:] = start.qpos, start.eq_active, start.act
    data.mocap_pos[:], data.mocap_quat[:] = start.mocap_pos, start.mocap_quat
    data.ctrl[:] = start.ctrl
    mujoco.mj_forward(model, data)
    data.ctrl[:] = _holding(part, data)
    mine = np.setdiff1d(np.arange(model.nv), part.still)
    steps = max(1, round(_EVERY_S / model.opt.timestep))
    while data.time < LONGEST_S:
        mujoco.mj_step(model, data, steps)
        if has_diverged(data):
            raise ModelError(
                f"the file does not come to rest: its physics diverges, {_advice(model)}"
            )
        speed = np.abs(data.qvel)
        beside = speed[part.still].max(initial=0.0) < SLOW_BESIDE or data.time > _BESIDE_S
        if beside and speed[mine].max(initial=0.0) < SLOW:
            break
    speed = np.abs(data.qvel[mine])
    if speed.max(initial=0.0) > _MOVES:
        joint = int(model.dof_jntid[mine[greatest(speed)]])
        raise ModelError(
            f"the robot does not come to rest in {LONGEST_S:g} s: {joint_name(model, joint)} still "
            f"moves at {speed.max():.2g} rad/s or m/s; start elsewhere (keyframe) or pin it "
            "(pinned)"
        )
    data.time, data.qvel[:] = 0.0, 0.0
    mujoco.mj_forward(model, data)
    return data


def _advice(model: mujoco.MjModel) -> str:
    """What may keep the physics of a file from diverging, beside what it has."""
    kind = mujoco.mjtIntegrator(model.opt.integrator).name.removeprefix("mjINT_")
    other = "" if kind.startswith("IMPLICIT") else ", or implicitfast"
    return (
        f"with a timestep of {model.opt.timestep:g} s and the integrator {kind}; take a shorter "
        f"timestep{other}"
    )


def _statics(part: Part, data: mujoco.MjData) -> tuple[tuple[Drive, ...], Balance, Commands]:
    own = drives(part.model, among=part.actuators)
    found = balance(part.model, data, own, part.still)
    return own, found, commands_of(part.model, data, own, found.forces)


def _holding(part: Part, data: mujoco.MjData) -> Array:
    """Controls (nu,) that hold what stands still in `data`, within their ranges."""
    model, (_, _, commands) = part.model, _statics(part, data)
    controls = commands.beside(data.ctrl).at_rest
    for k in set(range(model.nactuator)) - set(part.actuators):
        try:
            law = law_of(model, k)
        except ModelError:  # it keeps its control
            continue
        if law.per_length < 0.0:
            length = data.actuator_length[model.actuator_outadr[k]]
            target = -(law.constant + law.per_length * length) / law.gain
            controls[model.actuator_ctrladr[k]] = target
    low, high = np.where(
        model.actuator_ctrllimited[:, None], model.actuator_ctrlrange, (-np.inf, np.inf)
    ).T
    return controls.clip(low, high)
