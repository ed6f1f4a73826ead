"""What is broken: locked and free actuators, stuck passive joints."""

from collections.abc import Iterable
from dataclasses import dataclass

import argument_checks as check


@dataclass(frozen=True)
class Failures:
    """What is broken.

    Attributes:
        locked: Actuators with a position failure, 0..n-1.
        free: Actuators with a torque failure, 0..n-1.
        locked_passive: Velocity indices of passive joints that are stuck.
    """

    locked: frozenset[int] = frozenset()
    free: frozenset[int] = frozenset()
    locked_passive: frozenset[int] = frozenset()


def lock_and_release(
    locked: Iterable[int], free: Iterable[int], n: int
) -> tuple[frozenset[int], frozenset[int]]:
    """Failed actuators of range(n), none of them in both sets."""
    lock, release = check.index_set("locked", locked, n), check.index_set("free", free, n)
    if both := sorted(lock & release):
        raise ValueError(f"an actuator is either locked or free, got both for {both}")
    return lock, release
