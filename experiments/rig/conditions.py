"""Failure conditions of actuators as codes, in words, and as lists of names."""

from collections.abc import Iterable, Sequence
from itertools import combinations, product
from math import comb

import numpy as np
from numpy.typing import NDArray

SOUND, LOCKED, FREE = 0, 1, 2
"""As in :class:`prioritized.FailureAtlas`."""

Codes = NDArray[np.int8]
"""Of C conditions of n actuators, 0 sound, 1 locked, 2 free, shape (C, n)."""

KINDS = {LOCKED: "locked", FREE: "free"}


def with_failures(n: int, count: int) -> Codes:
    """All conditions with exactly so many failures, C(n, count) 2^count of them.

    In the order of the actuators; of one set of them locked comes before free.
    """
    found = np.full((comb(n, count), len(KINDS) ** count, n), SOUND, dtype=np.int8)
    kinds = np.array(list(product(KINDS, repeat=count)), dtype=np.int8)
    for conditions, failed in zip(found, combinations(range(n), count), strict=True):
        conditions[:, failed] = kinds
    return found.reshape(-1, n)


def few_failures(n: int, most: int = 2) -> Codes:
    """The sound condition, then all with one failure, and so on up to so many."""
    return np.vstack([with_failures(n, count) for count in range(min(most, n) + 1)])


def failed(condition: Iterable[int], names: Sequence[str], kind: int) -> list[str]:
    """Names of the actuators that failed so."""
    return [name for name, code in zip(names, condition, strict=True) if code == kind]


def in_words(condition: Sequence[int] | NDArray[np.int8], names: Sequence[str]) -> str:
    """A condition for people: "knee locked, hip and ankle free", or "sound"."""
    parts = []
    for kind, word in KINDS.items():
        if some := failed(condition, names, kind):
            parts.append(f"{listed(some)} {word}")
    return ", ".join(parts) or "sound"


def listed(names: Sequence[str], joined: str = "and", most: int = 6) -> str:
    """Names in a sentence; of many the first, and how many more there are."""
    if len(names) > most:
        return f"{', '.join(names[: most - 1])} {joined} {len(names) - most + 1} more"
    return f" {joined} ".join(filter(None, (", ".join(names[:-1]), *names[-1:])))


def counted(number: int, noun: str) -> str:
    """A number with its noun: "1 actuator", "1,683 actuators"."""
    return f"{number:,} {noun}{'' if number == 1 else 's'}"
