"""Periodic reference paths for runs of unknown duration."""

from dataclasses import dataclass

import numpy as np

from fjh.rig import Rig
from sim import Array

REST = "rest"
PATHS = ("circle", "spiral", "steps", REST)
TURN_S = 4.0
_SOFT_START_S = 0.5
"""Duration [s] of the soft start, after which a circle repeats."""
_AHEAD_S = 1.0
"""Preview of a path [s] for the non-causal feedforward."""
_SWITCH_S = 1.0
_OUTLINE_EVERY = 20
"""Number of ticks between points of the outline."""


@dataclass(frozen=True)
class ReferencePath:
    """Desired displacements of the major rows for an unlimited number of ticks.

    Attributes:
        name: One of `PATHS`.
        desired: Desired displacements of the first K ticks, (K, m1), [rad] or [m].
        demands: Feedforward demands of the same shape and units; None: no feedforward.
        cycle: Number of ticks at the end of `desired` that repeat.
    """

    name: str
    desired: Array
    demands: Array | None
    cycle: int

    @property
    def outline(self) -> Array:
        """Points of a cycle for a drawing, (N, m1)."""
        return self.desired[-self.cycle - 1 :: _OUTLINE_EVERY]

    def at(self, ticks: Array) -> tuple[Array, Array | None]:
        """Return desired displacements and demands (or None) at ticks (T,), shape (T, m1) each."""
        before = len(self.desired) - self.cycle
        rows = np.where(ticks < before, ticks, before + (ticks - before) % self.cycle)
        return self.desired[rows], None if self.demands is None else self.demands[rows]


def reference_path(
    rig: Rig, name: str, former: ReferencePath | None = None, tick: int = 0
) -> ReferencePath:
    """Return a path that starts at rest, plus the former path, faded out from its `tick` on."""
    switch = round(_SWITCH_S / rig.period_s) if former is not None else 0
    path, cycle = _cyclic(rig, name)
    desired = np.concatenate([np.zeros((switch, path.shape[1])), path])
    demands = rig.feedforward_demands(desired)
    if former is not None:
        part = np.linspace(0.0, 1.0, switch, endpoint=False)[:, None]
        fades = 1.0 - part**3 * (10.0 - 15.0 * part + 6.0 * part**2)  # minimum jerk
        was_desired, was_demanded = former.at(tick + np.arange(switch))
        desired[:switch] += fades * was_desired
        if demands is not None and was_demanded is not None:
            demands[:switch] += fades * was_demanded
    end = len(desired) - round(_AHEAD_S / rig.period_s)
    return ReferencePath(name, desired[:end], None if demands is None else demands[:end], cycle)


def _cyclic(rig: Rig, name: str) -> tuple[Array, int]:
    """Return a path (N, m1) of start, two cycles and preview, and the ticks of a cycle."""
    rows, ahead_s = len(rig.major), _AHEAD_S
    if name == REST:
        return np.zeros((round(ahead_s / rig.period_s) + 1, rows)), 1
    if name == "spiral":  # out, and back the same way
        out = rig.path(name, duration_s=2 * TURN_S, turn_s=TURN_S)
        cycle = np.concatenate([out, out[::-1]])
        return np.concatenate([cycle, cycle, cycle[: round(ahead_s / rig.period_s)]]), len(cycle)
    cycle_s = TURN_S if name == "circle" else rows * TURN_S / 2
    path = rig.path(name, duration_s=_SOFT_START_S + 2 * cycle_s + ahead_s, turn_s=TURN_S)
    return path, round(cycle_s / rig.period_s)
