"""Runs of a sweep's dataset, laid out anew from their numbers and simulated once more."""

from typing import Any

from experiments.rig.run import Run
from experiments.study.campaign import Again, Row
from experiments.study.study import WrongInput
from experiments.sweep.campaign import sweep_of
from experiments.sweep.design import MOST_RUNS, Design, SweepRuns
from experiments.sweep.row import measured, simulated
from experiments.sweep.sweep_run import Choice, Range, SweepRun


def again(summary: dict[str, Any]) -> Again:
    """The runs that a `sweep.json` or an `atlas.json` is of.

    Raises:
        WrongInput: They are more than a design may have.
    """
    basis = summary["basis"]
    drawn = dict(basis["design"])
    factors = [
        Choice(name, tuple(each["values"])) if "values" in each else Range(name, **each)
        for name, each in drawn.pop("factors").items()
    ]
    design = Design(**drawn, factors=tuple(factors))
    if not 0 < design.runs <= MOST_RUNS:
        raise WrongInput(f"a design has at most {MOST_RUNS} runs, got {design.runs}")
    return Again(sweep_of(SweepRuns(design, basis["seed"])), fly)


def fly(run: SweepRun) -> tuple[Row, Run, str]:
    """What is measured of the run, the run, and whether its failures were known."""
    whole = simulated(run)
    return measured(whole), whole, "known" if run.known else "not known"
