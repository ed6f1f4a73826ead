"""Joint positions at which every loop is closed, and steps from there that close them again."""

import copy
import warnings
from collections.abc import Iterable

import mujoco
import numpy as np

import argument_checks as check
from argument_checks.ties import exceeds, greatest
from sim.array import Array
from sim.closing.equalities import active_closures, check_closures
from sim.closing.fixed import FixedCoordinates, Pin, fixed_coordinates
from sim.closing.newton import CLOSED, Loops, close
from sim.errors import ClosureError
from sim.mjcf.frame import Body
from sim.mjcf.joints import mass_of, turning
from sim.mjcf.model import bring_up_to_date, check_size, check_state, name_of, start_of

_LONGEST_TURN_RAD = 1.0
_LONGEST_CORRECTION = 0.05
"""Part of a motion that closing the loops again may change: so far it is what was asked for."""
_SHORTEST = 1e-9
"""Part of a motion that is tried: a shorter one is lost in what counts as closed."""
_CANCELLED = 1e-6
"""Part of the fastest site's motion below which a site stays where it is."""
_FOLLOWED = 0.2
"""Part of its way by which a site may miss after a step that is shortened as advised."""


def assemble(
    model: mujoco.MjModel,
    data: mujoco.MjData | None = None,
    held: Iterable[str | int] = (),
    pinned: Iterable[str | Body | Pin] = (),
    *,
    geometry_accuracy: float | None = None,
) -> mujoco.MjData:
    """A state whose `qpos` closes every active equality to 1e-10 rad, or of its own length.

    Of a length that is 1e-10 m in a model of a metre, 1e-7 mm in the same model in millimetres: the
    own length is the longest chain from a joint to what closures or pins hold. Where round-off lets
    it be, a gap is below 1e-10 in the unit of a larger model, too.

    Newton's method on the manifold of joint positions: each step closes the gaps to first order
    with the least change in the metric of the mass matrix. Joint limits do not count.

    An over-constrained mechanism closes as far as its geometry is accurate: with axes that are
    parallel to 1e-6 only, gaps of this size stay that no motion within it can close.

    Equalities of a flex beside the mechanism, such as a cloth, are left out, and a `RuntimeWarning`
    names each.

    Args:
        model: Any model.
        data: The state to begin from, which stays as it is; None is the model's
            first keyframe, or `qpos0` where it has none, as everywhere.
        held: What does not move: names of joints, tendons or actuators, or velocity indices as in
            `system.stuck`.
        pinned: Frames that stay where they are: names of sites, :class:`Body`, or :class:`Pin`.
        geometry_accuracy: In rad or relative length; None is what the numbers of the model show, as
            in `jac.geometry_accuracy`, and mostly zero.

    Returns:
        A new state, derived quantities up to date.

    Raises:
        ClosureError: An equality that does not close: which, and how far it stays open.
        ModelError: A name that does not exist; an active equality that ties a flex to what
            actuators, closures or pins have to do with; closures that the model's flags switch
            off.
    """
    check.instance("model", model, mujoco.MjModel)
    if data is not None:
        check_state(model, data)
    closed = start_of(model) if data is None else copy.copy(data)
    if geometry_accuracy is not None:
        check.number("geometry_accuracy", geometry_accuracy, 0.0)
    fixed = fixed_coordinates(model, held, pinned)
    for sentence in _close_in_place(model, closed, fixed, geometry_accuracy)[1]:
        warnings.warn(sentence, RuntimeWarning, stacklevel=2)
    return closed


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
        warn_of_misses: Whether a site that misses is told, as below; a loop corrects it in its next
            tick.
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
    v = check.array("velocity", velocity, None)
    if len(v) < model.nv:
        raise ValueError(f"velocity must have shape (N,), N at least {model.nv}, got {v.shape}")
    duration_s = check.number("duration_s", duration_s, check.SMALLEST)
    motion = check.array("velocity times duration_s", v[: model.nv] * duration_s, None)
    if geometry_accuracy is not None:
        check.number("geometry_accuracy", geometry_accuracy, 0.0)
    fixed = fixed_coordinates(model, held, pinned)
    warns = check.flag("warn_of_misses", warn_of_misses)
    if into is not None and into is not data:
        check_size("into", model, into)
        mujoco.mj_copyData(into, model, data)
    moved = copy.copy(data) if into is None else into
    start = moved.qpos.copy()
    try:
        loops = None
        if fixed.binds(moved):
            loops = _close_in_place(model, moved, fixed, geometry_accuracy)[0]
            loops = loops.with_fixed(fixed.at(moved))
        else:
            mujoco.mj_kinematics(model, moved)
            mujoco.mj_comPos(model, moved)
        site_motion = _site_motion(model, moved, motion) if warns else None
        part, why = _turned(model, motion)
        if loops is None:
            mujoco.mj_integratePos(model, moved.qpos, part * motion, 1.0)
            bring_up_to_date(model, moved)
        else:
            part, why = _follow(moved, loops, motion, part, why)
    except Exception:
        moved.qpos[:] = start
        raise
    moved.time += part * duration_s
    if why:
        shorter = f"the step is shortened to {part:.3g} of what is asked for, else {why}"
        warnings.warn(shorter, RuntimeWarning, stacklevel=2)
    if site_motion is not None and (miss := _miss(model, part, *site_motion, moved.site_xpos)):
        warnings.warn(miss, RuntimeWarning, stacklevel=2)
    return moved


def _close_in_place(
    model: mujoco.MjModel, data: mujoco.MjData, fixed: FixedCoordinates, accuracy: float | None
) -> tuple[Loops, tuple[str, ...]]:
    """Close the loops of a state; returns them, and a sentence for each equality left out."""
    mujoco.mj_fwdPosition(model, data)
    sentences = check_closures(model, data, [pin.frame for pin in fixed.pins])
    loops = Loops(model, active_closures(model, data), fixed.at(data), accuracy)
    close(data, loops)
    return loops, sentences


def _turned(model: mujoco.MjModel, motion: Array) -> tuple[float, str]:
    """The part of a motion of which no joint turns too far, and which joint would.

    Beyond a radian a velocity says little about where the task goes.
    """
    if np.abs(motion).max(initial=0.0) <= _LONGEST_TURN_RAD:  # mostly, and faster
        return 1.0, ""
    turns = np.abs(motion) * turning(model)
    if not exceeds(turns.max(initial=0.0), _LONGEST_TURN_RAD):
        return 1.0, ""
    farthest = greatest(turns)
    joint = name_of(model.joint(int(model.dof_jntid[farthest])))
    return _LONGEST_TURN_RAD / turns[farthest], (
        f'joint "{joint}" turns by {turns[farthest]:.3g} rad, more than {_LONGEST_TURN_RAD:g}'
    )


def _follow(
    data: mujoco.MjData, loops: Loops, motion: Array, part: float, why: str
) -> tuple[float, str]:
    """Move in place by the longest part of a motion (nv,) after which loops close with few changes.

    Takes the part to try first and why it is not all; returns those of the part that was taken.

    Raises:
        ValueError: No part is short enough.
    """
    start, first_attempt = data.qpos.copy(), True
    while part > _SHORTEST:
        step = part * motion
        goal = loops.with_fixed(loops.fixed.after_motion(loops.model, data, step))
        shorter, fault = _fault(data, goal, step)
        if not fault:
            return part, why
        part, why = part * shorter, fault
        data.qpos[:] = start
        mujoco.mj_fwdPosition(loops.model, data)
        if first_attempt and _opens(data, goal, step):
            break
        first_attempt = False
    raise ValueError(f"the velocity must keep the loops closed: however short the step, {why}")


def _fault(data: mujoco.MjData, goal: Loops, step: Array) -> tuple[float, str]:
    """Take a step in place and close the loops; if it is too long, what part to try next, and why.

    The correction grows with the square of the step. That foresees the part to within what it
    neglects; no more than half of the step is taken back by it.
    """
    model = goal.model
    mujoco.mj_integratePos(model, data.qpos, step, 1.0)
    mujoco.mj_fwdPosition(model, data)
    before, correction = data.qpos.copy(), np.empty(model.nv)
    try:
        close(data, goal)
    except ClosureError as error:
        return 0.5, f"{error.equality} stays open by {error.gap:.3g} (m or rad)"
    mujoco.mj_differentiatePos(model, correction, 1.0, before, data.qpos)
    change, length = _lengths(model, data, correction, step)
    if change <= _LONGEST_CORRECTION * length + CLOSED:
        return 1.0, ""
    data.qpos[:] = before
    mujoco.mj_fwdPosition(model, data)
    foreseen = (1.0 - _LONGEST_CORRECTION) * _LONGEST_CORRECTION * length / change
    opened = goal.largest_gap(data)[1]
    why = f"closing {opened} again changes {change / length:.0%} of the motion"
    return max(foreseen, 0.5), why


def _opens(data: mujoco.MjData, goal: Loops, step: Array) -> bool:
    """Whether a motion opens the loops to first order, so that no part of it is short enough.

    The least correction that keeps them closed is too long; or what no motion closes is too large a
    part of the most that a motion of this length may open.
    """
    rows, units = goal.rows(data), goal.velocity_units
    gaps, closing = goal.gaps(data) + rows @ step, goal.closable(rows)
    closable = closing @ gaps
    correction = goal.least_change(data, closing @ rows, -closable)
    change, length = _lengths(goal.model, data, correction, step)
    remaining = np.linalg.norm(gaps - closing.T @ closable)
    most = np.linalg.norm(rows * units) * np.linalg.norm(step / units)
    return change > _LONGEST_CORRECTION * length or bool(remaining > _LONGEST_CORRECTION * most)


def _lengths(model: mujoco.MjModel, data: mujoco.MjData, *motions: Array) -> list[float]:
    """Lengths of motions (nv,) in the metric of the mass matrix."""
    mass = mass_of(model, data)
    return [float(np.sqrt(motion @ mass @ motion)) for motion in motions]


def _site_motion(model: mujoco.MjModel, data: mujoco.MjData, motion: Array) -> tuple[Array, Array]:
    """Where each site is, and its displacement to first order, shape (nsite, 3) each."""
    planned, rows = np.empty((model.nsite, 3)), np.zeros((3, model.nv))
    for k in range(model.nsite):
        mujoco.mj_jacSite(model, data, rows, None, k)
        planned[k] = rows @ motion
    return data.site_xpos.copy(), planned


def _miss(model: mujoco.MjModel, part: float, start: Array, planned: Array, end: Array) -> str:
    """Which site ends farther from where it was to be than it was to go, if one does.

    `part` of the motion was taken; where sites were, how the whole motion was to move them, and
    where they are, (nsite, 3) each.
    """
    distance = np.linalg.norm(part * planned, axis=1)
    missed = np.linalg.norm(end - start - part * planned, axis=1)
    is_command = distance > np.maximum(_CANCELLED * distance.max(initial=0.0), CLOSED)
    ratio = np.divide(missed, distance, out=np.zeros_like(distance), where=is_command)
    if ratio.max(initial=0.0) <= 1.0:
        return ""
    worst = greatest(ratio)
    return (
        f'site "{name_of(model.site(worst))}" was to move by {distance[worst]:.3g} and ends '
        f"{missed[worst]:.3g} from there, as next to a singular pose: take steps of at most "
        f"{part * _FOLLOWED / ratio[worst]:.2g} of velocity times duration_s"
    )
