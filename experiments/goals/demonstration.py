"""What a demonstration of a secondary goal consists of, and the strategies that it is run with."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from experiments.hexapod.controller import Loop
from sim import Array


@dataclass(frozen=True)
class Strategy:
    """How one run treats the secondary goal.

    Attributes:
        name: As in `goals.json`.
        pursues: Whether the goal is pursued at all.
        major_weight: Of the major rows in a weighted pseudo-inverse; None: they come first.
        limited: Whether the limit is there: the stop, the obstacle, the broken shoulder.
        seed: Of the sensor noise.
    """

    name: str
    pursues: bool
    major_weight: float | None
    limited: bool
    seed: int


REFERENCE = "unlimited"
"""Nothing done where there is nothing to avoid: what the major error would be anyway."""


def strategies(seed: int, quick: bool) -> tuple[Strategy, ...]:
    """All runs of one demonstration: the three strategies, and what noise alone changes."""
    weights = (10.0,) if quick else (1.0, 10.0, 100.0)
    pursued = Strategy("pursued", pursues=True, major_weight=None, limited=True, seed=seed)
    unlimited = replace(pursued, name=REFERENCE, pursues=False, limited=False)
    return (
        pursued,
        replace(pursued, name="nothing", pursues=False),
        *(replace(pursued, name=f"pseudo_inverse_{w:g}", major_weight=w) for w in weights),
        unlimited,
        *(replace(unlimited, name=f"{REFERENCE}_seed_{k}", seed=seed + k) for k in (1, 2)),
    )


@dataclass(frozen=True)
class Outcome:
    """What one run gave.

    Attributes:
        time_s: (N,).
        error_rad: (N, 2), desired minus true pointing.
        measure: (N,), of the secondary goal.
        closure_residual_max_m: Largest gap of a closed loop.
        arrays: Whatever else is kept of the run, time along the first axis.
    """

    time_s: Array
    error_rad: Array
    measure: Array
    closure_residual_max_m: float
    arrays: dict[str, Array]


@dataclass(frozen=True)
class Demonstration:
    """One secondary goal, and the run that needs it.

    Attributes:
        name: As in `goals.json`.
        title: For people.
        run: One run, given the strategy, its duration and the hexapod's compensators.
        measure: Name of the secondary measure, with its unit.
        limit: What the measure must stay below, or above.
        keeps_below: Which of the two.
        duration_s: Of a run; `quick_duration_s`: with --quick.
        settings: Its chosen constants, units in the names.
        machine: Its file in `models/`, without the ending.
        angles: Names of the two columns of the pointing error.
        judged_from_s: The pointing error counts from here on.
    """

    name: str
    title: str
    run: Callable[[Strategy, float, tuple[Loop, Loop]], Outcome]
    measure: str
    limit: float
    keeps_below: bool
    duration_s: float
    quick_duration_s: float
    settings: dict[str, Any]
    machine: str = "fjh"
    angles: tuple[str, str] = ("alpha", "beta")
    judged_from_s: float = 0.0

    def worst(self, outcome: Outcome) -> float:
        """The secondary measure where it is nearest to its limit, or furthest beyond."""
        return float(outcome.measure.max() if self.keeps_below else outcome.measure.min())

    def is_kept(self, worst: float) -> bool:
        """Whether the limit is kept."""
        return worst < self.limit if self.keeps_below else worst > self.limit


def smooth_step(progress: Array | float) -> Array:
    """From 0 to 1 with the least jerk, as progress goes from 0 to 1; constant outside."""
    s = np.clip(progress, 0.0, 1.0)
    return s**3 * (10 - 15 * s + 6 * s**2)
