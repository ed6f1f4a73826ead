"""Conversion of failure conditions between codes, letters, text and lists of names."""

from collections.abc import Iterable, Sequence
from itertools import combinations, product
from math import comb
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from sim import Failure
from sim.plant import FailureKind

HEALTHY, LOCKED, FREE, LOOSE = 0, 1, 2, 3
"""Codes of an actuator's state; the first three are those of :class:`prioritized.FailureAtlas`."""

CODE_LETTERS = "SLFB"
"""Letters of the codes 0 to 3 in files and on command lines."""

Name = TypeVar("Name", str, int)

Codes = NDArray[np.int8]
"""Codes of C conditions of n actuators, 0 healthy, 1 locked, 2 free, shape (C, n)."""

KINDS: dict[int, FailureKind] = {LOCKED: "locked", FREE: "free"}
"""Kinds of failure in an atlas, by code."""
_KINDS: dict[int, FailureKind] = {**KINDS, LOOSE: "loose"}


def with_failures(n: int, count: int) -> Codes:
    """Return all C(n, count) 2^count conditions of n actuators with exactly `count` failures.

    The sets of failed actuators are in the actuators' order; for each set locked comes before free.
    """
    every = np.full((comb(n, count), len(KINDS) ** count, n), HEALTHY, dtype=np.int8)
    kinds = np.array(list(product(KINDS, repeat=count)), dtype=np.int8)
    for conditions, failed in zip(every, combinations(range(n), count), strict=True):
        conditions[:, failed] = kinds
    return every.reshape(-1, n)


def few_failures(n: int, most: int = 2) -> Codes:
    """Return the healthy condition, then all with one failure, and so on up to `most`."""
    return np.vstack([with_failures(n, count) for count in range(min(most, n) + 1)])


def every_condition(n: int) -> tuple[str, ...]:
    """Return all 3^n conditions of n actuators in letters, in the order of a failure atlas."""
    return tuple(map("".join, product(CODE_LETTERS[: FREE + 1], repeat=n)))


def codes_of(condition: str) -> tuple[int, ...]:
    """Return the code of each actuator from its letter."""
    return tuple(CODE_LETTERS.index(letter) for letter in condition)


def failures_of(condition: str, time_s: float = 0.0) -> tuple[Failure, ...]:
    """Return the failures of a condition in letters at a time [s], in order of the actuators."""
    codes = enumerate(codes_of(condition))
    return tuple(Failure(k, _KINDS[code], time_s) for k, code in codes if code != HEALTHY)


def failed(condition: Iterable[int], names: Iterable[Name], kind: int) -> list[Name]:
    """Return the names (or numbers) of the actuators whose code is `kind`."""
    return [name for name, code in zip(names, condition, strict=True) if code == kind]


def condition_text(condition: Sequence[int] | NDArray[np.int8], names: Sequence[str]) -> str:
    """Return a condition as text: "knee locked, hip and ankle free", or "healthy"."""
    parts = ((failed(condition, names, kind), word) for kind, word in _KINDS.items())
    return ", ".join(f"{listed(some)} {word}" for some, word in parts if some) or "healthy"


def listed(names: Sequence[str], joined: str = "and", most: int = 6) -> str:
    """Return names joined as in a sentence, after the first few only the number of the others."""
    if len(names) > most:
        return f"{', '.join(names[: most - 1])} {joined} {len(names) - most + 1} more"
    return f" {joined} ".join(filter(None, (", ".join(names[:-1]), *names[-1:])))


def counted(number: int, noun: str) -> str:
    """Return a number with its noun: "1 actuator", "1,683 actuators"."""
    return f"{number:,} {noun}{'' if number == 1 else 's'}"
