"""Whether secondary weights change a major task that limits hold back: the library and daqp."""

from dataclasses import replace
from typing import Any

import daqp
import numpy as np
from scipy.optimize import lsq_linear

from experiments.benchmark.limited import (
    LimitedProblem,
    flat_program,
    random_limited,
    soft_program,
    solve_limited,
)
from experiments.rig.hexapod.columns import MAJOR
from sim import Array

COUNT = 200
FACTORS = (10.0, 0.1, 10.0, 0.1)
"""Of the secondary weights: the change whose effect is measured."""
_INFEASIBLE = -1
"""daqp's exit flag."""
_OUT_OF_REACH = 0.1
"""Norm of the least major residual from which on a task counts as out of reach."""


def compared(seed: int) -> dict[str, Any]:
    """Change and excess of the norm of the major residual, by solver, as fractions.

    `change` is by the weights, of the former residual; `excess` is over the least residual within
    the limits, by scipy's bounded-variable least squares, for both weights. daqp has its default
    settings, which keep its limits to 1e-6; its levels are the limits, the major rows, and H.
    """
    rng = np.random.default_rng(seed)
    problems = [_out_of_reach(rng) for _ in range(COUNT)]
    other = [replace(one, secondary_weight=one.secondary_weight * FACTORS) for one in problems]
    both = [*problems, *other]
    least = np.array([_least_residual(one) for one in both])
    flags = [daqp.solve(*flat_program(one))[2] for one in both]
    answers = {
        "prioritized": [solve_limited(one) for one in both],
        "daqp_hierarchy": [daqp.solve(*soft_program(one))[0] for one in both],
    }
    found = {}
    for name, rates in answers.items():
        norm = np.array([_residual(*each) for each in zip(both, rates, strict=True)])
        before, after = norm.reshape(2, COUNT)
        found[name] = {
            "change": _median_and_largest(np.abs(after - before) / before),
            "excess": _median_and_largest(norm / least - 1.0),
        }
    return {
        "problems": COUNT,
        "weight_factors": list(FACTORS),
        "flat_infeasible": flags.count(_INFEASIBLE),
        "flat": len(flags),
        "solvers": found,
    }


def _out_of_reach(rng: np.random.Generator) -> LimitedProblem:
    """The task is that of rates of up to 4 times their limits."""
    while True:
        one = random_limited(6, rng)
        far = replace(one, major=one.J[MAJOR] @ rng.uniform(-4.0, 4.0, size=6))
        if _least_residual(far) > _OUT_OF_REACH:
            return far


def _least_residual(problem: LimitedProblem) -> float:
    bounds = problem.lower, problem.upper
    best = lsq_linear(problem.J[MAJOR], problem.major, bounds, method="bvls", tol=1e-15)
    return float(np.linalg.norm(best.fun))


def _residual(problem: LimitedProblem, rates: Array) -> float:
    return float(np.linalg.norm(problem.major - problem.J[MAJOR] @ rates))


def _median_and_largest(values: Array) -> dict[str, float]:
    return {"median": float(np.median(values)), "largest": float(values.max())}
