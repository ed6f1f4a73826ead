"""Candidates, of this and other libraries, for one question: checked to agree, then timed."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sim import Array


@dataclass(frozen=True)
class Candidate:
    """Candidate: a function to be timed, with its arguments.

    Attributes:
        call: Function that is timed.
        arguments: Function that makes the arguments of all calls of a round, outside the timed
            part; they are new in each round, so that cached results are of no use.
        units: Number of control ticks or mappings in one round.
        rounds: Number of timed rounds in a turn; if it is 1 there is no warm-up round.
    """

    call: Callable[..., Any]
    arguments: Callable[[], Sequence[tuple[Any, ...]]]
    units: int
    rounds: int = 10


def check_agreement(solutions: Mapping[str, Array], tolerance: float) -> None:
    """Check that all candidates find the same solutions as the first one.

    Args:
        solutions: Solutions of the same N problems by each candidate, (N, n).
        tolerance: Largest distance from these, as a fraction of the largest entry of the first.

    Raises:
        ValueError: A candidate differs by more, or has NaN; the message names it.
    """
    reference, *_ = solutions.values()
    size = np.abs(reference).max(axis=-1)
    distances = {
        name: float((np.abs(rates - reference).max(axis=-1) / size).max())
        for name, rates in solutions.items()
    }
    far = {name: distance for name, distance in distances.items() if not distance <= tolerance}
    if far:
        text = ", ".join(f"{name} by {distance:.1e}" for name, distance in far.items())
        raise ValueError(f"solutions differ by more than {tolerance:.0e}: {text}")
