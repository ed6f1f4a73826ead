"""Whether a path is within reach, by the kinematics of the controller's own model."""

from typing import Any

import numpy as np

from argument_checks.ties import greatest
from experiments.rig.rig import Rig
from experiments.study.study import WrongInput
from sim import Array

_POINTS = 100
"""Of the path that are tried, in its order."""
_STEPS = 4
"""Gauss-Newton steps to each."""
_SHORT = 0.02
"""Of the path's size: as much may be lacking."""


def check_reach(rig: Rig, path: Array) -> None:
    """Refuse a path that the sound robot cannot follow within its limits.

    Raises:
        WrongInput: Where it leaves the reach, and what holds it back.
    """
    mapping = rig.mapping(rig.goal)
    pose, commanded = mapping.nominal, np.zeros(mapping.actuators)
    for tick in np.unique(np.linspace(0, len(path) - 1, _POINTS).astype(int)):
        for _ in range(_STEPS):
            commanded = _nearer(mapping, path[tick], pose, commanded)
            pose = mapping.estimate(commanded, pose)
        lacking = path[tick] - mapping.reached(pose)
        if np.abs(lacking).max() > _SHORT * rig.size:
            row = greatest(np.abs(lacking))
            raise WrongInput(
                f"the path is out of reach at {tick * rig.period_s:.3g} s: row {rig.major[row]} "
                f"stays {np.abs(lacking[row]):.3g} {rig.row_units[row]} short"
                f"{_at_limits(rig, commanded)}; choose a smaller --size, or another start"
            )


def _nearer(mapping: Any, target: Array, pose: Any, commanded: Array) -> Array:
    """Displacements one step nearer to the target."""
    if mapping.limits is None:
        return mapping.displacements(target, pose, commanded)
    return mapping.within_limits(target, pose, commanded=commanded).displacements


def _at_limits(rig: Rig, commanded: Array) -> str:
    """Which actuators are at a limit, in words."""
    if rig.limits is None:
        return ""
    lower, upper = rig.limits
    close = (commanded <= lower + 1e-9) | (commanded >= upper - 1e-9)
    names = [rig.actuators[k] for k in np.flatnonzero(close)]
    return f", with {', '.join(names)} at a limit" if names else ""
