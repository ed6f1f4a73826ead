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
        call: Is timed with nothing around it.
        arguments: Makes new ones for each round, of all its calls, which is not timed: nothing kept
            from an earlier round is of use.
        units: Control ticks or mappings in one round.
        rounds: How often it is timed in a turn; one is not warmed up.
    """

    call: Callable[..., Any]
    arguments: Callable[[], Sequence[tuple[Any, ...]]]
    units: int
    rounds: int = 10


def agree(answers: Mapping[str, Array], tolerance: float) -> None:
    """Refuse to time contenders that solve other problems than the first of them, which is ours.

    Args:
        answers: Of each contender to the same N problems, (N, n).
        tolerance: Largest distance from ours, as a fraction of the largest entry of ours.

    Raises:
        ValueError: Names who is further away; NaN is no agreement either.
    """
    ours, *_ = answers.values()
    size = np.abs(ours).max(axis=-1)
    apart = {
        name: float((np.abs(each - ours).max(axis=-1) / size).max())
        for name, each in answers.items()
    }
    if wrong := [f"{who} by {far:.1e}" for who, far in apart.items() if not far <= tolerance]:
        raise ValueError(f"answers differ by more than {tolerance:.0e}: {', '.join(wrong)}")
