"""Analysis of a major task at one posture under failures: classification, speed, force, reasons."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from math import comb, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fjh.rig.classification import classify
from fjh.rig.conditions import FREE, HEALTHY, LOCKED, Codes
from fjh.study.option import OnProgress
from prioritized import Classes, ConstrainedSystem, failure_atlas
from sim import Array

Limits = tuple[Array, Array]

LEAST_LEFT = 0.01
"""Least fraction of the healthy speed, force or effect that remains if a failure is survived."""


@dataclass(frozen=True, eq=False)
class ConditionAnalysis:
    """Analysis of C failure conditions of a system; the first condition is the healthy one.

    Attributes:
        codes: Conditions, shape (C, n).
        classes: Classes and gains of each condition, of the elastic mechanism if its springs count.
        are_joints: True if a free actuator is a joint that moves freely. Otherwise actuators are
            inputs, such as rotors, and the column of a free or locked one is removed.
    """

    codes: Codes
    classes: Classes
    are_joints: bool

    @property
    def survived(self) -> NDArray[np.bool_]:
        """True where at least `LEAST_LEFT` of the healthy performance remains, shape (C,)."""
        return self._possible & ~(self.share < LEAST_LEFT)

    @cached_property
    def share(self) -> Array:
        """Remaining performance that decides survival, shape (C,): the smaller of speed and force.

        For inputs only the speed counts. Without force limits, the force is that of torques of unit
        norm, the inverse of the error gain.
        """
        if not self.are_joints:
            return self.speed_left
        force = self.force_left
        if force is None:
            with np.errstate(divide="ignore"):
                force = _over_first(1.0 / self.error_gain)
        return np.fmin(self.speed_left, force)

    @property
    def _possible(self) -> NDArray[np.bool_]:
        """True where the task is reachable within limits and no self-motion moves it, (C,)."""
        if self.classes.worst_speed is None:
            return self.classes.possible
        return self.classes.possible & (self.classes.worst_speed > 0.0)

    @property
    def failures(self) -> NDArray[np.intp]:
        """Number of failed actuators, shape (C,)."""
        return (self.codes != HEALTHY).sum(axis=1)

    @property
    def error_gain(self) -> Array:
        """Largest major error per unit norm of the errors of the actuators, shape (C,)."""
        return self.classes.gains[:, 0]

    @property
    def largest_gain(self) -> Array:
        """Largest norm of the rates per major speed, (C,); infinite if the task is impossible."""
        with np.errstate(divide="ignore"):
            return np.where(self._possible, 1.0 / self.classes.worst_gain, np.inf)

    @cached_property
    def relative_manipulability(self) -> Array:
        """Ratio of sqrt(det J_m J_m^T) on the admissible rates to the healthy robot's, shape (C,).

        Zero if a direction is out of reach or moves by self-motion; NaN if that holds without
        failures.
        """
        return _over_first(np.where(self.classes.possible, self.classes.gains.prod(axis=1), 0.0))

    @cached_property
    def speed_left(self) -> Array:
        """Ratio of the worst major speed to the healthy robot's, shape (C,).

        Zero if the task is impossible; NaN if it is impossible without failures. Without computed
        or bounded speeds, those of rates of norm one are compared.
        """
        speed = self.classes.worst_speed
        if speed is None or np.isinf(speed[0]):
            speed = self.classes.worst_gain
        return _over_first(np.where(self._possible, speed, 0.0))

    @property
    def force_left(self) -> Array | None:
        """Ratio of the worst major force to the healthy one, (C,); None without force limits."""
        return None if self.classes.worst_force is None else _over_first(self.classes.worst_force)

    @cached_property
    def singles(self) -> NDArray[np.intp]:
        """Numbers of the conditions with one failed actuator, locked and free, shape (n, 2)."""
        rows = np.zeros((self.codes.shape[1], 2), dtype=np.intp)
        for row in np.flatnonzero(self.failures == 1):
            actuator = int(np.flatnonzero(self.codes[row])[0])
            rows[actuator, self.codes[row, actuator] - LOCKED] = row
        return rows

    @cached_property
    def best_possible(self) -> Array:
        """Upper bound of the relative manipulability over all sets of as many failures, shape (C,).

        sqrt(C(n - i, m) / C(n, m)): the root mean square over all sets of i removed columns of n
        (Ukidve, McInroy and Jafari, 2008). NaN if failures do more than remove columns: in loops
        that constrain the actuators, and with a joint that moves freely.
        """
        n, m = self.codes.shape[1], self.classes.gains.shape[1]
        bound = np.array([best_relative_manipulability(n, m, int(i)) for i in self.failures])
        takes_more = self.are_joints & (self.codes == FREE).any(axis=1)
        bound[takes_more | self.classes.constrained_active[0]] = np.nan
        return bound

    def lost(self, row: int) -> Array:
        """Return the k secondary directions that a condition removes, shape (m2, k)."""
        bases = (self.classes.lost_secondary[k] for k in (row, 0))
        here, healthy = (basis[:, basis.any(axis=0)] for basis in bases)  # without padding
        lost = here - healthy @ (healthy.T @ here)
        U, sigma, _ = np.linalg.svd(lost, full_matrices=False)
        return U[:, sigma > _SAME]

    def classification(self, row: int) -> str:
        """Return the class of the major task in a condition.

        The classes are those of :func:`classify`, "no margin" (the limits leave no speed in some
        major direction), and "nearly lost" (less than `LEAST_LEFT` remains).
        """
        if self.classes.possible[row] and not self.survived[row]:
            return NEARLY_LOST if self._possible[row] else NO_MARGIN
        return classify(self.classes)[row].replace("_", " ")

    def reason(self, row: int) -> str:
        """Return a clause that states why the major task is not possible."""
        otherwise = "the actuators do not reach every major direction"
        return _REASONS.get(self.classification(row), otherwise)


NO_MARGIN, NEARLY_LOST = "no margin", "nearly lost"
_REASONS = {
    "drifts": "it moves although every actuator is stationary",
    NO_MARGIN: "the limits leave no margin in some major direction",
}


def _over_first(values: Array) -> Array:
    with np.errstate(invalid="ignore"):  # infinity over infinity
        return values / values[0] if values[0] else np.full(len(values), np.nan)


_SAME = 1e-6
"""Largest sine of the angle between a lost direction and the span of others that counts as zero."""


def best_relative_manipulability(n: int, m: int, failures: int) -> float:
    """Return sqrt(C(n - i, m) / C(n, m)) for i failures; NaN if n < m."""
    return sqrt(comb(n - failures, m) / comb(n, m)) if n >= m else np.nan


def analyze_conditions(
    system: ConstrainedSystem,
    major: Sequence[int],
    codes: Codes,
    *,
    rates: Limits | None = None,
    torques: Limits | None = None,
    are_joints: bool = True,
    on_progress: OnProgress = lambda done, total: None,
) -> ConditionAnalysis:
    """Analyze failure conditions of a system, including its springs if it has any.

    Args:
        system: The system at one posture.
        major: Task rows of the major task.
        codes: The conditions (C, n), the healthy one first.
        rates: Limits of the rates, (n,) or (C, n), for the worst speed; None: it is not computed.
        torques: Limits of the torques, (n,) or (C, n), for the worst force; None: it is not
            computed.
        are_joints: As in :class:`ConditionAnalysis`.
        on_progress: Function called after each batch with the numbers of analyzed and of all
            conditions.
    """
    different, row_of = codes, np.arange(len(codes))
    if not are_joints:
        different = np.where(codes == FREE, LOCKED, codes)
        if rates is None or rates[0].ndim == 1:  # which failures there are does not matter
            different, row_of = np.unique(different, axis=0, return_inverse=True)
    parts: list[Classes] = []
    step = max(1, _AT_ONCE // codes.shape[1] ** 2)
    for start in range(0, len(different), step):
        part = slice(start, start + step)
        atlas = failure_atlas(
            system,
            list(major),
            codes=different[part],
            rate_limits=_of_part(rates, part),
            torque_limits=_of_part(torques, part),
        )
        parts.append(atlas.elastic or atlas)
        if step < len(different):
            on_progress(min(start + step, len(different)), len(different))
    return ConditionAnalysis(codes, _joined(parts, row_of.ravel()), are_joints)


_AT_ONCE = 200_000
"""Conditions times squared actuators per batch: less than a second, and 100 MB."""


def _of_part(limits: Limits | None, part: slice) -> Limits | None:
    if limits is None or limits[0].ndim < 2:
        return limits
    return limits[0][part], limits[1][part]


def _joined(parts: Sequence[Classes], rows: NDArray[np.intp]) -> Classes:
    """Return the classes of all parts at the given rows, which may repeat."""
    joined: dict[str, Any] = {}
    for field in fields(Classes):
        values = [getattr(part, field.name) for part in parts]
        if values[0] is not None and field.name == "self_motion":  # padded for each part alone
            most = max(basis.shape[2] for basis in values)
            values = [np.pad(b, ((0, 0), (0, 0), (0, most - b.shape[2]))) for b in values]
        joined[field.name] = None if values[0] is None else np.concatenate(values)[rows]
    return Classes(**joined)


_ALONE = 0.995
"""Smallest component of a unit direction from which its description is one row alone."""
_PART = 0.05
"""Smallest component of a unit direction that its description includes."""


def directions_text(basis: Array, rows: Sequence[str]) -> str:
    """Return a description of k directions (m2, k): "y", "0.8 x - 0.6 turn z", or "nothing".

    Rows that are lost completely come first, then one combination for each further direction.
    """
    complete = np.flatnonzero(np.linalg.norm(basis, axis=1) > _ALONE).tolist()
    remainder = basis.copy()
    remainder[complete] = 0.0
    U, sigma, _ = np.linalg.svd(remainder, full_matrices=False)
    labels = [str(rows[k]) for k in complete] + [_combined(u, rows) for u in U[:, sigma > 0.5].T]
    return "; ".join(labels) or "nothing"


def _combined(direction: Array, rows: Sequence[str]) -> str:
    first = np.flatnonzero(np.abs(direction) > _PART).tolist()
    sign = 1.0 if direction[first[0]] > 0 else -1.0
    text = ""
    for k in first:
        value = sign * direction[k]
        between = (" + " if value > 0 else " - ") if text else ("" if value > 0 else "-")
        text += f"{between}{abs(value):.2g} {rows[k]}"
    return text
