"""Which flights there are: every number of a seed is one flight."""

from dataclasses import asdict, dataclass, replace
from itertools import accumulate
from math import ceil
from typing import Any

import numpy as np

from experiments.recover.flight import Flight, Sort
from experiments.recover.recovery import AFTER_S, BEFORE_S
from experiments.rig.hexapod.mismatch import ALONE
from experiments.rig.hexapod.testbed import TestbedConfig
from experiments.study.study import WrongInput
from ftc.fdi.fault_model import KINDS, FaultKind
from sim import Failure

FACTORS = (0.3, 3.0, 10.0, 30.0, 100.0)
"""Sizes of a mismatch beside zero and one, which the failures have."""

LARGEST = {"drift_urad_per_s": 100.0, "gain_drift_per_s": 100.0}
LARGEST |= {"damping": 3.0, "all": 3.0, "timestep_s": 0.0}
"""Others end at `_BREAKS`. A damper has no negative constant, a physics step no size."""

_BREAKS = 30.0
"""There gains and springs are within 90 %, and a delay makes the loop itself unstable."""

_EARLIEST_S, _LATEST_S = 1.5, 13.4
_FIRST_S, _GAP_S, _LEFT_S = (1.5, 9.0), (0.1, 2.0), 2.0
_STANDING_M = 10e-6
_EFFECTIVENESS = 0.2, 0.8
_EACH: list[tuple[FaultKind, int]] = [(kind, strut) for strut in range(6) for kind in KINDS]
_RIGID: tuple[FaultKind, ...] = ("locked", "free")
_STREAMS: dict[Sort, int] = {"failure": 2, "size": 2, "pair": 4, "sound": 5}
"""Of random numbers; failures are the same at every size."""


@dataclass(frozen=True)
class Block:
    """Flights of one sort on plants of one mismatch, draws 0, 1, ..."""

    sort: Sort
    mismatch: str
    factor: float
    count: int


@dataclass(frozen=True)
class Counts:
    """How many flights of each sort.

    Attributes:
        exact: Failures on exact plants.
        all: On plants with all mismatches.
        alone: On plants with each mismatch by itself.
        mismatches: Names of these.
        size: Of each mismatch and factor.
        sound: Long flights without failure.
        sound_s: How long.
        pairs: Flights with two failures.
    """

    exact: int
    all: int
    alone: int
    mismatches: tuple[str, ...]
    size: int
    sound: int
    sound_s: float
    pairs: int

    def blocks(self) -> tuple[Block, ...]:
        """All flights, in the order of their numbers."""
        alone = dict.fromkeys(self.mismatches, self.alone)
        failures = {"exact": self.exact, "all": self.all, **alone}
        return (
            *(Block("failure", name, 1.0, count) for name, count in failures.items()),
            *(
                Block("size", name, factor, self.size)
                for name in ("all", *self.mismatches)
                for factor in FACTORS
                if factor <= LARGEST.get(name, _BREAKS)
            ),
            Block("pair", "all", 1.0, self.pairs),
            Block("sound", "all", 1.0, self.sound),  # last: their number may change
        )


FULL = Counts(
    exact=60,
    all=306,
    alone=60,
    mismatches=tuple(ALONE),
    size=3,
    sound=0,
    sound_s=TestbedConfig().duration_s,
    pairs=24,
)
"""All but the flights without failures, which :func:`for_hours` adds.

The rate claimed is that with all mismatches: 306 of 306 show 98.8 % (at 95 %), 60 of 60 show 94 %.
Three of a size are a lock, a free and a weak strut: they show where it breaks, no rate.
"""

QUICK = Counts(exact=1, all=3, alone=0, mismatches=(), size=1, sound=1, sound_s=2.0, pairs=1)


def for_hours(hours: float) -> Counts:
    """The whole study, with at least so many hours without failures.

    Raises:
        WrongInput: They are not positive and finite.
    """
    if not 0 < hours < np.inf:
        raise WrongInput(f"--hours must be positive and finite, got {hours:g}")
    return replace(FULL, sound=ceil(round(hours * 3600 / FULL.sound_s, 6)))


class FlightPlan:
    """Flights 0, 1, ...; each is a pure function of counts, seed and number."""

    def __init__(self, counts: Counts, seed: int, controller: str | None = None) -> None:
        """`controller` is another one, to be compared in the flights of :meth:`compared`."""
        self.counts, self.seed, self.controller = counts, seed, controller
        self.blocks = counts.blocks()
        self._ends = list(accumulate(block.count for block in self.blocks))

    def __len__(self) -> int:
        return self._ends[-1]

    def __getitem__(self, number: int) -> Flight:
        at = int(np.searchsorted(self._ends, number, side="right"))
        block = self.blocks[at]
        flight = self._drawn(block.sort, number - self._ends[at] + block.count)
        return replace(
            flight,
            number=number,
            mismatch=block.mismatch,
            factor=block.factor,
        )

    def compared(self) -> list[Flight]:
        """Flights with one failure and all mismatches."""
        chosen = [block == Block("failure", "all", 1.0, block.count) for block in self.blocks]
        at = chosen.index(True)
        return [self[k] for k in range(self._ends[at] - self.blocks[at].count, self._ends[at])]

    def as_json(self) -> dict[str, Any]:
        """What the flights are drawn from, beside the seed.

        Not how many of them are long, without failures: more can be flown later.
        """
        counts = {name: value for name, value in asdict(self.counts).items() if name != "sound"}
        return counts | {"controller": self.controller}

    def _drawn(self, sort: Sort, draw: int) -> Flight:
        rng = np.random.default_rng([self.seed, _STREAMS[sort], draw])
        posture = rng.normal(scale=_STANDING_M, size=6)
        seeds = rng.integers(2**32, size=2).tolist()
        if sort == "sound":
            failures, begin_s, duration_s = (), 0.0, self.counts.sound_s
        elif sort == "pair":
            failures, posture = pair(rng), np.zeros(6)  # where opposite struts are most alike
            begin_s = failures[0].time_s - BEFORE_S
            duration_s = failures[1].time_s + _LEFT_S - begin_s
        else:
            failures = (single(rng, draw),)
            begin_s, duration_s = failures[0].time_s - BEFORE_S, BEFORE_S + AFTER_S
        return Flight(
            number=draw,
            sort=sort,
            draw=draw,
            mismatch="exact",
            factor=1.0,
            plant_seed=seeds[0],
            failures=failures,
            begin_s=begin_s,
            duration_s=duration_s,
            posture_m=tuple(posture.tolist()),
            seed=seeds[1],
        )


def single(rng: np.random.Generator, draw: int) -> Failure:
    """Each strut and kind in turn, at a random time on the spiral."""
    kind, strut = _EACH[draw % len(_EACH)]
    left = float(rng.uniform(*_EFFECTIVENESS)) if kind == "weak" else 0.0
    return Failure(strut, kind, _time_s(rng, _EARLIEST_S, _LATEST_S), left)


def pair(rng: np.random.Generator) -> tuple[Failure, Failure]:
    """Two struts, locked or free, some time apart, at random times on the spiral."""
    struts = rng.permutation(6)[:2].tolist()
    kinds = [_RIGID[k] for k in rng.integers(len(_RIGID), size=2)]
    first_s = _time_s(rng, *_FIRST_S)
    return (
        Failure(struts[0], kinds[0], first_s),
        Failure(struts[1], kinds[1], round(first_s + _time_s(rng, *_GAP_S), 3)),
    )


def _time_s(rng: np.random.Generator, low_s: float, high_s: float) -> float:
    """Whole control periods, so that all flights of a draw are sampled alike."""
    return round(float(rng.uniform(low_s, high_s)), 3)
