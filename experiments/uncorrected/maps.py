"""The maps and the beam walk in a few numbers; the arrays of the maps are in files of their own."""

from itertools import product
from typing import Any

import numpy as np

from experiments.hexapod.paper import TABLE_I_URAD
from experiments.uncorrected.limit_map import ANTI_WINDUP, largest_miss
from experiments.uncorrected.stability_map import ROLL_OFF_HZ
from experiments.uncorrected.study import Uncorrected

RATIO_TOLERANCE = 0.15
"""How near both ratios, W_a itself, and in the map of the limit each entry of Table I must come."""

PAPER_RATIOS = np.divide(TABLE_I_URAD["W_a_uncorrected"], TABLE_I_URAD["W_a"])


def stability_map(study: Uncorrected) -> dict[str, Any]:
    """Damping and crossover; the arrays are in `map.npz`."""
    both = np.isfinite(study.map_rad).all(axis=(-2, -1))
    ratio = study.map_rad[both][:, 1] / study.map_rad[both][:, 0]
    stable = study.map_poles < 1
    sound, corrected_d, corrected_e, uncorrected = np.moveaxis(stable, -1, 0)
    return {
        "data": "map.npz",
        "roll_off_hz": list(ROLL_OFF_HZ),
        "damping_ratio": study.grid.damping_ratio.tolist(),
        "alpha_crossover_hz": study.grid.alpha_crossover_hz.tolist(),
        "points": int(stable[..., 0].size),
        "points_stable": int(both.sum()),
        "alpha_ratio_range": [float(ratio[:, 0].min()), float(ratio[:, 0].max())],
        "beta_ratio_range": [float(ratio[:, 1].min()), float(ratio[:, 1].max())],
        "points_within_tolerance": int(
            (np.abs(ratio / PAPER_RATIOS - 1) < RATIO_TOLERANCE).all(axis=1).sum()
        ),
        "points_uncorrected_alone_unstable": int(
            (sound & corrected_d & corrected_e & ~uncorrected).sum()
        ),
        "points_corrected_alone_unstable": int(
            (sound & uncorrected & ~(corrected_d & corrected_e)).sum()
        ),
    }


def limit_map(study: Uncorrected) -> dict[str, Any]:
    """Limit on the demanded pointing; the arrays are in `limit_map.npz`."""
    miss, grid = largest_miss(1e6 * study.limit_rad), study.limit_grid
    ratio = study.limit_rad[..., -1, :] / study.limit_rad[..., 0, :]
    met = miss < RATIO_TOLERANCE
    spirals = []
    for (i, exponent), (j, direction), (k, held) in product(
        enumerate(grid.exponent), enumerate(grid.direction), enumerate(ANTI_WINDUP)
    ):
        here = (i, j, slice(None), k)
        start, limit = np.unravel_index(miss[here].argmin(), miss[here].shape)
        limits = grid.limit_over_radius[met[here].any(axis=0)]
        spirals.append(
            {
                "exponent": exponent,
                "direction": direction,
                "anti_windup": held,
                "settings": met[here].size,
                "settings_met": int(met[here].sum()),
                "limit_over_radius_met": [limits.min(), limits.max()] if limits.size else None,
                "best": {
                    "start_deg": grid.start_deg[start],
                    "limit_over_radius": grid.limit_over_radius[limit],
                    "ratio": ratio[here][start, limit].tolist(),
                    "largest_miss_percent": 100 * float(miss[here].min()),
                },
            }
        )
    return {
        "data": "limit_map.npz",
        "settings": met.size,
        "settings_met": int(met.sum()),
        "limit_over_radius": [grid.limit_over_radius.min(), grid.limit_over_radius.max()],
        "spirals": spirals,
    }


def beam_walk(study: Uncorrected) -> dict[str, Any]:
    """How far a detector off the focus brings the ratios, over offsets of either sign."""
    ratio = study.beam_walk_urad[:, -1] / study.beam_walk_urad[:, 0]
    met = (np.abs(ratio / PAPER_RATIOS - 1) < RATIO_TOLERANCE).all(axis=-1)
    return {
        "offset_m": [study.offset_m.min(), study.offset_m.max()],
        "offsets": len(study.offset_m),
        "offsets_met": int(met.any(axis=-1).sum()),
        "largest_ratio_true": ratio[:, 0].max(axis=0).tolist(),
        "largest_ratio_detector": ratio[:, 1].max(axis=0).tolist(),
    }
