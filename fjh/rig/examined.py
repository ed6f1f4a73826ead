"""What failures leave of a major task at one posture: classified, measured, compared, in words."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from math import comb, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fjh.rig.conditions import FREE, LOCKED, SOUND, Codes
from fjh.rig.verdicts import left_of
from fjh.study.option import OnProgress
from prioritized import Classes, ConstrainedSystem, failure_atlas
from sim import Array

Limits = tuple[Array, Array]

LEAST_LEFT = 0.01
"""Part of the sound robot's speed, force or effect that a failure leaves if it is survived."""


@dataclass(frozen=True, eq=False)
class Examined:
    """What each of C failure conditions leaves; the first condition is the sound one.

    Attributes:
        codes: Shape (C, n).
        left: Verdicts and numbers of each; with the springs where these count.
        are_joints: Whether a free actuator is a joint that moves freely. Otherwise it is an input
            that has no effect any more, as a rotor that stands: its column is out, free or locked.
    """

    codes: Codes
    left: Classes
    are_joints: bool

    @property
    def survived(self) -> NDArray[np.bool_]:
        """Whether the task is possible with `LEAST_LEFT` of what the sound robot has, (C,)."""
        return self._possible & ~(self.share < LEAST_LEFT)

    @cached_property
    def share(self) -> Array:
        """What decides: the speed left, and of a robot the force if that is less, shape (C,).

        Without limits of the forces that of unit norm, which is the inverse of the error gain.
        """
        if not self.are_joints:
            return self.speed_left
        force = self.force_left
        if force is None:
            with np.errstate(divide="ignore"):
                force = _over_the_first(1.0 / self.error_gain)
        return np.fmin(self.speed_left, force)

    @property
    def _possible(self) -> NDArray[np.bool_]:
        """Whether it is fully reachable, within limits too, and no self-motion moves it."""
        if self.left.worst_speed is None:
            return self.left.possible
        return self.left.possible & (self.left.worst_speed > 0.0)

    @property
    def failures(self) -> NDArray[np.intp]:
        """Number of failed actuators, shape (C,)."""
        return (self.codes != SOUND).sum(axis=1)

    @property
    def error_gain(self) -> Array:
        """Largest major error per unit norm of the errors of the actuators, shape (C,)."""
        return self.left.gains[:, 0]

    @property
    def largest_gain(self) -> Array:
        """Largest norm of the rates per major speed, infinite where there is none, (C,)."""
        with np.errstate(divide="ignore"):
            return np.where(self._possible, 1.0 / self.left.worst_gain, np.inf)

    @cached_property
    def relative_manipulability(self) -> Array:
        """sqrt(det J_m J_m^T) over that of the sound robot, shape (C,).

        On the admissible rates. Zero where a direction is out of reach or moves by itself; NaN
        where it is so without failures.
        """
        return _over_the_first(np.where(self.left.possible, self.left.gains.prod(axis=1), 0.0))

    @cached_property
    def speed_left(self) -> Array:
        """Worst major speed over that of the sound robot, shape (C,).

        Zero where the task is impossible; NaN where it is so without failures. Where no speed was
        computed, or no limit bounds it, that of rates of norm one.
        """
        speed = self.left.worst_speed
        if speed is None or np.isinf(speed[0]):
            speed = self.left.worst_gain
        return _over_the_first(np.where(self._possible, speed, 0.0))

    @property
    def force_left(self) -> Array | None:
        """Worst major force likewise; infinite where the structure bears every force."""
        return None if self.left.worst_force is None else _over_the_first(self.left.worst_force)

    @cached_property
    def singles(self) -> NDArray[np.intp]:
        """Rows of the single failures, locked and free, shape (n, 2)."""
        rows = np.zeros((self.codes.shape[1], 2), dtype=np.intp)
        for row in np.flatnonzero(self.failures == 1):
            actuator = int(np.flatnonzero(self.codes[row])[0])
            rows[actuator, self.codes[row, actuator] - LOCKED] = row
        return rows

    @cached_property
    def best_possible(self) -> Array:
        """What no robot can exceed under every set of as many failures, shape (C,).

        sqrt(C(n - i, m) / C(n, m)): the root mean square over all sets of i columns that are out
        of n (Ukidve, McInroy and Jafari, 2008). NaN where failures take more than columns away: in
        loops that constrain the actuators, and with a joint that moves freely.
        """
        n, m = self.codes.shape[1], self.left.gains.shape[1]
        found = np.array([best_relative_manipulability(n, m, int(i)) for i in self.failures])
        takes_more = self.are_joints & (self.codes == FREE).any(axis=1)
        found[takes_more | self.left.constrained_active[0]] = np.nan
        return found

    def lost(self, row: int) -> Array:
        """Secondary directions that the sound robot has and this condition lost, shape (m2, k)."""
        here, sound = (_columns(self.left.lost_secondary[k]) for k in (row, 0))
        left = here - sound @ (sound.T @ here)
        U, sigma, _ = np.linalg.svd(left, full_matrices=False)
        return U[:, sigma > _SAME]

    def verdict(self, row: int) -> str:
        """Of the major task: that of :func:`fjh.rig.verdicts.left_of`, or one of two.

        "no room": the limits leave none in some major direction; "nearly lost": less than
        `LEAST_LEFT` is left there.
        """
        if self.left.possible[row] and not self.survived[row]:
            return NEARLY_LOST if self._possible[row] else NO_ROOM
        return left_of(self.left)[row].replace("_", " ")

    def reason(self, row: int) -> str:
        """Why the major task is not possible, a clause."""
        return _REASONS.get(self.verdict(row), "the actuators do not reach every major direction")


NO_ROOM, NEARLY_LOST = "no room", "nearly lost"
_REASONS = {
    "drifts": "it moves although every actuator stands still",
    NO_ROOM: "the limits leave no room in some major direction",
}


def _over_the_first(values: Array) -> Array:
    with np.errstate(invalid="ignore"):  # infinity over infinity
        return values / values[0] if values[0] else np.full(len(values), np.nan)


_SAME = 1e-6
"""Sine of the angle between a lost direction and those that were lost before."""


def _columns(padded: Array) -> Array:
    return padded[:, padded.any(axis=0)]


def best_relative_manipulability(n: int, m: int, failures: int) -> float:
    """sqrt(C(n - i, m) / C(n, m)), NaN for fewer actuators than rows."""
    return sqrt(comb(n - failures, m) / comb(n, m)) if n >= m else np.nan


def examine(
    system: ConstrainedSystem,
    major: Sequence[int],
    codes: Codes,
    *,
    rates: Limits | None = None,
    torques: Limits | None = None,
    are_joints: bool = True,
    on_progress: OnProgress = lambda done, total: None,
) -> Examined:
    """What failures leave of a system; with its springs where it has some.

    Args:
        system: At one posture.
        major: Task rows of the major task.
        codes: The conditions, the sound one first.
        rates: Limits of the rates, (n,) or (C, n), for the worst speed; None: it is not computed.
        torques: Likewise of the torques.
        are_joints: As in :class:`Examined`.
        on_progress: Called with the examined and the total number of conditions, if these are so
            many that they are examined in several parts.
    """
    different, row_of = codes, np.arange(len(codes))
    if not are_joints:
        different = np.where(codes == FREE, LOCKED, codes)
        if rates is None or rates[0].ndim == 1:  # which failures there are does not matter
            different, row_of = np.unique(different, axis=0, return_inverse=True)
    parts: list[Classes] = []
    step = max(1, _AT_ONCE // codes.shape[1] ** 2)
    for begin in range(0, len(different), step):
        part = slice(begin, begin + step)
        atlas = failure_atlas(
            system,
            list(major),
            codes=different[part],
            rate_limits=_of_part(rates, part),
            torque_limits=_of_part(torques, part),
        )
        parts.append(atlas.elastic or atlas)
        if step < len(different):
            on_progress(min(begin + step, len(different)), len(different))
    return Examined(codes, _joined(parts, row_of.ravel()), are_joints)


_AT_ONCE = 200_000
"""Conditions times squared actuators: less than a second, and 100 MB."""


def _of_part(limits: Limits | None, part: slice) -> Limits | None:
    if limits is None or limits[0].ndim < 2:
        return limits
    return limits[0][part], limits[1][part]


def _joined(parts: Sequence[Classes], rows: NDArray[np.intp]) -> Classes:
    """Conditions of all parts by their rows, each as often as it is named."""
    joined: dict[str, Any] = {}
    for each in fields(Classes):
        values = [getattr(part, each.name) for part in parts]
        if values[0] is not None and each.name == "self_motion":  # padded for each part alone
            most = max(basis.shape[2] for basis in values)
            values = [np.pad(b, ((0, 0), (0, 0), (0, most - b.shape[2]))) for b in values]
        joined[each.name] = None if values[0] is None else np.concatenate(values)[rows]
    return Classes(**joined)


_ALONE = 0.995
"""Part of a direction that is of one row, so that the row alone is named."""
_PART = 0.05
"""Smallest part of a direction that is named."""


def directions_in_words(basis: Array, rows: Sequence[str]) -> str:
    """Directions (m2, k) of rows by their names: "y", or "0.8 x - 0.6 turn z"; "nothing" of none.

    Rows that are lost whole come first, then what is left, a combination each.
    """
    whole = np.flatnonzero(np.linalg.norm(basis, axis=1) > _ALONE).tolist()
    rest = basis.copy()
    rest[whole] = 0.0
    U, sigma, _ = np.linalg.svd(rest, full_matrices=False)
    words = [str(rows[k]) for k in whole] + [_combined(u, rows) for u in U[:, sigma > 0.5].T]
    return "; ".join(words) or "nothing"


def _combined(direction: Array, rows: Sequence[str]) -> str:
    first = np.flatnonzero(np.abs(direction) > _PART).tolist()
    sign = 1.0 if direction[first[0]] > 0 else -1.0
    said = ""
    for k in first:
        value = sign * direction[k]
        between = (" + " if value > 0 else " - ") if said else ("" if value > 0 else "-")
        said += f"{between}{abs(value):.2g} {rows[k]}"
    return said
