"""Assembly: joint positions at which every loop of a model is closed."""

import copy
from collections.abc import Iterable

import mujoco
import numpy as np
import scipy.linalg

import argument_checks as check
from sim.array import Array
from sim.closure import check_closures, closure_rows, equality_name, largest_gap
from sim.errors import ClosureError
from sim.frame import Body
from sim.hold import Hold, Pin, hold
from sim.model import check_state

CLOSED = 1e-10
"""Gap below which a closure counts as closed, [m] or [rad]."""

_MOST_STEPS = 60
_SHORTEST_STEP = 2.0**-10
_LONGEST_MOVE = 0.5
"""Of any joint in one step, [m] or [rad]: farther, the linearization means nothing."""
_REDUNDANT = 1e-9
"""Rows whose singular value is below this fraction of the largest close nothing."""
_LONGEST_CORRECTION = 0.1


def assemble(
    model: mujoco.MjModel,
    data: mujoco.MjData | None = None,
    held: Iterable[str | int] = (),
    pinned: Iterable[str | Body | Pin] = (),
) -> mujoco.MjData:
    """A state whose `qpos` closes every active equality to 1e-10 m or rad.

    Newton's method on the manifold of joint positions: each step closes the gaps to first order
    with the least change in the metric of the mass matrix. Joint limits do not count.

    Args:
        model: Any model.
        data: The state to begin from, which stays as it is; None is the model's `qpos0`.
        held: What does not move: names of joints, tendons or actuators, or velocity indices as in
            `system.stuck`.
        pinned: Frames that stay where they are: names of sites, :class:`Body`, or :class:`Pin`.

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
    _close(model, closed, hold(model, closed, held, pinned))
    return closed


def advance(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    velocity: Array,
    duration_s: float = 1.0,
    held: Iterable[str | int] = (),
    pinned: Iterable[str | Body | Pin] = (),
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

    Raises:
        ValueError: The step is too long: closing the loops again would change the motion by more
            than a tenth.
        ClosureError, ModelError, TypeError: As :func:`assemble`.
    """
    check_state(model, data)
    v = check.real("velocity", velocity)
    if v.ndim != 1 or len(v) < model.nv:
        raise ValueError(f"velocity must have shape (N,), N at least {model.nv}, got {v.shape}")
    motion = v[: model.nv] * check.positive("duration_s", duration_s)
    held, pinned = list(held), list(pinned)
    moved = assemble(model, data, held, pinned)
    fixed = hold(model, moved, held, pinned).moved(model, moved, motion)
    mujoco.mj_integratePos(model, moved.qpos, motion, 1.0)
    mujoco.mj_fwdPosition(model, moved)
    before = moved.qpos.copy()
    _close(model, moved, fixed)
    correction = np.empty(model.nv)
    mujoco.mj_differentiatePos(model, correction, 1.0, before, moved.qpos)
    mass = _mass(model, moved)
    change = np.sqrt(correction @ mass @ correction)
    if change > _LONGEST_CORRECTION * np.sqrt(motion @ mass @ motion) + CLOSED:
        raise ValueError(
            "velocity times duration_s must be a shorter step: closing the loops again changes "
            f"{change / np.sqrt(motion @ mass @ motion):.0%} of the motion"
        )
    return moved


def _close(model: mujoco.MjModel, data: mujoco.MjData, fixed: Hold) -> None:
    """Close the loops in place; derived quantities are up to date before and after."""
    for _ in range(_MOST_STEPS):
        if _largest_gap(model, data, fixed)[0] < CLOSED:
            return
        rows, gaps = _linearized(model, data, fixed)
        step = _least_change(_mass(model, data), rows, -gaps, fixed.free)
        if not _come_nearer(model, data, fixed, step, float(np.linalg.norm(gaps))):
            break
    gap, equality = _largest_gap(model, data, fixed)
    raise ClosureError(equality, gap, "no pose nearby closes it: hold or pin less, or begin nearer")


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
    if not free.any():
        return step
    L = np.linalg.cholesky(mass[np.ix_(free, free)])
    weighed = scipy.linalg.solve_triangular(L, rows[:, free].T, lower=True).T
    least = scipy.linalg.lstsq(weighed, change, cond=_REDUNDANT)[0]
    step[free] = scipy.linalg.solve_triangular(L.T, least, lower=False)
    return step


def _come_nearer(
    model: mujoco.MjModel, data: mujoco.MjData, fixed: Hold, step: Array, distance: float
) -> bool:
    """Take the step, halved until the gaps shrink; False, and no step, if they do not."""
    here = data.qpos.copy()
    step = step * min(1.0, _LONGEST_MOVE / max(np.abs(step).max(initial=0.0), _LONGEST_MOVE))
    fraction = 1.0
    while fraction >= _SHORTEST_STEP:
        data.qpos[:] = here
        mujoco.mj_integratePos(model, data.qpos, fraction * step, 1.0)
        mujoco.mj_fwdPosition(model, data)
        if np.linalg.norm(_linearized(model, data, fixed)[1]) < distance:
            return True
        fraction /= 2.0
    data.qpos[:] = here
    mujoco.mj_fwdPosition(model, data)
    return False


def _mass(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    return mass
