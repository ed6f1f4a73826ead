"""How far each strategy misses demands that no displacement within the limits can meet."""

from collections.abc import Collection
from typing import Any

import numpy as np

from experiments.limits.allocation import UNLIMITED, AllocatedMapping, Strategy
from experiments.limits.measures import room
from experiments.limits.runs import HEAVE_M, RADIUS_RAD, Case, attainable, limits_of
from experiments.rig.hexapod.testbed import Testbed
from sim import NOMINAL, Array, hexapod

COUNT = 300
"""Demands in each condition."""
FARTHEST_RAD = 2.5 * RADIUS_RAD
LEAST_RAD = 0.1e-3
"""From this least error on a demand counts as out of reach."""


def excesses(testbed: Testbed, cases: Collection[Case], seed: int) -> list[dict[str, Any]]:
    """Errors over the least possible [%], for each strategy, in all conditions together.

    The least is the distance from the outline of what is attainable: geometry, no optimization.
    """
    conditions = {case.condition: case for case in cases}.values()
    found: dict[Strategy, list[Array]] = {}
    for case in conditions:
        demands, least = _demands(testbed, case, seed)
        for strategy in dict.fromkeys(case.strategy for case in cases):
            if strategy.slowness == 1.0 and strategy != UNLIMITED:
                missed = _missed(testbed, case, strategy, demands)
                found.setdefault(strategy, []).append(100 * (missed / least - 1.0))
    return [
        {
            "strategy": strategy.name,
            "excess_median_percent": float(np.median(np.concatenate(parts))),
            "excess_largest_percent": float(np.max(parts)),
        }
        for strategy, parts in found.items()
    ]


def _demands(testbed: Testbed, case: Case, seed: int) -> tuple[Array, Array]:
    """Random demands out of reach (COUNT, 2), and how far they are from it (COUNT,)."""
    rng = np.random.default_rng(seed)
    turned = rng.uniform(0, 2 * np.pi, 20 * COUNT)
    radius = FARTHEST_RAD * rng.uniform(0, 1, 20 * COUNT)
    demands = radius[:, None] * np.stack([np.cos(turned), np.sin(turned)], axis=1)
    least = -room(attainable(testbed, case), demands)
    far = np.flatnonzero(least > LEAST_RAD)[:COUNT]
    return demands[far], least[far]


def _missed(testbed: Testbed, case: Case, strategy: Strategy, demands: Array) -> Array:
    """Errors of the pointing (COUNT,) at each demand, by the mapping alone."""
    mapping = AllocatedMapping(hexapod(testbed.model), case.locked_at, limits_of(testbed), strategy)
    raised_m = np.full(mapping.actuators, HEAVE_M if case.heave else 0.0)
    residuals = [mapping.within_limits(one, NOMINAL, raised_m).residual for one in demands]
    return np.linalg.norm(residuals, axis=1)
