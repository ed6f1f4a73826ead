"""Forward kinematics of a hexapod: from strut lengths to the pose."""

import numpy as np

import argument_checks as check
from argument_checks.ties import greatest
from fjh.rig.hexapod.closed_form import Hexapod
from sim import NOMINAL, Array, Pose

_ROUND_OFF = 16 * np.finfo(float).eps
"""Accepted residual relative to strut lengths and node distances."""
_LONGEST_TURN_RAD = 0.5
_SHORTEST_STEP = 2.0**-8
_LONGEST_M = 1e50


class UnreachableLengths(ValueError):
    """Error that no pose was found with the requested strut lengths.

    Attributes:
        reached: True for the members of the batch that were reached, shape (...).
        residual_m: Largest remaining error of a strut, shape (...) [m].
    """

    def __init__(self, reached: Array, residual_m: Array, target_m: Array) -> None:
        """Create a message on the worst member of a batch (...) of displacements (..., 6)."""
        self.reached, self.residual_m = reached, residual_m
        count = f"{np.sum(~reached)} of {reached.size} sets of " if reached.size > 1 else ""
        worst = greatest(np.where(reached, -1.0, residual_m).ravel())
        super().__init__(
            f"displacements_m: no pose found that reaches {count}strut lengths; the largest error "
            f"of a strut is {residual_m.reshape(-1)[worst]:.3g} m, for displacements of "
            f"{np.round(target_m.reshape(-1, 6)[worst], 9).tolist()} m"
        )


def forward_kinematics(
    geometry: Hexapod, displacements_m: Array, start: Pose = NOMINAL, most_steps: int = 60
) -> Pose:
    """Return the pose at which the struts have given displacements from their nominal lengths.

    Newton's method with the analytic Jacobian solves the whole batch at once; a step that does not
    reduce the error of the lengths is halved. Of the up to forty poses with the same lengths
    (Dietmaier 1998, "The Stewart-Gough platform of general geometry can have 40 real postures") the
    result is the one that Newton's method reaches from `start`; for strokes that are small relative
    to the struts it is the pose of the assembled machine.

    Args:
        geometry: The hexapod.
        displacements_m: Strut displacements, shape (..., 6), [m].
        start: One pose to start from, or a batch of them; the two shapes broadcast.
        most_steps: Largest number of Newton steps; from the nominal pose four are enough for
            strokes of a percent.

    Returns:
        The pose, batch shape (...); strut lengths are exact to 16 eps of their size and of the
        distances of the nodes from the payload origin.

    Raises:
        UnreachableLengths: Newton's method finds no pose for some lengths: none exists, or it is
            beyond a singularity.
    """
    check.instance("geometry", geometry, Hexapod)
    check.integer("most_steps", most_steps)
    target_m, pose = _checked(displacements_m, start)
    nodes_m = np.concatenate([geometry.top_m, geometry.bottom_m])
    farthest_m = float(np.linalg.norm(nodes_m, axis=1).max())
    limit_m = _ROUND_OFF * (geometry.nominal_length_m + np.abs(target_m) + farthest_m).max(-1)
    steps = 0
    while True:
        missing = target_m - geometry.displacements(pose)
        residual_m = np.abs(missing).max(-1)
        if np.all(residual_m <= limit_m):
            return pose
        if steps == most_steps:
            raise UnreachableLengths(residual_m <= limit_m, residual_m, target_m)
        pose = _nearer(geometry, target_m, pose, _newton_step(geometry, pose, missing))
        steps += 1


def _checked(displacements_m: Array, start: Pose) -> tuple[Array, Pose]:
    """Return the arguments broadcast to one batch shape."""
    target_m = check.array("displacements_m", displacements_m, ..., 6)
    rotation, translation_m = check.instance("start", start, Pose).rotation, start.translation_m
    # Beyond this, a step near a singular pose would overflow.
    for name, lengths in (("displacements_m", target_m), ("start.translation_m", translation_m)):
        if (longest := np.abs(lengths).max(initial=0.0)) > _LONGEST_M:
            raise ValueError(f"{name} must be at most {_LONGEST_M:g}, got {longest:g}")
    try:
        shape = np.broadcast_shapes(target_m.shape[:-1], translation_m.shape[:-1])
    except ValueError:
        raise ValueError(
            f"start must have a batch shape that broadcasts with {target_m.shape[:-1]} of "
            f"displacements_m, got {translation_m.shape[:-1]}"
        ) from None
    return np.broadcast_to(target_m, (*shape, 6)), Pose(
        np.broadcast_to(rotation, (*shape, 3, 3)), np.broadcast_to(translation_m, (*shape, 3))
    )


def _newton_step(geometry: Hexapod, pose: Pose, missing_m: Array) -> Array:
    """Return the Newton step as a twist (..., 6), limited to the range of the linearization."""
    # A strut of zero length has no direction: its pose is not changed, and is rejected.
    with np.errstate(invalid="ignore"):
        _, A = geometry.lengths_and_jacobian(pose, singular=True)
    A = np.where(np.isfinite(A).all((-1, -2), keepdims=True), A, 0.0)
    # pinv instead of solve: one singular pose must not stop the others of the batch.
    twist = (np.linalg.pinv(A, rcond=1e-12) @ missing_m[..., None])[..., 0]
    turn = np.linalg.norm(twist[..., :3], axis=-1, keepdims=True)
    return twist * np.minimum(1.0, _LONGEST_TURN_RAD / np.maximum(turn, 1e-300))


def _nearer(geometry: Hexapod, target_m: Array, pose: Pose, twist: Array) -> Pose:
    """Return the pose after the step, halved until the error of the lengths decreases."""

    def distance(at: Pose) -> Array:
        return np.linalg.norm(target_m - geometry.displacements(at), axis=-1)

    here, fraction = distance(pose), np.ones(twist.shape[:-1])
    while True:
        there = pose.moved(fraction[..., None] * twist)
        farther = distance(there) > here
        if not farther.any():
            return there
        fraction = np.where(farther, fraction / 2, fraction)
        fraction[fraction < _SHORTEST_STEP] = 0.0
