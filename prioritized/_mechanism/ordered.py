"""Levels of rows in lexicographic order, and their rank decisions."""

from collections.abc import Sequence
from itertools import accumulate
from math import hypot
from typing import NamedTuple

import numpy as np

from argument_checks import Array
from prioritized._mechanism.decisions import separating_scale
from prioritized._mechanism.task_motion import Step, TaskMotion
from prioritized._solver.arrays import read_only
from prioritized._solver.rank import NOTHING, norm, singular_values


class LevelRows(NamedTuple):
    """Rows S J + R of levels, one after the other, for J at any pose.

    Attributes:
        on_task: S, shape (k, m).
        on_rates: R, shape (k, n).
        ends: Where each level ends.
        norms: Norms of S and of R of each level.
        first: S of the first level, without zero rows.
        rates_last: Whether no level but the last has rows on rates.
    """

    on_task: Array
    on_rates: Array
    ends: tuple[int, ...]
    norms: tuple[tuple[float, float], ...]
    first: Array
    rates_last: bool

    @classmethod
    def of(cls, levels: Sequence[tuple[Array, Array]]) -> "LevelRows":
        """Assemble S (k, m) and R (k, n) of each level."""
        on_task, on_rates = zip(*levels, strict=True)
        first = on_task[0]
        return cls(
            read_only(np.concatenate(on_task)),
            read_only(np.concatenate(on_rates)),
            tuple(accumulate(map(len, on_task))),
            tuple((norm(S), norm(R)) for S, R in levels),
            read_only(first[first.any(axis=1)]),
            not any(R.any() for R in on_rates[:-1]),
        )

    def split(self, rows: Array) -> list[Array]:
        """Split rows of all levels by level."""
        starts = (0, *self.ends[:-1])
        return [rows[first:end] for first, end in zip(starts, self.ends, strict=True)]

    def at(self, J: Array, scale: float) -> list[tuple[Array, float]]:
        """Return rows and size of each level for J (m, n), whose terms have this size."""
        rows = self.split(read_only(self.on_task.dot(J) + self.on_rates))
        sizes = [hypot(task * scale, rates) for task, rates in self.norms]
        return list(zip(rows, sizes, strict=True))


def in_order(
    task: TaskMotion, levels: LevelRows, rows: list[tuple[Array, float]]
) -> list[tuple[Array, float]]:
    """Return the levels of one condition without directions of rank zero in the remaining motion.

    `rows` are A (k, n) of each level on the rates, and the size of their terms.
    """
    remaining, result = task.start, []
    parts = zip(levels.split(levels.on_task), levels.split(levels.on_rates), rows, strict=True)
    for S, R, (A, scale) in parts:
        # Normalized, so that the weights of rows do not affect the rank.
        weights = np.maximum(np.linalg.norm(np.hstack([S, R]), axis=1), NOTHING)[:, None]
        step, on_rates = task.step(S / weights), R / weights
        all_rows = Step(step.A + on_rates, step.scale + norm(on_rates), step.error)
        decision, next_remaining = remaining.then(task, all_rows)
        if (negligible := remaining.negligible(decision, A / weights)) is not None:
            A = read_only(A - weights * negligible)
        sigma = singular_values(A @ remaining.free)
        result.append((A, float(separating_scale(scale, 1.0, sigma, decision.rank))))
        remaining = next_remaining
    return result
