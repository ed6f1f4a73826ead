"""Newton's method on the gaps of closed loops."""

from typing import NamedTuple

import mujoco
import numpy as np
import scipy.linalg

from argument_checks.ties import exceeds, greatest
from sim.array import Array
from sim.closing.equalities import active_closures, equality_name
from sim.closing.hold import Hold
from sim.closing.pin import located_pins
from sim.errors import ClosureError
from sim.mjcf.accuracy import COARSEST, written_accuracy
from sim.mjcf.dynamics import mass_of
from sim.mjcf.frame import own_length
from sim.mjcf.ranges import turning

CLOSED = 1e-10
"""Gap below which a closure counts as closed, [rad], or a part of the mechanism's own length.

In models longer than 1 in their unit less is aimed at, the same number in that unit, and this is
enough where round-off lets no step come nearer.
"""

_ROUND_OFF = 1e-14
"""Of positions in the model's unit: a smaller gap is none, whatever the own length."""
_MOST_STEPS = 60
_SHORTEST_STEP = 2.0**-10
_LONGEST_MOVE = 0.5
"""Of any joint in one step, [rad] or own lengths: farther, the linearization means nothing."""
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
    if largest_gap(model, data, fixed)[0] < _ROUND_OFF:  # mostly, and faster
        return
    units = _units(model, data, fixed)
    aim = CLOSED * np.minimum(1.0, 1.0 / units.rows)
    for _ in range(_MOST_STEPS):
        rows, gaps = _linearized(model, data, fixed, units)
        if (np.abs(gaps) < aim).all():
            return
        closing = _closing(model, (rows * units.velocities)[:, fixed.free], accuracy)
        closable = closing @ gaps
        rest = gaps - closing.T @ closable
        # Both in the units of the rows: a gap that motion can close is closed, however small.
        if np.abs(gaps - rest).max(initial=0.0) < CLOSED <= np.abs(rest).max(initial=0.0):
            inexact = written_accuracy(model) if accuracy is None else accuracy
            size = np.linalg.norm(rows * units.velocities)
            if np.abs(gaps).max() < _MARGIN * inexact * size:
                return
            break
        step = _least_change(mass_of(model, data), closing @ rows, -closable, fixed.free)
        if not _come_nearer(model, data, fixed, step, closing, units):
            break
    if (np.abs(_linearized(model, data, fixed, units)[1]) < CLOSED).all():
        return
    gap, equality = largest_gap(model, data, fixed)
    raise ClosureError(equality, gap, "no pose nearby closes it: hold or pin less, or begin nearer")


class _Units(NamedTuple):
    """What gaps and velocities are measured in: 1 of an angle, the own length of a length.

    Attributes:
        rows: Of each closure, held transmission and row of a pin, shape (c,).
        velocities: Shape (nv,).
    """

    rows: Array
    velocities: Array


def _units(model: mujoco.MjModel, data: mujoco.MjData, fixed: Hold) -> _Units:
    closures = active_closures(model, data)
    pinned = [pin.frame for pin in located_pins(model, fixed.pins)]
    length = own_length(model, [*closures.frames(model), *pinned])
    turns = np.append(closures.turns(model), fixed.turns()).astype(bool)
    return _Units(np.where(turns, 1.0, length), np.where(turning(model), 1.0, length))


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
    units = _units(model, data, goal)
    rows, gaps = _linearized(model, data, goal, units)
    gaps = gaps + rows @ motion
    closing = _closing(model, (rows * units.velocities)[:, goal.free], accuracy)
    closable = closing @ gaps
    change = _least_change(mass_of(model, data), closing @ rows, -closable, goal.free)
    rest = np.linalg.norm(gaps - closing.T @ closable)
    most = np.linalg.norm(rows * units.velocities) * np.linalg.norm(motion / units.velocities)
    return change, float(rest / most)


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


def _linearized(
    model: mujoco.MjModel, data: mujoco.MjData, fixed: Hold, units: _Units
) -> tuple[Array, Array]:
    """Rows of everything that must be closed, and their gaps, both in units of the rows."""
    rows, gaps = fixed.rows_and_gaps(model, data)
    closures = active_closures(model, data)
    closures.largest_gap(data)  # raises if it is not finite
    of_closures = closures.units[:, None] * closures.rows(model, data)
    gaps = np.concatenate([closures.gaps(data), gaps])
    return np.vstack([of_closures, rows]) / units.rows[:, None], gaps / units.rows


def _least_change(mass: Array, rows: Array, change: Array, free: Array) -> Array:
    """The dq (nv,) of least dq^T M dq with rows dq = change, by the velocities that are free."""
    step = np.zeros(len(free))
    L = np.linalg.cholesky(mass[np.ix_(free, free)])
    weighed = scipy.linalg.solve_triangular(L, rows[:, free].T, lower=True).T
    least = scipy.linalg.lstsq(weighed, change)[0]
    step[free] = scipy.linalg.solve_triangular(L.T, least, lower=False)
    return step


def _come_nearer(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    fixed: Hold,
    step: Array,
    closing: Array,
    units: _Units,
) -> bool:
    """Take the step, halved until the gaps shrink; False, and no step, if they do not."""

    def distance() -> float:
        return float(np.linalg.norm(closing @ _linearized(model, data, fixed, units)[1]))

    here, before = data.qpos.copy(), distance()
    longest = np.abs(step / units.velocities).max(initial=0.0)
    step = step * min(1.0, _LONGEST_MOVE / max(longest, _LONGEST_MOVE))
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
