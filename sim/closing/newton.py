"""Newton's method for the gaps of closed loops."""

from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np
import scipy.linalg
from numpy.typing import NDArray

import argument_checks as check
from argument_checks.ties import exceeds, greatest
from sim.array import Array
from sim.closing.equalities import Closures
from sim.closing.fixed import FixedMotion
from sim.errors import ClosureError
from sim.mjcf.accuracy import COARSEST, written_accuracy
from sim.mjcf.frame import own_length
from sim.mjcf.joints import mass_of, turning
from sim.mjcf.model import with_sleepers

CLOSED = 1e-10
"""Gap below which a closure counts as closed, [rad] or a fraction of the mechanism's length.

For mechanisms longer than 1 unit the method aims at this number in that unit, which is smaller,
and accepts the fraction if round-off prevents further progress.
"""

_ROUND_OFF = 1e-14
"""Round-off of positions in the model's unit: smaller gaps count as zero."""
_MOST_STEPS = 60
FRACTIONS = tuple(0.5**k for k in range(11))
"""Candidate fractions of a step, in the order in which they are tested."""
_LONGEST_MOVE = 0.5
"""Longest move of a joint in one step, [rad] or mechanism lengths, for a valid linearization."""
_REDUNDANT = 1e-9
"""Relative singular value of the rows below which they are redundant."""
_MARGIN = 10.0
"""Factor on the model's accuracy that bounds redundant singular values, as in `prioritized`."""


@dataclass(frozen=True, eq=False)
class Loops:
    """Set of the c gaps to be closed: equalities, fixed transmissions and frames.

    `accuracy` is that of the geometry, in rad or relative length; None estimates it from the model.
    """

    model: mujoco.MjModel
    closures: Closures
    fixed: FixedMotion
    accuracy: float | None

    @cached_property
    def free(self) -> NDArray[np.intp]:
        """Indices of the velocities that are not fixed."""
        return np.setdiff1d(np.arange(self.model.nv), self.fixed.velocities)

    @cached_property
    def row_units(self) -> Array:
        """Units of the gaps, (c,): 1 rad for angles, the mechanism's length for lengths."""
        turns = np.append(self.closures.turns(self.model), self.fixed.turns()).astype(bool)
        return np.where(turns, 1.0, self._length)

    @cached_property
    def velocity_units(self) -> Array:
        """Units of the velocities, (nv,): 1 rad for angles, the mechanism's length for lengths."""
        return np.where(turning(self.model), 1.0, self._length)

    @cached_property
    def _length(self) -> float:
        pins = (pin.frame for pin in self.fixed.pins)
        return own_length(self.model, [*self.closures.frames(self.model), *pins])

    def with_fixed(self, fixed: FixedMotion) -> "Loops":
        """Return a copy with other fixed coordinates of the same drives and frames."""
        return check.unchecked_record(Loops, **vars(self) | {"fixed": fixed})

    def largest_gap(self, data: mujoco.MjData) -> tuple[float, int]:
        """Return the largest gap and its row, -1 without gaps, from MuJoCo's last computation."""
        self._wake(data)
        most, row = self.closures.largest_gap(data), self.closures.worst(data)
        fixed_gaps = np.abs(self.fixed.gaps(data))
        if exceeds(fixed_gaps.max(initial=0.0), most):
            return float(fixed_gaps.max()), len(self.closures.units) + greatest(fixed_gaps)
        return most, row

    def described(self, row: int) -> tuple[str, str]:
        """Return the unit of a gap and a description of its element."""
        fixed_row = row - len(self.closures.units)
        if fixed_row < 0:
            return self.closures.described(self.model, row)
        return "rad" if self.fixed.turns()[fixed_row] else "m", self.fixed.names()[fixed_row]

    def gaps(self, data: mujoco.MjData) -> Array:
        """Return all gaps (c,) in their units; raise a ModelError if one is not finite."""
        self._wake(data)
        self.closures.largest_gap(data)  # raises if one is not finite
        return np.append(self.closures.gaps(data), self.fixed.gaps(data)) / self.row_units

    def rows(self, data: mujoco.MjData) -> Array:
        """Return the gradients of the gaps in their units, (c, nv)."""
        self._wake(data)
        of_closures = self.closures.units[:, None] * self.closures.rows(self.model, data)
        return np.vstack([of_closures, self.fixed.rows(self.model, data)]) / self.row_units[:, None]

    def closable(self, rows: Array) -> Array:
        """Return the combinations (r, c) of gaps that motion can close, at the model's accuracy."""
        rows = (rows * self.velocity_units)[:, self.free]
        size, accuracy = np.linalg.norm(rows), self.accuracy
        U, sigma, _ = np.linalg.svd(rows, full_matrices=False)
        if accuracy is None:  # estimating it is slow, and rarely necessary
            doubtful = (sigma > _REDUNDANT * size) & (sigma < _MARGIN * COARSEST * size)
            accuracy = written_accuracy(self.model) if doubtful.any() else 0.0
        return U[:, sigma > max(_REDUNDANT, _MARGIN * accuracy) * size].T

    def least_change(self, data: mujoco.MjData, rows: Array, change: Array) -> Array:
        """Return the dq (nv,) of least dq^T M dq with rows dq = change; fixed velocities are 0."""
        free, step = self.free, np.zeros(self.model.nv)
        L = np.linalg.cholesky(mass_of(self.model, data)[np.ix_(free, free)])
        weighed = scipy.linalg.solve_triangular(L, rows[:, free].T, lower=True).T
        least = scipy.linalg.lstsq(weighed, change)[0]
        step[free] = scipy.linalg.solve_triangular(L.T, least, lower=False)
        return step

    def _wake(self, data: mujoco.MjData) -> None:
        with_sleepers(self.model, data, mujoco.mj_tendon, mujoco.mj_makeConstraint)


def close(data: mujoco.MjData, loops: Loops) -> None:
    """Close loops in place by Newton's method, or raise a ClosureError; `data` stays up to date."""
    if loops.largest_gap(data)[0] < _ROUND_OFF:  # the usual case, and faster
        return
    aim = CLOSED * np.minimum(1.0, 1.0 / loops.row_units)
    for _ in range(_MOST_STEPS):
        rows, gaps = loops.rows(data), loops.gaps(data)
        if (np.abs(gaps) < aim).all():
            return
        closing = loops.closable(rows)
        closable = closing @ gaps
        remaining = gaps - closing.T @ closable
        # Compared in the units of the rows: even a small gap is closed if motion can close it.
        if np.abs(gaps - remaining).max(initial=0.0) < CLOSED <= np.abs(remaining).max(initial=0.0):
            inexact = written_accuracy(loops.model) if loops.accuracy is None else loops.accuracy
            size = np.linalg.norm(rows * loops.velocity_units)
            if np.abs(gaps).max() < _MARGIN * inexact * size:
                return
            break
        step = loops.least_change(data, closing @ rows, -closable)
        if not _come_nearer(data, loops, step, closing):
            break
    if (np.abs(loops.gaps(data)) < CLOSED).all():
        return
    gap, row = loops.largest_gap(data)
    unit, name = loops.described(row)
    advice = "no pose nearby closes it: hold or pin less, or start nearer"
    raise ClosureError(name, gap, unit, advice)


def _come_nearer(data: mujoco.MjData, loops: Loops, step: Array, closing: Array) -> bool:
    """Take the step, halved until the gaps decrease; return False, without a step, if none does."""
    model, here = loops.model, data.qpos.copy()
    before = np.linalg.norm(closing @ loops.gaps(data))
    longest = np.abs(step / loops.velocity_units).max(initial=0.0)
    step = step * min(1.0, _LONGEST_MOVE / max(longest, _LONGEST_MOVE))
    for fraction in FRACTIONS:
        data.qpos[:] = here
        mujoco.mj_integratePos(model, data.qpos, fraction * step, 1.0)
        mujoco.mj_fwdPosition(model, data)
        if np.linalg.norm(closing @ loops.gaps(data)) < before:
            return True
    data.qpos[:] = here
    mujoco.mj_fwdPosition(model, data)
    return False
