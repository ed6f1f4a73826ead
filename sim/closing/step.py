"""Steps: a motion at constant velocity, after which every loop is closed again."""

import copy
import warnings
from collections.abc import Iterable
from typing import NamedTuple

import mujoco
import numpy as np

import argument_checks as check
from argument_checks.ties import exceeds, greatest
from sim.array import Array
from sim.closing.assembly import assemble_in_place, checked_accuracy
from sim.closing.hold import Hold, held_in, hold
from sim.closing.newton import CLOSED, close, lacking, largest_gap
from sim.closing.pin import Pin, pins_of
from sim.errors import ClosureError
from sim.mjcf.dynamics import mass_of
from sim.mjcf.frame import Body
from sim.mjcf.model import bring_up_to_date, check_size, check_state, name_of
from sim.mjcf.ranges import turning

_LONGEST_CORRECTION = 0.05
_LONGEST_TURN_RAD = 1.0
_MOST_TRIALS = 20
_SHORTER = 0.95
"""Part of the longest step, as foreseen, that is tried next."""
_SHORTEST = 1 / 16
"""Of the step before: what went so wrong foresees little."""
_CANCELLED = 1e-6
"""Part of the fastest site's motion below which a site stays where it is."""
_FOLLOWED = 0.2
"""Part of its way by which a site may miss after a step that is shortened as advised."""


def advance(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    velocity: Array,
    duration_s: float = 1.0,
    held: Iterable[str | int] = (),
    pinned: Iterable[str | Body | Pin] = (),
    *,
    geometry_accuracy: float | None = None,
    warn_of_misses: bool = True,
    into: mujoco.MjData | None = None,
) -> mujoco.MjData:
    """The state after moving at a constant velocity for some time, all loops closed again.

    A step that is too long is shortened, and a `RuntimeWarning` says to which part and why: no
    joint turns by more than 1 rad, and closing the loops again changes the motion by at most a
    twentieth. From there the next step goes on.

    Args:
        model: The model.
        data: The state to begin from, which stays as it is unless it is `into`.
        velocity: Of all joints, in MuJoCo's order, shape (N,), as `kin.velocities(rates)`; what
            follows the first nv numbers belongs to transmissions and follows from these.
        duration_s: How long; 1 for a velocity that is a displacement.
        held: What takes no part in closing the loops: joints that are stuck (`system.stuck`), or
            actuated ones that must move exactly as commanded.
        pinned: As for :func:`assemble`.
        geometry_accuracy: As for :func:`assemble`.
        warn_of_misses: Whether a site that misses is told, as below; not to a loop whose next tick
            corrects it.
        into: A state of this model that becomes the new one; it may be `data`. After an error its
            `qpos` is that of `data`. None is another one, which takes 0.3 ms to make.

    Returns:
        The new state, up to date but for contacts and the mass matrix. Its `time` is later by the
        duration that was really taken: `duration_s`, or the part of it that a shortened step is.

    Where a site misses where its velocity leads by more than the way there, as next to a singular
    pose, a `RuntimeWarning` says which and how much shorter the step must be: the site follows the
    command to a fifth then. Sites whose velocities cancel entirely are no part of a command.

    Raises:
        ValueError: The velocity opens the loops, or moves what is pinned, so that no part of the
            step is short enough.
        ClosureError, ModelError, TypeError: As :func:`assemble`, of the state to begin from.
    """
    check_state(model, data)
    v = check.series("velocity", velocity)
    if len(v) < model.nv:
        raise ValueError(f"velocity must have shape (N,), N at least {model.nv}, got {v.shape}")
    duration_s = check.positive("duration_s", duration_s)
    motion = check.series("velocity times duration_s", v[: model.nv] * duration_s)
    held, pinned = held_in(held), pins_of(model, pinned)
    accuracy = checked_accuracy(geometry_accuracy)
    is_told = check.flag("warn_of_misses", warn_of_misses)
    moved = _copied(model, data, into)
    start = moved.qpos.copy()
    try:
        fixed = _begun(model, moved, held, pinned, accuracy)
        begun = moved.site_xpos.copy()
        wanted = _site_motion(model, moved, motion) if is_told else None
        part, why = _longest_part(model, moved, fixed, motion, accuracy)
    except Exception:
        moved.qpos[:] = start
        raise
    moved.time += part * duration_s
    if why:
        warnings.warn(
            f"the step is shortened to {part:.3g} of what is asked for, else {why}",
            RuntimeWarning,
            stacklevel=2,
        )
    if wanted is not None and (miss := _miss(model, part, part * wanted, moved.site_xpos - begun)):
        warnings.warn(miss, RuntimeWarning, stacklevel=2)
    return moved


def _copied(
    model: mujoco.MjModel, data: mujoco.MjData, into: mujoco.MjData | None
) -> mujoco.MjData:
    """The state again: a new one, or that which becomes it."""
    if into is None:
        return copy.copy(data)
    check_size("into", model, into)
    if into is not data:
        mujoco.mj_copyData(into, model, data)
    return into


def _begun(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    held: tuple[str | int, ...],
    pinned: tuple[Pin, ...],
    accuracy: float | None,
) -> Hold | None:
    """Close the loops in place; what is held from there, None if there is nothing to close."""
    if (model.neq or held or pinned) and hold(model, data, held, pinned).binds(data):
        assemble_in_place(model, data, held, pinned, accuracy)
        return hold(model, data, held, pinned)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    return None


class _Fault(NamedTuple):
    """What shows that a step is too long.

    Attributes:
        why: In words.
        shorter: The part of this step to try next.
    """

    why: str
    shorter: float


def _longest_part(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    fixed: Hold | None,
    motion: Array,
    accuracy: float | None,
) -> tuple[float, str]:
    """Go in place as far as a step may go: which part of the motion, and why it is not all.

    Raises:
        ValueError: No part is short enough.
    """
    part, why = _turned(model, motion)
    if fixed is None:
        mujoco.mj_integratePos(model, data.qpos, part * motion, 1.0)
        bring_up_to_date(model, data)
        return part, why
    begun = data.qpos.copy()
    for trial in range(_MOST_TRIALS):
        step = part * motion
        goal = fixed.moved(model, data, step)
        fault = _moved(model, data, goal, step, accuracy)
        if not fault:
            return part, why
        part, why = part * fault.shorter, fault.why
        data.qpos[:] = begun
        mujoco.mj_fwdPosition(model, data)
        if not trial and _opens(model, data, goal, step, accuracy):
            break
    raise ValueError(f"the velocity must keep the loops closed: however short the step, {why}")


def _turned(model: mujoco.MjModel, motion: Array) -> tuple[float, str]:
    """The part of a motion of which no joint turns too far, and which joint would.

    Beyond a radian a velocity says little about where the task goes.
    """
    if np.abs(motion).max(initial=0.0) <= _LONGEST_TURN_RAD:  # the common case
        return 1.0, ""
    turns = np.abs(motion) * turning(model)
    if not exceeds(turns.max(initial=0.0), _LONGEST_TURN_RAD):
        return 1.0, ""
    farthest = greatest(turns)
    joint = name_of(model.joint(int(model.dof_jntid[farthest])))
    return _LONGEST_TURN_RAD / turns[farthest], (
        f'joint "{joint}" turns by {turns[farthest]:.3g} rad, more than {_LONGEST_TURN_RAD:g}'
    )


def _moved(
    model: mujoco.MjModel, data: mujoco.MjData, goal: Hold, step: Array, accuracy: float | None
) -> _Fault | None:
    """Take a step in place and close the loops again; what shows that it is too long."""
    mujoco.mj_integratePos(model, data.qpos, step, 1.0)
    mujoco.mj_fwdPosition(model, data)
    before = data.qpos.copy()
    try:
        close(model, data, goal, accuracy)
    except ClosureError as error:
        return _Fault(f"{error.equality} stays open by {error.gap:.3g} (m or rad)", 0.5)
    correction = np.empty(model.nv)
    mujoco.mj_differentiatePos(model, correction, 1.0, before, data.qpos)
    change, length = _lengths(model, data, correction, step)
    if change <= _LONGEST_CORRECTION * length + CLOSED:
        return None
    data.qpos[:] = before
    mujoco.mj_fwdPosition(model, data)
    opened = largest_gap(model, data, goal)[1]
    # The correction grows with the square of the step.
    shorter = _SHORTER * _LONGEST_CORRECTION * length / change
    return _Fault(
        f"closing {opened} again changes {change / length:.0%} of the motion",
        max(shorter, _SHORTEST),
    )


def _opens(
    model: mujoco.MjModel, data: mujoco.MjData, goal: Hold, step: Array, accuracy: float | None
) -> bool:
    """Whether a motion opens the loops to first order, so that no part of it is short enough."""
    correction, rest = lacking(model, data, goal, step, accuracy)
    change, length = _lengths(model, data, correction, step)
    return change > _LONGEST_CORRECTION * length or rest > _LONGEST_CORRECTION


def _lengths(model: mujoco.MjModel, data: mujoco.MjData, *motions: Array) -> list[float]:
    """Lengths of motions (nv,) in the metric of the mass matrix."""
    mass = mass_of(model, data)
    return [float(np.sqrt(motion @ mass @ motion)) for motion in motions]


def _site_motion(model: mujoco.MjModel, data: mujoco.MjData, motion: Array) -> Array:
    """Displacement of each site to first order, shape (nsite, 3)."""
    wanted, rows = np.empty((model.nsite, 3)), np.zeros((3, model.nv))
    for k in range(model.nsite):
        mujoco.mj_jacSite(model, data, rows, None, k)
        wanted[k] = rows @ motion
    return wanted


def _miss(model: mujoco.MjModel, part: float, wanted: Array, moved: Array) -> str:
    """Which site ends farther from where it was to be than it was to go, if one does.

    Args:
        model: The model.
        part: The part of the motion that was taken.
        wanted: Where each site was to go, shape (nsite, 3).
        moved: Where it went, shape (nsite, 3).
    """
    way, missed = (np.linalg.norm(each, axis=1) for each in (wanted, moved - wanted))
    is_command = way > np.maximum(_CANCELLED * way.max(initial=0.0), CLOSED)
    ratio = np.divide(missed, way, out=np.zeros_like(way), where=is_command)
    if ratio.max(initial=0.0) <= 1.0:
        return ""
    worst = greatest(ratio)
    return (
        f'site "{name_of(model.site(worst))}" was to move by {way[worst]:.3g} and ends '
        f"{missed[worst]:.3g} from there, as next to a singular pose: take steps of at most "
        f"{part * _FOLLOWED / ratio[worst]:.2g} of velocity times duration_s"
    )
