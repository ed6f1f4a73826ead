"""Serial mechanisms of five joints and four task rows, two of them major."""

from typing import Any

import numpy as np

from ftc import Goal, LocalGeometry, PrioritizedMapping
from prioritized import ConstrainedSystem

MAJOR, SECONDARY = [0, 1], [2, 3]


def serial(seed: int, n: int = 5) -> LocalGeometry:
    """Return a serial mechanism with a random Jacobian."""
    J = np.random.default_rng(seed).normal(size=(4, n))
    return LocalGeometry(ConstrainedSystem(J, None, np.arange(n)))


def limited(own: LocalGeometry, half: float | None = 0.5, **options: Any) -> Any:
    """Return a mapping of the mechanism with displacements limited to +-`half`."""
    n = len(own.system.active)
    goal = options.pop("goal", Goal(joint_weight=(1.0,) * n))
    box = None if half is None else (np.full(n, -half), np.full(n, half))
    return PrioritizedMapping(own, goal, MAJOR, SECONDARY, limits=box, **options)
