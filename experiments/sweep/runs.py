"""The runs of a sweep and of the atlas, whichever are missing in the folder."""

from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path
from typing import Any

from experiments.rig.conditions import every_condition
from experiments.study.resumable import Outcome, complete
from experiments.sweep.campaign import sweep_of
from experiments.sweep.design import SweepRuns, grid, read_design
from experiments.sweep.row import JACOBIANS
from experiments.sweep.sweep_run import Choice

Sweep = AbstractContextManager[Outcome[SweepRuns]]

_TURN, _MIRROR = (2, 3, 4, 5, 0, 1), (1, 0, 5, 4, 3, 2)
"""Symmetries of the machine: the strut in whose place each strut comes."""


def run_sweep(*, seed: int, quick: bool, design: Path | None, **options: Any) -> Sweep:
    """The runs of a design file, or of the default design; further options as of `complete`."""
    chosen = read_design(design)
    if quick:
        chosen = replace(chosen, runs=min(chosen.runs, 40), duration_s=0.5)
    return complete("sweep", sweep_of(SweepRuns(chosen, seed)), **options)


def run_atlas(*, seed: int, quick: bool, **options: Any) -> Sweep:
    """All conditions that differ, weights and Jacobians; further options as of `complete`."""
    factors = [
        Choice("struts", representatives()),
        Choice("weight", ("W_a",) if quick else ("W_a", "W_b", "W_c", "W_d", "W_e")),
        Choice("jacobian", JACOBIANS),
    ]
    design = grid(0.5 if quick else 2.0, factors)
    return complete("atlas", sweep_of(SweepRuns(design, seed)), **options)


def representatives() -> tuple[str, ...]:
    """The first of each set of conditions that turning by 120 degrees and mirroring make equal."""
    every, found = every_condition(6), {}
    for condition in every:
        for seen in (condition, _moved(condition, _MIRROR)):
            for _ in range(3):
                seen = _moved(seen, _TURN)
                found.setdefault(seen, condition)
    return tuple(condition for condition in every if found[condition] == condition)


def _moved(condition: str, struts: tuple[int, ...]) -> str:
    return "".join(condition[k] for k in struts)
