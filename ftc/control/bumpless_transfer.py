"""Bumpless transfer: a change of the mapping without a step in the commands.

The compensators are left alone. What the surviving actuators stand off from the new mapping's own
answer is split: the part that moves the major task becomes a constant, which relieves the
integrators; the rest is secondary motion, and fades out. An actuator that is taken out of use loses
its command slowly: if it should have been sound, or works again, nothing jumps. One that stands
keeps it, and one that the others take along is commanded where they take it, for the same reason.
"""

from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from argument_checks import Array
from ftc.control.local_mapping import PreviousCommand
from ftc.control.mapping import PrioritizedMapping

Pose = TypeVar("Pose")


@dataclass(frozen=True)
class BumplessTransfer:
    """Offsets that remain after a change of the mapping.

    Attributes:
        demand: Added for good to what the compensators demand of the major task, shape (m1,).
        secondary_reference: Secondary displacement in which the old mapping left the actuators,
            shape (n,).
        kept: Commands of actuators out of use that they keep, shape (n,).
        left: Those that fade with the rest, beside where the others take them, shape (n,).
        carried: Major task that these still cause, shape (m1,): the others take it over.
        age_s: Time since the transfer.
        internal: Displacements that no motion follows, shape (n,); None is none.
    """

    demand: Array
    secondary_reference: Array
    kept: Array
    left: Array
    carried: Array
    age_s: float = 0.0
    internal: Array | None = None

    def faded(self, displacements: Array, fade_s: float) -> Array:
        """Displacements (n,) still to be faded out: half a cosine over `fade_s`."""
        if self.age_s >= fade_s:
            return np.zeros(len(displacements))
        return 0.5 * (1 + np.cos(np.pi * self.age_s / fade_s)) * displacements

    def demanded(self, fade_s: float) -> Array:
        """The part of the major task (m1,) that the others are to do beside the compensators'."""
        return self.demand - self.faded(self.carried, fade_s)

    def unfollowed(self, fade_s: float) -> Array:
        """Commands (n,) beside those of the mapping: of actuators out of use, or in no motion."""
        fades = self.left if self.internal is None else self.left + self.internal
        return self.kept + self.faded(fades, fade_s)

    def after(self, earlier: "BumplessTransfer", fade_s: float) -> "BumplessTransfer":
        """The transfer combined with the rest of an earlier one.

        Its `kept`, `left` and `internal` are parts of the commands, hence what is left of them.
        """
        secondary = earlier.faded(earlier.secondary_reference, fade_s)
        return replace(
            self,
            demand=earlier.demanded(fade_s) + self.demand,
            secondary_reference=secondary + self.secondary_reference,
        )


def bumpless_transfer(
    mapping: PrioritizedMapping[Pose],
    asked: PreviousCommand,
    commanded: Array,
    pose: Pose,
    lost_displacements: Array,
    acting: Array,
    asked_besides: Array,
    keeps: Array,
) -> BumplessTransfer:
    """The offsets with which the new mapping continues from the displacements commanded.

    Args:
        mapping: That takes over.
        asked: What was last demanded of the one before.
        commanded: Displacements that the actuators hold, shape (n,).
        pose: Estimated by the new mapping.
        lost_displacements: What each actuator is about to lose of its displacement, shape (n,),
            because it no longer holds it: the others make up at once for its part in the major
            task.
        acting: Part of its command that each actuator still follows once it is out of use, (n,).
        asked_besides: What actuators out of use will be commanded besides, shape (n,).
        keeps: Which actuators keep their commands if they are out of use, 0 or 1 each, shape (n,).
    """
    own = mapping.displacements(asked.demand, pose, commanded, asked, asked.secondary_reference)
    demand, secondary_reference, internal = mapping.split(commanded - own, pose)
    unused, followed = commanded - asked_besides, mapping.followed(commanded)
    unused = np.where(mapping.unused, unused if followed is None else unused - followed, 0.0)
    kept, left = keeps * unused, (1 - keeps) * unused
    carried = mapping.major_motion(acting * left, pose)
    demand = demand + carried + mapping.major_motion(lost_displacements, pose)
    return BumplessTransfer(demand, secondary_reference, kept, left, carried, internal=internal)
