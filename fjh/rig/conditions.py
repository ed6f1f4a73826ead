"""Failure conditions of actuators as codes, a letter each, in words, and as lists of names."""

from collections.abc import Iterable, Sequence
from itertools import combinations, product
from math import comb
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from sim import Failure
from sim.plant import FailureKind

SOUND, LOCKED, FREE, LOOSE = 0, 1, 2, 3
"""Codes of actuators; the first three as in :class:`prioritized.FailureAtlas`."""

LETTERS = "SLFB"
"""Of each code, as files and command lines have it."""

Name = TypeVar("Name", str, int)

Codes = NDArray[np.int8]
"""Of C conditions of n actuators, 0 sound, 1 locked, 2 free, shape (C, n)."""

KINDS: dict[int, FailureKind] = {LOCKED: "locked", FREE: "free"}
"""Failures that an atlas knows."""
_KINDS: dict[int, FailureKind] = {**KINDS, LOOSE: "loose"}


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


def every_condition(n: int) -> tuple[str, ...]:
    """All 3^n conditions of n actuators in letters, in the order of a failure atlas."""
    return tuple(map("".join, product(LETTERS[: FREE + 1], repeat=n)))


def codes_of(letters: str) -> tuple[int, ...]:
    """The code of each actuator, from its letter."""
    return tuple(LETTERS.index(letter) for letter in letters)


def failures_of(letters: str, time_s: float = 0.0) -> tuple[Failure, ...]:
    """What happens to a plant at a time, in the order of the actuators."""
    codes = enumerate(codes_of(letters))
    return tuple(Failure(k, _KINDS[code], time_s) for k, code in codes if code != SOUND)


def failed(condition: Iterable[int], names: Iterable[Name], kind: int) -> list[Name]:
    """Names, or numbers, of the actuators that failed so."""
    return [name for name, code in zip(names, condition, strict=True) if code == kind]


def in_words(condition: Sequence[int] | NDArray[np.int8], names: Sequence[str]) -> str:
    """A condition for people: "knee locked, hip and ankle free", or "sound"."""
    parts = []
    for kind, word in _KINDS.items():
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
