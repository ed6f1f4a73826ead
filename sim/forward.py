"""Forward kinematics of a hexapod: from strut lengths to the pose."""

import numpy as np

from sim.array import Array
from sim.hexapod import NOMINAL, Hexapod, Pose

_ROUND_OFF = 16 * np.finfo(float).eps
"""Residual at which the struts have the lengths asked for, relative to the longest strut."""
_LONGEST_TURN_RAD = 0.5
_SHORTEST_STEP = 2.0**-8


class UnreachableLengths(ValueError):
    """No pose was found that gives the struts these lengths.

    Attributes:
        reached: Which of the batch were, shape (...).
        residual_m: How far off the longest-off strut stays at the best pose found, shape (...).
    """

    def __init__(self, reached: Array, residual_m: Array, asked_m: Array) -> None:
        """Speak of the worst of the batch, whose displacements `asked_m` (6,) were asked for."""
        self.reached, self.residual_m = reached, residual_m
        count = f"{np.sum(~reached)} of {reached.size} sets of " if reached.size > 1 else ""
        super().__init__(
            f"displacements_m: no pose reaches {count}strut lengths; at the nearest found a strut "
            f"is still off by {residual_m.max():.3g} m, asked for {np.round(asked_m, 9).tolist()}"
        )


def forward_kinematics(
    geometry: Hexapod, displacements_m: Array, start: Pose = NOMINAL, most_steps: int = 60
) -> Pose:
    """The pose at which the struts have the given displacements from their nominal lengths.

    Newton's method with the analytic Jacobian, the whole batch at once: near the solution the
    error is squared at every step. Far from it a step that does not bring the lengths nearer is
    halved. Of the up to forty poses that share a set of lengths (Dietmaier 1998, "The
    Stewart-Gough platform of general geometry can have 40 real postures") it is the one that
    Newton's method reaches from `start`; for strokes that are small beside the struts, the one
    that the assembled machine moves to.

    Args:
        geometry: The hexapod.
        displacements_m: Shape (..., 6), [m].
        start: One pose to start from, or a batch of the same shape (...).
        most_steps: Newton steps; from the nominal pose four are enough for strokes of a percent.

    Returns:
        The pose, batch shape (...); each strut is right to round-off, 16 eps of the longest.

    Raises:
        ValueError: `displacements_m` has another shape or is not finite.
        UnreachableLengths: Some lengths belong to no pose, or to one beyond a singularity.
    """
    asked = np.asarray(displacements_m, dtype=float)
    if asked.shape[-1:] != (6,) or not np.isfinite(asked).all():
        raise ValueError(f"displacements_m must be finite, shape (..., 6), got {displacements_m}")
    pose = start.moved(np.zeros(asked.shape))
    limit_m = _ROUND_OFF * (geometry.nominal_length_m + asked).max(initial=0.0)
    for _ in range(most_steps):
        missing = asked - geometry.displacements(pose)
        if not (worst := np.abs(missing).max(-1)).max(initial=0.0) > limit_m:
            return pose
        pose = _nearer(geometry, asked, pose, _newton_step(geometry, pose, missing))
    worst = np.abs(asked - geometry.displacements(pose)).max(-1)
    if worst.max() > limit_m:
        raise UnreachableLengths(worst <= limit_m, worst, asked.reshape(-1, 6)[worst.argmax()])
    return pose


def _newton_step(geometry: Hexapod, pose: Pose, missing_m: Array) -> Array:
    """Twist (..., 6) that the linearized struts ask for, no longer than one can trust it."""
    A = geometry.inverse_jacobian(pose)
    # pinv where solve would do: a singular pose in a batch must not end the others.
    twist = (np.linalg.pinv(A, rcond=1e-12) @ missing_m[..., None])[..., 0]
    turn = np.linalg.norm(twist[..., :3], axis=-1, keepdims=True)
    return twist * np.minimum(1.0, _LONGEST_TURN_RAD / np.maximum(turn, 1e-300))


def _nearer(geometry: Hexapod, asked_m: Array, pose: Pose, twist: Array) -> Pose:
    """The pose after the step; halved, where need be, until the lengths come nearer."""

    def distance(at: Pose) -> Array:
        return np.linalg.norm(asked_m - geometry.displacements(at), axis=-1)

    here, fraction = distance(pose), np.ones(twist.shape[:-1])
    while True:
        there = pose.moved(fraction[..., None] * twist)
        farther = distance(there) > here
        if not farther.any():
            return there
        fraction = np.where(farther, fraction / 2, fraction)
        fraction[fraction < _SHORTEST_STEP] = 0.0
