"""Failed actuators and stuck joints of a mechanism, section 2.3."""

from collections.abc import Collection, Iterable
from dataclasses import dataclass

from argument_checks import Indices
from prioritized._mechanism.names import Aliases, failure_phrases, joined_names, resolved_numbers


@dataclass(frozen=True)
class Failures:
    """Failed actuators and stuck passive joints of a mechanism.

    Attributes:
        locked: Actuators with a position failure, 0..n-1.
        free: Actuators with a torque failure, 0..n-1.
        locked_passive: Velocity indices of passive joints that are stuck.
    """

    locked: frozenset[int] = frozenset()
    free: frozenset[int] = frozenset()
    locked_passive: frozenset[int] = frozenset()

    def and_also(
        self, locked: frozenset[int], free: frozenset[int], locked_passive: frozenset[int]
    ) -> "Failures":
        """Return the union with further failures; a later lock overrides free."""
        now_locked = self.locked | locked
        now_stuck = self.locked_passive | locked_passive
        return Failures(now_locked, (self.free | free) - now_locked, now_stuck)

    def describe(self, actuators: Aliases, velocities: Aliases) -> str:
        """Return the failures as text: "knee locked, hip free", or "healthy"."""
        phrases = [
            *failure_phrases("actuator", actuators, self.locked, "locked"),
            *failure_phrases("actuator", actuators, self.free, "free"),
            *failure_phrases("velocity", velocities, self.locked_passive, "stuck"),
        ]
        return ", ".join(phrases) or "healthy"


def failed_actuators(
    locked: Iterable[int | str],
    free: Iterable[int | str],
    aliases: Aliases,
    passive: Collection[str] = (),
) -> tuple[frozenset[int], frozenset[int]]:
    """Resolve locked and free actuators to numbers and check that no actuator is in both sets."""
    lock = resolved_numbers("locked", locked, aliases, several=False, passive=passive)
    release = resolved_numbers("free", free, aliases, several=False, passive=passive)
    if both := sorted(lock & release):
        raise ValueError(
            f"an actuator is either locked or free, got both for {joined_names(aliases, both)}"
        )
    return lock, release


def stuck_passive(
    locked_passive: Iterable[int | str], aliases: Aliases, active: Indices
) -> frozenset[int]:
    """Resolve stuck passive velocities to indices and check that none is active."""
    stuck = resolved_numbers("locked_passive", locked_passive, aliases, several=True)
    if actuated := sorted(stuck & set(active.tolist())):
        raise ValueError(
            "locked_passive must name passive velocities, got the actuated "
            f"{joined_names(aliases, actuated)}: put their actuators in locked"
        )
    return stuck
