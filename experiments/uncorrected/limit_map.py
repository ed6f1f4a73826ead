"""Table I over a limit on the demanded pointing, its spiral and anti-windup; linear plant."""

from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import mujoco
import numpy as np

from argument_checks.ties import least
from experiments.rig.hexapod.controller import Loop
from experiments.rig.hexapod.metrics import rms
from experiments.rig.hexapod.paper import TABLE_I_URAD
from experiments.rig.hexapod.prediction import detector_noise_rad, driven_plant
from experiments.rig.hexapod.testbed import TestbedConfig
from experiments.uncorrected.candidates import COLUMNS, RATIO_TOLERANCE
from experiments.uncorrected.predicted import gain_and_plant
from ftc.linear_loop import limited_response
from sim import Array

RADIUS_URAD = {1.0: 100.0, 0.5: 113.0}
"""Of the spiral by its exponent, so that W_a stays where Table I has it."""

ANTI_WINDUP = (False, True)


@dataclass(frozen=True)
class LimitGrid:
    """Where the map is computed. A start half a turn on would only change the angles' sign."""

    exponent: tuple[float, ...]  # 1 for a constant rate of turn, 1/2 for a constant speed
    direction: tuple[int, ...]  # 1 from alpha towards beta, -1 the other way
    start_deg: tuple[float, ...]  # direction in which the spiral leaves the centre
    limit_over_radius: Array  # on each demanded angle

    @property
    def shape(self) -> tuple[int, ...]:
        """Of the map: exponents, directions, starts, anti-windup, limits."""
        spirals = (len(self.exponent), len(self.direction), len(self.start_deg))
        return (*spirals, len(ANTI_WINDUP), len(self.limit_over_radius))

    def benches(self, bench: TestbedConfig) -> list[TestbedConfig]:
        """One for each spiral, in the order of the map."""
        return [
            replace(
                bench,
                spiral_exponent=exponent,
                spiral_radius_urad=RADIUS_URAD[exponent],
                spiral_direction=direction,
                spiral_start_deg=start,
            )
            for exponent, direction, start in product(self.exponent, self.direction, self.start_deg)
        ]


def limit_grid(*, quick: bool) -> LimitGrid:
    """Limits from a tenth below the radius to an eighth above it."""
    if quick:
        return LimitGrid((1.0,), (1, -1), (0.0,), np.array([0.95, 1.0]))
    limits = np.round(np.arange(0.90, 1.125, 0.01), 2)
    return LimitGrid((1.0, 0.5), (1, -1), (0.0, 45.0, 90.0, 135.0), limits)


def limit_row(
    model: mujoco.MjModel,
    bench: TestbedConfig,
    loops: tuple[Loop, Loop],
    limit_over_radius: Array,
    seed: int,
) -> Array:
    """RMS of desired minus true (alpha, beta) for the testbed's spiral, shape (2, L, 4, 2), [rad].

    Without and with anti-windup; over limits (L,) instead of the testbed's own; each of COLUMNS.
    """
    time_s = bench.time_s(bench.duration_s)
    desired = bench.desired_rad(time_s)
    reference = desired - detector_noise_rad(bench, seed, len(time_s))
    limits = np.tile(limit_over_radius * bench.spiral_radius_urad * 1e-6, len(ANTI_WINDUP))
    held = np.repeat(ANTI_WINDUP, len(limit_over_radius))
    errors = []
    for name in COLUMNS:
        gain, failed = gain_and_plant(model, name)
        plant = driven_plant(failed, gain, bench.control_period_s)
        true = limited_response(
            plant,
            [loop.discrete for loop in loops],
            np.broadcast_to(reference, (len(limits), *reference.shape)),
            np.zeros((len(time_s), plant.ninputs - 2)),
            limits,
            held,
        )
        errors.append([rms(desired - each) for each in true])
    return np.moveaxis(np.reshape(errors, (len(COLUMNS), len(ANTI_WINDUP), -1, 2)), 0, 2)


def largest_miss(rms_urad: Array) -> Array:
    """Largest relative distance of the twelve entries of Table I from the paper's, shape (...).

    The RMS errors, shape (..., 4, 2), are of COLUMNS; W_b and W_c have W_a's.
    """
    entries = dict(zip(COLUMNS, np.moveaxis(rms_urad, -2, 0), strict=True))
    entries |= {"W_b": entries["W_a"], "W_c": entries["W_a"]}
    misses = [np.abs(entries[name] / TABLE_I_URAD[name] - 1) for name in TABLE_I_URAD]
    return np.max(misses, axis=(0, -1))


def limit_numbers(grid: LimitGrid, limit_rad: Array) -> dict[str, Any]:
    """The map in a few numbers, of the errors of :func:`limit_row`, shape (*grid.shape, 4, 2)."""
    miss = largest_miss(1e6 * limit_rad)
    ratio = limit_rad[..., -1, :] / limit_rad[..., 0, :]
    met = miss < RATIO_TOLERANCE
    spirals = []
    for (i, exponent), (j, direction), (k, held) in product(
        enumerate(grid.exponent), enumerate(grid.direction), enumerate(ANTI_WINDUP)
    ):
        here = (i, j, slice(None), k)
        start, limit = np.unravel_index(least(miss[here].ravel()), miss[here].shape)
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


def limit_arrays(grid: LimitGrid, limit_rad: Array) -> dict[str, Array]:
    """The contents of `limit_map.npz`."""
    axes = {name: np.array(values) for name, values in vars(grid).items()}
    return axes | {"anti_windup": np.array(ANTI_WINDUP), "rms_urad": 1e6 * limit_rad}
