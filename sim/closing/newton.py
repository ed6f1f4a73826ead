"""Newton's method on the gaps of closed loops."""

import mujoco
import numpy as np
import scipy.linalg

from argument_checks.ties import exceeds, greatest
from sim.array import Array
from sim.closing.equalities import active_closures, equality_name
from sim.closing.hold import Hold
from sim.errors import ClosureError
from sim.mjcf.accuracy import COARSEST, written_accuracy
from sim.mjcf.dynamics import mass_of

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


def close(model: mujoco.MjModel, data: mujoco.MjData, fixed: Hold, accuracy: float | None) -> None:
    """Close the loops in place by Newton's method.

    Args:
        model: The model.
        data: Its state, derived quantities up to date before and after.
        fixed: What must not move.
        accuracy: Of the geometry, in rad or relative length; None is what the model shows.

    Raises:
        ClosureError: What does not close.
    """
    for _ in range(_MOST_STEPS):
        gap, equality = largest_gap(model, data, fixed)
        if gap < CLOSED:
            return
        rows, gaps = _linearized(model, data, fixed)
        closing = _closing(model, rows[:, fixed.free], accuracy)
        closable = closing @ gaps
        rest = gaps - closing.T @ closable
        # Both in the units of the rows: a gap that motion can close is closed, however small.
        if np.abs(gaps - rest).max(initial=0.0) < CLOSED <= np.abs(rest).max(initial=0.0):
            inexact = written_accuracy(model) if accuracy is None else accuracy
            if gap < _MARGIN * inexact * np.linalg.norm(rows):
                return
            break
        step = _least_change(mass_of(model, data), closing @ rows, -closable, fixed.free)
        if not _come_nearer(model, data, fixed, step, closing):
            break
    gap, equality = largest_gap(model, data, fixed)
    raise ClosureError(equality, gap, "no pose nearby closes it: hold or pin less, or begin nearer")


def lacking(
    model: mujoco.MjModel, data: mujoco.MjData, goal: Hold, motion: Array, accuracy: float | None
) -> tuple[Array, float]:
    """What a motion from here lacks to keep the loops closed, to first order.

    Args:
        model: The model.
        data: Its state, derived quantities up to date.
        goal: What is held and pinned after the motion.
        motion: A displacement of all joints, shape (nv,).
        accuracy: As of :func:`close`.

    Returns:
        The least change (nv,) that closes them; and what no motion closes, as a part of the most
        that a motion of this length may open.
    """
    rows, gaps = _linearized(model, data, goal)
    gaps = gaps + rows @ motion
    closing = _closing(model, rows[:, goal.free], accuracy)
    closable = closing @ gaps
    change = _least_change(mass_of(model, data), closing @ rows, -closable, goal.free)
    rest = np.linalg.norm(gaps - closing.T @ closable)
    return change, float(rest / (np.linalg.norm(rows) * np.linalg.norm(motion)))


def _closing(model: mujoco.MjModel, rows: Array, accuracy: float | None) -> Array:
    """Combinations (r, c) of the rows (c, .) that motion can close at this accuracy."""
    size = np.linalg.norm(rows)
    U, sigma, _ = np.linalg.svd(rows, full_matrices=False)
    if accuracy is None:  # what the model shows is looked for only where it matters
        doubtful = (sigma > _REDUNDANT * size) & (sigma < _MARGIN * COARSEST * size)
        accuracy = written_accuracy(model) if doubtful.any() else 0.0
    return U[:, sigma > max(_REDUNDANT, _MARGIN * accuracy) * size].T


def largest_gap(model: mujoco.MjModel, data: mujoco.MjData, fixed: Hold) -> tuple[float, str]:
    """Of closures and of what is held: how large, and whose, in words."""
    closures = active_closures(model, data)
    of_closures, equality = closures.largest_gap(data), closures.worst(data)
    of_held = np.abs(fixed.rows_and_gaps(model, data)[1])
    if exceeds(of_held.max(initial=0.0), of_closures):
        return float(of_held.max()), fixed.names()[greatest(of_held)]
    return of_closures, equality_name(model, equality) if equality >= 0 else ""


def _linearized(model: mujoco.MjModel, data: mujoco.MjData, fixed: Hold) -> tuple[Array, Array]:
    """Rows of everything that must be closed, and their gaps, [m] or [rad]."""
    rows, gaps = fixed.rows_and_gaps(model, data)
    closures = active_closures(model, data)
    of_closures = closures.units[:, None] * closures.rows(model, data)
    return np.vstack([of_closures, rows]), np.concatenate([closures.gaps(data), gaps])


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
