"""What a demonstration of a secondary goal consists of, and the strategies that it is run with."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from experiments.rig.hexapod.controller import Loop
from sim import Array


@dataclass(frozen=True)
class Strategy:
    """How one run treats the secondary goal."""

    name: str
    pursues: bool
    major_weight: float | None  # in a weighted pseudo-inverse; None: the major rows come first
    limited: bool  # whether the limit is there: the stop, the obstacle, the broken shoulder
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
    """What one run gave; time is along the first axis."""

    time_s: Array
    error_rad: Array  # desired minus true pointing, (N, 2)
    measure: Array  # of the secondary goal, (N,)
    closure_residual_max_m: float
    arrays: dict[str, Array]


@dataclass(frozen=True)
class Demonstration:
    """One secondary goal, and the run that needs it."""

    name: str
    title: str
    run: Callable[[Strategy, float, tuple[Loop, Loop]], Outcome]
    measure: str  # with its unit
    limit: float  # of the measure, which stays below it or above
    keeps_below: bool
    durations_s: tuple[float, float]  # of the whole study's run, and with --quick
    settings: dict[str, Any]
    machine: str = "fjh"  # its file in `models/`
    angles: tuple[str, str] = ("alpha", "beta")
    judged_from_s: float = 0.0

    def worst(self, outcome: Outcome) -> float:
        """The secondary measure where it is nearest to its limit, or furthest beyond."""
        return float(outcome.measure.max() if self.keeps_below else outcome.measure.min())

    def is_kept(self, worst: float) -> bool:
        """Whether the limit is kept."""
        return worst < self.limit if self.keeps_below else worst > self.limit
