"""Joint positions with closed loops, and steps along velocities that keep them closed."""

import copy
import warnings
from collections.abc import Iterable

import mujoco
import numpy as np

import argument_checks as check
from argument_checks.ties import exceeds, greatest
from sim.array import Array
from sim.closing.equalities import active_closures, check_closures
from sim.closing.fixed import FixedMotion, Pin, fixed_motion
from sim.closing.newton import CLOSED, Loops, close
from sim.errors import ClosureError
from sim.mjcf.frame import Body
from sim.mjcf.joints import mass_of, turning
from sim.mjcf.model import bring_up_to_date, check_size, check_state, name_of, start_of

_LONGEST_TURN_RAD = 1.0
"""Largest rotation of a joint in one step [rad]."""
_LONGEST_CORRECTION = 0.05
"""Largest correction by closing the loops, as a fraction of the requested motion."""
_SHORTEST = 1e-9
"""Smallest fraction of a motion that is tested: shorter ones are within the closure tolerance."""
_CANCELLED = 1e-6
"""Fraction of the fastest site's motion below which a site counts as not moved."""
_FOLLOWED = 0.2
"""Deviation of a site, as a fraction of its motion, that the advised step length allows."""


def assemble(
    model: mujoco.MjModel,
    data: mujoco.MjData | None = None,
    held: Iterable[str | int] = (),
    pinned: Iterable[str | Body | Pin] = (),
    *,
    geometry_accuracy: float | None = None,
) -> mujoco.MjData:
    """Return a state whose `qpos` closes every active equality.

    Gaps are at most 1e-10 rad or 1e-10 mechanism lengths, the longest chain from a joint to a
    closure or pin: 1e-10 m for a mechanism of one metre, 1e-7 mm for the same in millimetres. If
    round-off permits, they are below 1e-10 units in larger models as well.

    Newton's method is used on the manifold of joint positions: each step closes the gaps to first
    order with the least change in the metric of the mass matrix. Joint limits are ignored.

    An over-constrained mechanism is closed to the accuracy of its geometry: if axes are parallel
    to 1e-6 only, gaps of this size remain that no motion can close.

    Equalities of a flex outside the mechanism, such as a cloth, are left out, each with a
    `RuntimeWarning`.

    Args:
        model: Any model.
        data: Start state, which is not changed; None is the model's first keyframe, or `qpos0`.
        held: Elements that do not move: names of joints, tendons or actuators, or velocity indices
            as in `system.stuck`.
        pinned: Frames that do not move: names of sites, :class:`Body`, or :class:`Pin`.
        geometry_accuracy: Accuracy in rad or relative length; None estimates it from the model's
            numbers, as in `jac.geometry_accuracy`, and is zero for most models.

    Returns:
        A new state with derived quantities up to date.

    Raises:
        ClosureError: An equality does not close; the message has its name and gap.
        ModelError: A name does not exist; an active equality couples a flex to the mechanism; or
            the model's flags disable active closures.
    """
    check.instance("model", model, mujoco.MjModel)
    if data is not None:
        check_state(model, data)
    closed = start_of(model) if data is None else copy.copy(data)
    if geometry_accuracy is not None:
        check.number("geometry_accuracy", geometry_accuracy, 0.0)
    fixed = fixed_motion(model, held, pinned)
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
    """Return the state after moving at a constant velocity for some time, with closed loops.

    A step that is too long is shortened, with a `RuntimeWarning` that has the fraction and the
    reason: no joint rotates by more than 1 rad, and closing the loops changes the motion by at most
    5 %. The next step can continue from the new state.

    Args:
        model: The model.
        data: Start state, which is not changed unless it is `into`.
        velocity: Velocities in MuJoCo's order, shape (N,), as `kin.velocities(rates)`; those after
            the first nv belong to transmissions and are ignored, since they follow from the others.
        duration_s: Duration [s]; 1 for a velocity that is a displacement.
        held: Elements that closing the loops does not move: stuck joints (`system.stuck`), or
            actuated ones that must move exactly as commanded.
        pinned: Frames that do not move, as for :func:`assemble`.
        geometry_accuracy: Accuracy of the geometry, as for :func:`assemble`.
        warn_of_misses: Whether to warn of deviating sites, see below; a control loop corrects
            them in its next tick.
        into: State of this model to be overwritten; it may be `data`. After an error its `qpos` is
            that of `data`. None creates a new state, which takes 0.3 ms.

    Returns:
        The new state, up to date except contacts and the mass matrix. Its `time` increases by the
        duration of the step actually taken.

    If a site deviates from its commanded end by more than its commanded motion, as near a singular
    pose, a `RuntimeWarning` has its name and the step length with which it follows the command to
    20 %. Sites whose commanded velocity is zero up to round-off are excluded.

    Raises:
        ValueError: The velocity opens the loops or moves a pinned frame, for any step length.
        ClosureError, ModelError, TypeError: As for :func:`assemble`, for the start state.
    """
    check_state(model, data)
    v = check.array("velocity", velocity, None)
    if len(v) < model.nv:
        raise ValueError(f"velocity must have shape (N,), N at least {model.nv}, got {v.shape}")
    duration_s = check.number("duration_s", duration_s, check.SMALLEST)
    motion = check.array("velocity times duration_s", v[: model.nv] * duration_s, None)
    if geometry_accuracy is not None:
        check.number("geometry_accuracy", geometry_accuracy, 0.0)
    fixed = fixed_motion(model, held, pinned)
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
        shorter = f"the step is shortened to {part:.3g} of the requested one, else {why}"
        warnings.warn(shorter, RuntimeWarning, stacklevel=2)
    if site_motion is not None and (miss := _miss(model, part, *site_motion, moved.site_xpos)):
        warnings.warn(miss, RuntimeWarning, stacklevel=2)
    return moved


def _close_in_place(
    model: mujoco.MjModel, data: mujoco.MjData, fixed: FixedMotion, accuracy: float | None
) -> tuple[Loops, tuple[str, ...]]:
    """Close the loops of a state; return them, and a sentence for each equality left out."""
    mujoco.mj_fwdPosition(model, data)
    sentences = check_closures(model, data, [pin.frame for pin in fixed.pins])
    loops = Loops(model, active_closures(model, data), fixed.at(data), accuracy)
    close(data, loops)
    return loops, sentences


def _turned(model: mujoco.MjModel, motion: Array) -> tuple[float, str]:
    """Return the fraction of a motion that limits all joint rotations, and the limiting joint.

    Beyond 1 rad the velocity predicts the task motion poorly.
    """
    if np.abs(motion).max(initial=0.0) <= _LONGEST_TURN_RAD:  # the usual case, and faster
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
    """Move in place by the largest fraction of a motion (nv,) with a small loop correction.

    `part` and `why` are the first fraction to test and the reason if it is below 1; those of the
    fraction that was taken are returned.

    If no fraction is small enough, a ValueError is raised.
    """
    start, first_attempt = data.qpos.copy(), True
    while part > _SHORTEST:
        step = part * motion
        goal = loops.with_fixed(loops.fixed.moved(loops.model, data, step))
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
    """Take a step in place and close the loops; if it is too long, return a factor and the reason.

    The factor for the next test is predicted from the correction, which grows with the square of
    the step, and is at least 0.5. It is 1 if the step is taken.
    """
    model = goal.model
    mujoco.mj_integratePos(model, data.qpos, step, 1.0)
    mujoco.mj_fwdPosition(model, data)
    before, correction = data.qpos.copy(), np.empty(model.nv)
    try:
        close(data, goal)
    except ClosureError as error:
        return 0.5, f"{error.equality} stays open by {error.gap:.3g} {error.unit}"
    mujoco.mj_differentiatePos(model, correction, 1.0, before, data.qpos)
    change, length = _lengths(model, data, correction, step)
    if change <= _LONGEST_CORRECTION * length + CLOSED:
        return 1.0, ""
    data.qpos[:] = before
    mujoco.mj_fwdPosition(model, data)
    predicted = (1.0 - _LONGEST_CORRECTION) * _LONGEST_CORRECTION * length / change
    opened = goal.described(goal.largest_gap(data)[1])[1]
    why = f"closing {opened} again changes {change / length:.0%} of the motion"
    return max(predicted, 0.5), why


def _opens(data: mujoco.MjData, goal: Loops, step: Array) -> bool:
    """Return whether a motion opens the loops to first order, so that any fraction is too long.

    This is the case if the least correction is too long, or if the gap that no motion can close is
    a large fraction of the largest gap that a motion of this length can open.
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
    """Return the lengths of motions (nv,) in the metric of the mass matrix."""
    mass = mass_of(model, data)
    return [float(np.sqrt(motion @ mass @ motion)) for motion in motions]


def _site_motion(model: mujoco.MjModel, data: mujoco.MjData, motion: Array) -> tuple[Array, Array]:
    """Return the position of each site and its first-order displacement, (nsite, 3) each."""
    planned, rows = np.empty((model.nsite, 3)), np.zeros((3, model.nv))
    for k in range(model.nsite):
        mujoco.mj_jacSite(model, data, rows, None, k)
        planned[k] = rows @ motion
    return data.site_xpos.copy(), planned


def _miss(model: mujoco.MjModel, part: float, start: Array, planned: Array, end: Array) -> str:
    """Return a sentence on the site with the largest deviation, if it exceeds its motion.

    `part` is the fraction of the motion that was taken; `start` and `end` are positions of sites,
    `planned` their displacements by the whole motion, (nsite, 3) each.
    """
    distance = np.linalg.norm(part * planned, axis=1)
    missed = np.linalg.norm(end - start - part * planned, axis=1)
    is_command = distance > np.maximum(_CANCELLED * distance.max(initial=0.0), CLOSED)
    ratio = np.divide(missed, distance, out=np.zeros_like(distance), where=is_command)
    if ratio.max(initial=0.0) <= 1.0:
        return ""
    worst = greatest(ratio)
    return (
        f'site "{name_of(model.site(worst))}" was commanded to move by {distance[worst]:.3g} and '
        f"ends {missed[worst]:.3g} from there, as near a singular pose: take steps of at most "
        f"{part * _FOLLOWED / ratio[worst]:.2g} of velocity times duration_s"
    )
