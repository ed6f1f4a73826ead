"""Bumpless transfer: one mapping takes over from another without a step in the commands.

The compensators are left alone. What the surviving actuators stand off from the new mapping's own
answer is split: the part that moves the major task becomes a constant, which relieves the
integrators; the rest is secondary motion, and fades out.
"""

from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from argument_checks import Array
from ftc.mapping import Asked, PrioritizedMapping

Pose = TypeVar("Pose")


@dataclass(frozen=True)
class Handover:
    """What one mapping owes to the one before it.

    Attributes:
        pointing_rad: Added for good to what the compensators demand of the major task, shape (m1,).
        rest_m: Secondary displacement in which the old mapping left the actuators, shape (n,).
        age_s: Time since the transfer.
    """

    pointing_rad: Array
    rest_m: Array
    age_s: float

    def faded_m(self, fade_s: float) -> Array:
        """What is left of the secondary displacement, shape (n,): half a cosine over `fade_s`."""
        if self.age_s >= fade_s:
            return np.zeros(len(self.rest_m))
        return 0.5 * (1 + np.cos(np.pi * self.age_s / fade_s)) * self.rest_m


def handover(
    mapping: PrioritizedMapping[Pose],
    asked: Asked,
    sent_m: Array,
    pose: Pose,
    falling_m: Array | None = None,
) -> Handover:
    """What the new mapping owes, so that it goes on from the displacements commanded.

    Args:
        mapping: That takes over.
        asked: What was last demanded of the one before.
        sent_m: Displacements that the actuators hold, shape (n,).
        pose: Estimated by the new mapping.
        falling_m: What each actuator is about to lose of its displacement, shape (n,), because
            it no longer holds it: the others make up at once for its part in the major task.
    """
    own_m = mapping.displacements(asked.pointing_rad, pose, sent_m, asked, asked.rest_m)
    pointing_rad, rest_m = mapping.split(sent_m - own_m, pose)
    if falling_m is not None:
        pointing_rad = pointing_rad + mapping.pointing(falling_m, pose)
    return Handover(pointing_rad, rest_m, age_s=0.0)
