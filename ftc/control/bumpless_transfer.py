"""Bumpless transfer: a change of the mapping without a step in the commands.

The compensators are left alone. What the surviving actuators stand off from the new mapping's own
answer is split: the part that moves the major task becomes a constant, which relieves the
integrators; the rest is secondary motion, and fades out. An actuator that is taken out of use keeps
its last command, and loses it slowly: if it should have been sound, nothing jumps.
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
        kept: Commands of the actuators that are out of use, shape (n,).
        carried: Major task that these still cause, shape (m1,): the others take it over.
        keeps: Whether these commands stay; else they fade with the rest.
        age_s: Time since the transfer.
        internal: Displacements that no motion follows, shape (n,); None is none.
    """

    demand: Array
    secondary_reference: Array
    kept: Array
    carried: Array
    keeps: bool
    age_s: float = 0.0
    internal: Array | None = None

    def faded(self, displacements: Array, fade_s: float) -> Array:
        """Displacements (n,) still to be faded out: half a cosine over `fade_s`."""
        if self.age_s >= fade_s:
            return np.zeros(len(displacements))
        return 0.5 * (1 + np.cos(np.pi * self.age_s / fade_s)) * displacements

    def demanded(self, fade_s: float) -> Array:
        """The part of the major task (m1,) that the others are to do beside the compensators'."""
        return self.demand - (self.carried if self.keeps else self.faded(self.carried, fade_s))

    def unfollowed(self, fade_s: float) -> Array:
        """Commands (n,) beside those of the mapping: of actuators out of use, or in no motion."""
        kept = self.kept if self.keeps else self.faded(self.kept, fade_s)
        return kept if self.internal is None else kept + self.faded(self.internal, fade_s)

    def after(self, earlier: "BumplessTransfer", fade_s: float) -> "BumplessTransfer":
        """The transfer combined with the rest of an earlier one.

        Its `kept` and `internal` are parts of the commands, hence have what was left of them.
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
    *,
    keeps: bool,
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
        keeps: Whether actuators that are out of use keep their commands.
    """
    own = mapping.displacements(asked.demand, pose, commanded, asked, asked.secondary_reference)
    demand, secondary_reference, internal = mapping.split(commanded - own, pose)
    kept = np.where(mapping.unused, commanded - asked_besides, 0.0)
    carried = mapping.major_motion(acting * kept, pose)
    demand = demand + carried + mapping.major_motion(lost_displacements, pose)
    return BumplessTransfer(demand, secondary_reference, kept, carried, keeps, internal=internal)
