"""The ratios that count: of what to what, how large they may be, and what is aimed at."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from sim import Array

CHECK_MARGIN = 2.0
"""A stable ratio fails beyond this multiple of its bound: well beyond the scatter that was seen."""


@dataclass(frozen=True)
class Ratio:
    """A quotient of medians.

    Attributes:
        name: In `bench.json`.
        of: The quotient, from the medians by name.
        means: In words.
        bound: It must be below; None is reported only.
        goal: It should be at most.
        stable: It scatters so little that a commit may fail on it: docs/performance.md.
    """

    name: str
    of: Callable[[Mapping[str, float]], float]
    means: str
    bound: float | None = None
    goal: float | None = None
    stable: bool = False

    @property
    def check_bound(self) -> float | None:
        """Where `--check` draws the line; None: nowhere."""
        return CHECK_MARGIN * self.bound if self.stable and self.bound is not None else None


def _over(above: str, below: str) -> Callable[[Mapping[str, float]], float]:
    return lambda us: us[above] / us[below]


RATIOS = (
    Ratio(
        "closed_loop_over_mj_step",
        _over("closed_loop", "mj_step"),
        "the whole closed loop over MuJoCo's own steps",
        bound=1.5,
        goal=1.15,
    ),
    Ratio(
        "loop_overhead_over_mink",
        lambda us: (us["closed_loop"] - us["mj_step"]) / us["mink"],
        "what a control tick costs besides physics, its mapping in the hexapod's closed form, over "
        "one mink.solve_ik",
        bound=0.6,
        goal=0.2,
        stable=True,
    ),
    Ratio(
        "tick_over_mink",
        lambda us: us["tick"] / (us["mink"] + us["mink_update"]),
        "a tick by the general path, for any MJCF: kinematics, jacobians, reconfiguration, mapping "
        "and apply; over mink's Configuration.update and solve_ik",
        bound=1.2,
        stable=True,
    ),
    Ratio(
        "hexapod_tick_over_mink",
        _over("hexapod_tick", "mink"),
        "a tick in the hexapod's closed form: Jacobian, reconfiguration, mapping and apply; over "
        "one mink.solve_ik, a solver for any MJCF",
        bound=0.3,
        goal=0.1,
        stable=True,
    ),
    Ratio(
        "solve_over_daqp",
        _over("prioritized", "daqp"),
        "one Problem 1 from J and weights over daqp, its H given",
        bound=4.0,
        goal=1.0,
        stable=True,
    ),
    Ratio(
        "solve_over_placo",
        _over("prioritized", "placo"),
        "the same over PlaCo's solver, its problem given",
    ),
    Ratio(
        "batched_over_daqp",
        _over("batched", "daqp"),
        "one mapping of a large batch over daqp's one",
        bound=0.5,
        goal=0.1,
        stable=True,
    ),
)


@dataclass(frozen=True)
class Measured:
    """What came out.

    Attributes:
        ratio: Of the medians over all rounds.
        p5: 5th percentile over the rounds, each with its own medians; `p95` alike.
    """

    ratio: float
    p5: float
    p95: float


def measured(ratio: Ratio, samples_us: Mapping[str, Array]) -> Measured:
    """The ratio, from samples by name, shape (rounds, samples)."""
    whole = ratio.of({name: float(np.median(each)) for name, each in samples_us.items()})
    rounds = len(next(iter(samples_us.values())))
    by_round = [
        ratio.of({name: float(np.median(each[k])) for name, each in samples_us.items()})
        for k in range(rounds)
    ]
    p5, p95 = np.percentile(by_round, [5, 95])
    return Measured(whole, float(p5), float(p95))
