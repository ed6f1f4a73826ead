"""Failure conditions as a letter for each actuator: all of them, their failures, and in words."""

import itertools

from sim import Failure, FailureKind

STATES: dict[str, FailureKind | None] = {"S": None, "L": "locked", "F": "free", "B": "loose"}
"""A letter for each state of an actuator, and the failure that it stands for."""

OF_ATLAS = "SLF"
"""The letters that a :class:`prioritized.FailureAtlas` knows, in the order of its codes."""


def conditions(actuators: int) -> tuple[str, ...]:
    """All 3^n conditions of so many actuators, in the order of a failure atlas."""
    return tuple(map("".join, itertools.product(OF_ATLAS, repeat=actuators)))


def failed(condition: str, kind: FailureKind) -> list[int]:
    """Actuators 0..n-1 that a condition says have failed so."""
    return [k for k, letter in enumerate(condition) if STATES[letter] == kind]


def failures(condition: str, time_s: float = 0.0) -> tuple[Failure, ...]:
    """What happens to a plant at that time, in the order of the actuators."""
    return tuple(
        Failure(k, kind, time_s)
        for k, letter in enumerate(condition)
        if (kind := STATES[letter]) is not None
    )


def in_words(condition: str) -> str:
    """A condition for people, actuators 1..n; a run of three or more by its ends."""
    words = []
    for kind in filter(None, STATES.values()):
        numbers = [k + 1 for k in failed(condition, kind)]
        if len(numbers) > 2 and numbers[-1] - numbers[0] == len(numbers) - 1:
            words.append(f"{kind} {numbers[0]}-{numbers[-1]}")
        elif numbers:
            words.append(f"{kind} {', '.join(map(str, numbers))}")
    return "; ".join(words) or "sound"
