"""Contenders on one question: they agree first, then each is timed."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sim import Array


@dataclass(frozen=True)
class Contender:
    """Something to be timed.

    Attributes:
        name: Of its times.
        call: Is timed with nothing around it.
        arguments: Makes new ones for each round, which is not timed: nothing kept from an earlier
            call is of use.
        units: Control ticks or mappings in one call.
        rounds: How often it is timed in a turn.
    """

    name: str
    call: Callable[..., Any]
    arguments: Callable[[], Sequence[tuple[Any, ...]]] = lambda: [()]
    units: int = 1
    rounds: int = 20


@dataclass(frozen=True)
class Question:
    """Contenders, and their answers to the same problems.

    Attributes:
        contenders: By name.
        apart: Of each that answers, the largest distance of its answers from what all agree on, as
            a fraction of it.
        tolerance: Largest distance that counts as agreement.
    """

    contenders: Mapping[str, Contender]
    apart: Mapping[str, float]
    tolerance: float = 0.0

    def check(self) -> None:
        """Raise a ValueError that names who solves another problem; NaN is no agreement either."""
        wrong = {name: d for name, d in self.apart.items() if not d <= self.tolerance}
        if wrong:
            who = ", ".join(f"{name} by {distance:.1e}" for name, distance in wrong.items())
            raise ValueError(f"answers differ by more than {self.tolerance:.0e}: {who}")


def question(
    contenders: Sequence[Contender], answers: Mapping[str, Array], tolerance: float
) -> Question:
    """A question whose answers, (N, n) each, are compared with the median of all.

    With three contenders or more, one that is wrong does not move the median.
    """
    middle = np.median(list(answers.values()), axis=0)
    size = np.abs(middle).max(axis=-1)
    apart = {
        name: float((np.abs(each - middle).max(axis=-1) / size).max())
        for name, each in answers.items()
    }
    return Question({each.name: each for each in contenders}, apart, tolerance)
