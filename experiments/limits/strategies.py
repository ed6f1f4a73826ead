"""The strategies that the study compares."""

from dataclasses import dataclass
from typing import Literal

Allocation = Literal["strict", "scaled", "clipping", "weighted", "unlimited"]
"""How rates or displacements are found: the major task first, with least error or its direction
kept; without limits, and then cut off; in one problem with weights; or where nothing is limited."""


@dataclass(frozen=True)
class Strategy:
    """One way to obey the limits.

    Attributes:
        allocation: How.
        major_weight: Of the major task in the one problem with weights.
        anti_windup: Whether the compensators observe what is achieved.
    """

    allocation: Allocation
    major_weight: float | None = None
    anti_windup: bool = True

    @property
    def name(self) -> str:
        """As in `limits.json`."""
        weight = "" if self.major_weight is None else f"_{self.major_weight:g}"
        return f"{self.allocation}{weight}{'' if self.anti_windup else '_winding_up'}"


UNLIMITED = Strategy("unlimited")
"""Of a machine with longer strokes and cooler coils: what the loop errs without limits."""


def loop_strategies(quick: bool) -> tuple[Strategy, ...]:
    """In the loop of the hexapod."""
    strict, clipping = Strategy("strict"), Strategy("clipping")
    if quick:
        winding_up = Strategy("strict", anti_windup=False)
        return strict, winding_up, clipping, UNLIMITED
    both = (
        Strategy(how, anti_windup=held)
        for how in ("strict", "scaled", "clipping")
        for held in (True, False)
    )
    return (*both, *weighted(), UNLIMITED)


def arm_strategies(quick: bool) -> tuple[Strategy, ...]:
    """On the arm, whose controller has no integrator."""
    strict, clipping = Strategy("strict"), Strategy("clipping")
    if quick:
        return strict, clipping, UNLIMITED
    return strict, Strategy("scaled"), clipping, *weighted(), UNLIMITED


def weighted() -> tuple[Strategy, ...]:
    """One problem, over seven decades of the weight."""
    return tuple(Strategy("weighted", weight) for weight in (0.1, 1.0, 10.0, 1e3, 1e6))
