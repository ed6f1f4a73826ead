"""Assembly: joint positions at which every loop of a model is closed."""

import copy
from collections.abc import Iterable

import mujoco
import numpy as np
import scipy.linalg

import argument_checks as check
from sim.accuracy import COARSEST, written_accuracy
from sim.array import Array
from sim.closure import check_closures, closure_rows, equality_name, largest_gap
from sim.errors import ClosureError
from sim.frame import Body
from sim.hold import Hold, hold
from sim.limits import turning
from sim.model import check_state, name_of
from sim.pin import Pin

CLOSED = 1e-10
"""Gap below which a closure counts as closed, [m] or [rad]."""

_MOST_STEPS = 60
_SHORTEST_STEP = 2.0**-10
_LONGEST_MOVE = 0.5
"""Of any joint in one step, [m] or [rad]: farther, the linearization means nothing."""
_REDUNDANT = 1e-9
"""Singular values of the rows below this fraction of their norm close nothing."""
_MARGIN = 10.0
"""By which those of an inexact model may exceed its accuracy, as in `prioritized`."""
_LONGEST_CORRECTION = 0.05
_LONGEST_TURN_RAD = 1.0


def assemble(
    model: mujoco.MjModel,
    data: mujoco.MjData | None = None,
    held: Iterable[str | int] = (),
    pinned: Iterable[str | Body | Pin] = (),
    *,
    geometry_accuracy: float | None = None,
) -> mujoco.MjData:
    """A state whose `qpos` closes every active equality to 1e-10 m or rad.

    Newton's method on the manifold of joint positions: each step closes the gaps to first order
    with the least change in the metric of the mass matrix. Joint limits do not count.

    An over-constrained mechanism closes as far as its geometry is accurate: with axes that are
    parallel to 1e-6 only, gaps of this size stay that no motion within it can close.

    Args:
        model: Any model.
        data: The state to begin from, which stays as it is; None is the model's `qpos0`.
        held: What does not move: names of joints, tendons or actuators, or velocity indices as in
            `system.stuck`.
        pinned: Frames that stay where they are: names of sites, :class:`Body`, or :class:`Pin`.
        geometry_accuracy: In rad or relative length; None is what the numbers of the model show, as
            in `jac.geometry_accuracy`, and mostly zero.

    Returns:
        A new state, derived quantities up to date.

    Raises:
        ClosureError: An equality that does not close: which, and how far it stays open.
        ModelError: A name that does not exist; an active equality of a flex; closures that the
            model's flags switch off.
        ValueError: `data` is of another model, or its `qpos` is not finite.
        TypeError: An argument is of another kind.
    """
    check.instance("model", model, mujoco.MjModel)
    if data is not None:
        check_state(model, data)
    closed = mujoco.MjData(model) if data is None else copy.copy(data)
    check_closures(model, closed)
    mujoco.mj_fwdPosition(model, closed)
    _close(model, closed, hold(model, closed, held, pinned), _checked(geometry_accuracy))
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
) -> mujoco.MjData:
    """The state after moving at a constant velocity for some time, all loops closed again.

    Args:
        model: The model.
        data: The state to begin from, which stays as it is.
        velocity: Of all joints, in MuJoCo's order, shape (N,), as `kin.velocities(rates)`; what
            follows the first nv numbers belongs to transmissions and follows from these.
        duration_s: How long; 1 for a velocity that is a displacement.
        held: What takes no part in closing the loops: joints that are stuck (`system.stuck`), or
            actuated ones that must move exactly as commanded.
        pinned: As for :func:`assemble`.
        geometry_accuracy: As for :func:`assemble`.

    Raises:
        ValueError: The step is too long: a joint turns by more than 1 rad, or closing the loops
            again would change the motion by more than a twentieth.
        ClosureError, ModelError, TypeError: As :func:`assemble`.
    """
    check_state(model, data)
    v = check.real("velocity", velocity)
    if v.ndim != 1 or len(v) < model.nv:
        raise ValueError(f"velocity must have shape (N,), N at least {model.nv}, got {v.shape}")
    motion = v[: model.nv] * check.positive("duration_s", duration_s)
    _refuse_long_turns(model, motion)
    held, pinned, accuracy = list(held), list(pinned), _checked(geometry_accuracy)
    moved = assemble(model, data, held, pinned, geometry_accuracy=accuracy)
    fixed = hold(model, moved, held, pinned).moved(model, moved, motion)
    mujoco.mj_integratePos(model, moved.qpos, motion, 1.0)
    mujoco.mj_fwdPosition(model, moved)
    before = moved.qpos.copy()
    _close(model, moved, fixed, accuracy)
    correction = np.empty(model.nv)
    mujoco.mj_differentiatePos(model, correction, 1.0, before, moved.qpos)
    mass = _mass(model, moved)
    change, length = (np.sqrt(d @ mass @ d) for d in (correction, motion))
    if change > _LONGEST_CORRECTION * length + CLOSED:
        raise ValueError(
            "velocity times duration_s must be a shorter step: closing the loops again changes "
            f"{change / length:.0%} of the motion"
        )
    return moved


def _refuse_long_turns(model: mujoco.MjModel, motion: Array) -> None:
    """Beyond a radian a velocity says little about where the task goes."""
    turns = np.abs(motion) * turning(model)
    if turns.max(initial=0.0) > _LONGEST_TURN_RAD:
        joint = name_of(model.joint(int(model.dof_jntid[turns.argmax()])))
        raise ValueError(
            f'velocity times duration_s must be a shorter step: joint "{joint}" turns by '
            f"{turns.max():.3g} rad, more than {_LONGEST_TURN_RAD:g}"
        )


def _checked(geometry_accuracy: float | None) -> float | None:
    if geometry_accuracy is None:
        return None
    return check.number("geometry_accuracy", geometry_accuracy)


def _close(model: mujoco.MjModel, data: mujoco.MjData, fixed: Hold, accuracy: float | None) -> None:
    """Close the loops in place; derived quantities are up to date before and after."""
    for _ in range(_MOST_STEPS):
        gap, equality = _largest_gap(model, data, fixed)
        if gap < CLOSED:
            return
        rows, gaps = _linearized(model, data, fixed)
        closing = _closing(model, rows[:, fixed.free], accuracy)
        closable = closing @ gaps
        if np.abs(closable).max(initial=0.0) < CLOSED:
            inexact = written_accuracy(model) if accuracy is None else accuracy
            if gap < _MARGIN * inexact * np.linalg.norm(rows):
                return
            break
        step = _least_change(_mass(model, data), closing @ rows, -closable, fixed.free)
        if not _come_nearer(model, data, fixed, step, closing):
            break
    gap, equality = _largest_gap(model, data, fixed)
    raise ClosureError(equality, gap, "no pose nearby closes it: hold or pin less, or begin nearer")


def _closing(model: mujoco.MjModel, rows: Array, accuracy: float | None) -> Array:
    """Combinations (r, c) of the rows (c, .) that motion can close at this accuracy."""
    size = np.linalg.norm(rows)
    U, sigma, _ = np.linalg.svd(rows, full_matrices=False)
    if accuracy is None:  # what the model shows is looked for only where it matters
        doubtful = (sigma > _REDUNDANT * size) & (sigma < _MARGIN * COARSEST * size)
        accuracy = written_accuracy(model) if doubtful.any() else 0.0
    return U[:, sigma > max(_REDUNDANT, _MARGIN * accuracy) * size].T


def _largest_gap(model: mujoco.MjModel, data: mujoco.MjData, fixed: Hold) -> tuple[float, str]:
    """Of closures and of what is held: how large, and whose, in words."""
    of_closures, equality = largest_gap(model, data)
    of_held = np.abs(fixed.rows_and_gaps(model, data)[1])
    if of_held.max(initial=0.0) > of_closures:
        return float(of_held.max()), fixed.names()[int(of_held.argmax())]
    return of_closures, equality_name(model, equality) if equality >= 0 else ""


def _linearized(model: mujoco.MjModel, data: mujoco.MjData, fixed: Hold) -> tuple[Array, Array]:
    """Rows of everything that must be closed, and their gaps in the units of the rows."""
    rows, gaps = fixed.rows_and_gaps(model, data)
    return (
        np.vstack([closure_rows(model, data), rows]),
        np.concatenate([data.efc_pos[: data.ne], gaps]),
    )


def _least_change(mass: Array, rows: Array, change: Array, free: Array) -> Array:
    """The dq (nv,) of least dq^T M dq with rows dq = change, by the velocities that are free."""
    step = np.zeros(len(free))
    L = np.linalg.cholesky(mass[np.ix_(free, free)])
    weighed = scipy.linalg.solve_triangular(L, rows[:, free].T, lower=True).T
    least = scipy.linalg.lstsq(weighed, change)[0]
    step[free] = scipy.linalg.solve_triangular(L.T, least, lower=False)
    return step


def _come_nearer(
    model: mujoco.MjModel, data: mujoco.MjData, fixed: Hold, step: Array, closing: Array
) -> bool:
    """Take the step, halved until the gaps shrink; False, and no step, if they do not."""

    def distance() -> float:
        return float(np.linalg.norm(closing @ _linearized(model, data, fixed)[1]))

    here, before = data.qpos.copy(), distance()
    step = step * min(1.0, _LONGEST_MOVE / max(np.abs(step).max(initial=0.0), _LONGEST_MOVE))
    fraction = 1.0
    while fraction >= _SHORTEST_STEP:
        data.qpos[:] = here
        mujoco.mj_integratePos(model, data.qpos, fraction * step, 1.0)
        mujoco.mj_fwdPosition(model, data)
        if distance() < before:
            return True
        fraction /= 2.0
    data.qpos[:] = here
    mujoco.mj_fwdPosition(model, data)
    return False


def _mass(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    return mass
