"""Bumpless transfer: a change of the mapping without a step in the commands.

The compensators are left alone. What the surviving actuators stand off from the new mapping's own
answer is split: the part that moves the major task becomes a constant, which relieves the
integrators; the rest is secondary motion, and fades out.
"""

from dataclasses import dataclass
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
        age_s: Time since the transfer.
        internal: Displacements that no motion follows, shape (n,); None is none.
    """

    demand: Array
    secondary_reference: Array
    age_s: float
    internal: Array | None = None

    def faded(self, displacements: Array, fade_s: float) -> Array:
        """Displacements (n,) still to be faded out: half a cosine over `fade_s`."""
        if self.age_s >= fade_s:
            return np.zeros(len(displacements))
        return 0.5 * (1 + np.cos(np.pi * self.age_s / fade_s)) * displacements

    def after(self, earlier: "BumplessTransfer", fade_s: float) -> "BumplessTransfer":
        """The transfer combined with the rest of an earlier one."""
        internal = self.internal
        if earlier.internal is not None:
            left = earlier.faded(earlier.internal, fade_s)
            internal = left if internal is None else left + internal
        return BumplessTransfer(
            earlier.demand + self.demand,
            earlier.faded(earlier.secondary_reference, fade_s) + self.secondary_reference,
            self.age_s,
            internal,
        )


def bumpless_transfer(
    mapping: PrioritizedMapping[Pose],
    asked: PreviousCommand,
    commanded: Array,
    pose: Pose,
    lost_displacements: Array | None = None,
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
    """
    own = mapping.displacements(asked.demand, pose, commanded, asked, asked.secondary_reference)
    demand, secondary_reference, internal = mapping.split(commanded - own, pose)
    if lost_displacements is not None:
        demand = demand + mapping.major_motion(lost_displacements, pose)
    return BumplessTransfer(demand, secondary_reference, 0.0, internal)
