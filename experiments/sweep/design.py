"""The design of a sweep: what is varied, how cases are laid out, and case k of them."""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np
from scipy.stats import qmc

from experiments.sweep.case import Case, case_of
from experiments.sweep.factors import Factor
from sim import Array

Layout = Literal["latin-hypercube", "grid"]


@dataclass(frozen=True)
class Design:
    """Which runs a sweep is made of.

    Attributes:
        layout: "latin-hypercube": each range is cut into as many slices as there are runs, with
            one run in each; "grid": every combination of the factors' values.
        runs: How many.
        duration_s: So much of the spiral, in every run.
        factors: What is varied; all else is as on the bench.
    """

    layout: Layout
    runs: int
    duration_s: float
    factors: tuple[Factor, ...]

    def as_json(self) -> dict[str, Any]:
        """The same as plain numbers and words."""
        factors = {
            factor.name: {key: value for key, value in asdict(factor).items() if key != "name"}
            for factor in self.factors
        }
        return {
            "layout": self.layout,
            "runs": self.runs,
            "duration_s": self.duration_s,
            "factors": factors,
        }


def grid(duration_s: float, factors: Sequence[Factor]) -> Design:
    """Every combination of the factors' values, the last factor's changing fastest."""
    runs = math.prod(factor.count for factor in factors)
    return Design("grid", runs, duration_s, tuple(factors))


class Cases:
    """Cases 0, 1, ... of a design; each is a pure function of design, seed and number."""

    def __init__(self, design: Design, seed: int) -> None:
        """Lay the cases out; of a hypercube this keeps eight bytes a run and factor."""
        self.design = design
        self.seed = seed
        self._cube = _hypercube(design, seed) if design.layout == "latin-hypercube" else None

    def __len__(self) -> int:
        return self.design.runs

    def __getitem__(self, number: int) -> Case:
        factors = self.design.factors
        if self._cube is None:
            shape = [factor.count for factor in factors]
            at = np.unravel_index(number, shape)
            varied = {each.name: each.values[k] for each, k in zip(factors, at, strict=True)}
        else:
            row = self._cube[number].tolist()
            varied = {each.name: each.at(u) for each, u in zip(factors, row, strict=True)}
        noise = np.random.SeedSequence(self.seed, spawn_key=(number,)).generate_state(1)
        return case_of(number, self.design.duration_s, {"seed": int(noise[0])} | varied)


def _hypercube(design: Design, seed: int) -> Array:
    """Points of the unit cube, one a run, shape (runs, factors)."""
    sampler = qmc.LatinHypercube(d=len(design.factors), rng=np.random.default_rng(seed))
    return sampler.random(design.runs)
