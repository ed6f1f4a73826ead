"""What has failed in a mechanism: section 2.3."""

from collections.abc import Collection, Iterable
from dataclasses import dataclass

from argument_checks import Indices
from prioritized._mechanism.names import Known, chosen, described, spoken


@dataclass(frozen=True)
class Failures:
    """What has failed.

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
        """These and further failures; a later lock overrides free."""
        now_locked = self.locked | locked
        return Failures(
            now_locked, (self.free | free) - now_locked, self.locked_passive | locked_passive
        )

    def in_words(self, actuators: Known, velocities: Known) -> str:
        """The failures by name: "knee locked, hip free", or "sound"."""
        words = [
            *described("actuator", actuators, self.locked, "locked"),
            *described("actuator", actuators, self.free, "free"),
            *described("velocity", velocities, self.locked_passive, "stuck"),
        ]
        return ", ".join(words) or "sound"


def failed_actuators(
    locked: Iterable[int | str],
    free: Iterable[int | str],
    known: Known,
    passive: Collection[str] = (),
) -> tuple[frozenset[int], frozenset[int]]:
    """Locked and free actuators by number, checked; none may be in both sets."""
    lock = chosen("locked", locked, known, several=False, passive=passive)
    release = chosen("free", free, known, several=False, passive=passive)
    if both := sorted(lock & release):
        raise ValueError(
            f"an actuator is either locked or free, got both for {spoken(known, both)}"
        )
    return lock, release


def stuck_passive(
    locked_passive: Iterable[int | str], known: Known, active: Indices
) -> frozenset[int]:
    """Passive velocities that are stuck, by index, checked; none may be active."""
    stuck = chosen("locked_passive", locked_passive, known, several=True)
    if actuated := sorted(stuck & set(active.tolist())):
        raise ValueError(
            "locked_passive must name passive velocities, got the actuated "
            f"{spoken(known, actuated)}: put their actuators in locked"
        )
    return stuck
