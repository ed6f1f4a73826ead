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
        secondary_reference_m: Secondary displacement in which the old mapping left the actuators,
            shape (n,).
        age_s: Time since the transfer.
        internal_m: Displacements that no motion follows, shape (n,); None is none.
    """

    demand: Array
    secondary_reference_m: Array
    age_s: float
    internal_m: Array | None = None

    def faded(self, displacements_m: Array, fade_s: float) -> Array:
        """Displacements (n,) still to be faded out: half a cosine over `fade_s`."""
        if self.age_s >= fade_s:
            return np.zeros(len(displacements_m))
        return 0.5 * (1 + np.cos(np.pi * self.age_s / fade_s)) * displacements_m

    def after(self, earlier: "BumplessTransfer", fade_s: float) -> "BumplessTransfer":
        """The transfer combined with the rest of an earlier one."""
        internal_m = self.internal_m
        if earlier.internal_m is not None:
            left = earlier.faded(earlier.internal_m, fade_s)
            internal_m = left if internal_m is None else left + internal_m
        return BumplessTransfer(
            earlier.demand + self.demand,
            earlier.faded(earlier.secondary_reference_m, fade_s) + self.secondary_reference_m,
            self.age_s,
            internal_m,
        )


def bumpless_transfer(
    mapping: PrioritizedMapping[Pose],
    asked: PreviousCommand,
    commanded_m: Array,
    pose: Pose,
    lost_displacement_m: Array | None = None,
) -> BumplessTransfer:
    """The offsets with which the new mapping continues from the displacements commanded.

    Args:
        mapping: That takes over.
        asked: What was last demanded of the one before.
        commanded_m: Displacements that the actuators hold, shape (n,).
        pose: Estimated by the new mapping.
        lost_displacement_m: What each actuator is about to lose of its displacement, shape (n,),
            because it no longer holds it: the others make up at once for its part in the major
            task.
    """
    own_m = mapping.displacements(
        asked.demand, pose, commanded_m, asked, asked.secondary_reference_m
    )
    demand, secondary_reference_m, internal_m = mapping.split(commanded_m - own_m, pose)
    if lost_displacement_m is not None:
        demand = demand + mapping.pointing(lost_displacement_m, pose)
    return BumplessTransfer(demand, secondary_reference_m, 0.0, internal_m)
