"""Problems with limits through the library and daqp: Problem 1, and a hierarchy of three levels.

And whether secondary weights change a major task that limits hold back.
"""

from ctypes import c_int
from dataclasses import dataclass, replace
from operator import attrgetter, itemgetter
from typing import Any

import daqp
import numpy as np
from scipy.optimize import lsq_linear

from argument_checks.ties import exceeds
from experiments.benchmark.measurement import (
    Agreement,
    Contender,
    Entry,
    Problem,
    compare,
    random_problem,
)
from experiments.benchmark.solvers import EQUALITY, TOLERANCE, Solver
from experiments.rig.hexapod.columns import MAJOR, SECONDARY
from prioritized import lexicographic_least_squares, velocity_mapping
from sim import Array

STRICT = {"primal_tol": 1e-12, "rho_soft": 1e-14}
"""With daqp's defaults its levels are met to 6e-3 of these rates only; these cost no time."""
_SECOND = SECONDARY[:2]  # task rows of the second level of the hierarchy
COUNT = 200
FACTORS = (10.0, 0.1, 10.0, 0.1)  # of the secondary weights: the change whose effect is measured
_INFEASIBLE = -1
"""daqp's exit flag."""
_OUT_OF_REACH = 0.1  # norm of the least major residual from which on a task counts as out of reach


@dataclass(frozen=True)
class LimitedProblem(Problem):
    """Problem 1 with lower <= rates <= upper, (n,) each."""

    lower: Array
    upper: Array

    def levels(self) -> list[tuple[Array, Array]]:
        """As a hierarchy: the major rows, two secondary rows, then the rest of the objective."""
        A, b, J_m, v_m = self.parts()
        n, count = self.J.shape[1], len(_SECOND)
        second = np.arange(n, n + count)
        return [
            (J_m, v_m),
            (self.J[_SECOND], self.secondary[:count]),
            (np.delete(A, second, axis=0), np.delete(b, second)),
        ]


def random_limited(n: int, rng: np.random.Generator) -> LimitedProblem:
    """Limits of -1 and 1; the task is that of rates within 0.7 of them, so it is within reach.

    Desired rates are beyond the limits in 6 of 10 cases. Were the task out of reach, daqp would
    call the flat program infeasible, and its hierarchy would solve another problem.
    """
    one, inside = random_problem(n, rng), rng.uniform(-0.7, 0.7, size=n)
    secondary = one.secondary.copy()
    secondary[: len(_SECOND)] = one.J[_SECOND] @ inside
    joint, limit = 2.0 * one.joint, np.ones(n)
    return LimitedProblem(
        one.J, one.joint_weight, one.secondary_weight, one.J[MAJOR] @ inside, joint, secondary,
        -limit, limit,
    )  # fmt: skip


def solve_limited(problem: LimitedProblem) -> Array:
    """Optimal rates by the library, from the Jacobian, weights and limits."""
    mapping = velocity_mapping(
        problem.J,
        major=MAJOR,
        secondary=SECONDARY,
        joint_weight=problem.joint_weight,
        secondary_weight=problem.secondary_weight,
        rate_limits=(problem.lower, problem.upper),
    )
    return mapping(problem.major, problem.joint, problem.secondary)


def flat_program(problem: LimitedProblem) -> tuple[Any, ...]:
    """H, f, and limits beside the major task as equations."""
    sense = np.zeros(len(problem.lower) + len(problem.major), dtype=c_int)
    sense[len(problem.lower) :] = EQUALITY
    upper, lower = (
        np.concatenate([side, problem.major]) for side in (problem.upper, problem.lower)
    )
    return *problem.objective(), problem.J[MAJOR], upper, lower, sense


def soft_program(problem: LimitedProblem) -> tuple[Any, ...]:
    """H and f; limits and the major task as levels of a hierarchy."""
    A, b, J_m, v_m = problem.parts()
    return _with_levels(problem, [(J_m, v_m)], A, b)


def _hierarchy(problem: LimitedProblem) -> tuple[Any, ...]:
    *first, (A, b) = problem.levels()
    return _with_levels(problem, first, A, b)


def _with_levels(
    problem: LimitedProblem, levels: list[tuple[Array, Array]], A: Array, b: Array
) -> tuple[Any, ...]:
    rows, targets = zip(*levels, strict=True)
    upper, lower = (np.concatenate([side, *targets]) for side in (problem.upper, problem.lower))
    ends = np.cumsum([len(problem.lower), *map(len, targets)], dtype=c_int)
    sense = np.zeros(len(upper), dtype=c_int)
    return A.T @ A, -b @ A, np.concatenate(rows), upper, lower, sense, ends


def solve_hierarchy(*program: Any) -> Any:
    """A hierarchy by daqp, with what it returns."""
    return daqp.solve(*program, **STRICT)


def _levels(problem: LimitedProblem) -> tuple[Any, ...]:
    return problem.levels(), problem.lower, problem.upper


_FLAT = Solver("daqp_limited", daqp.solve, flat_program, itemgetter(0))
_IN_LEVELS = Solver("daqp_hierarchy3", solve_hierarchy, _hierarchy, itemgetter(0))
QUESTIONS = {
    "Problem 1 with limits": (Solver("limited", solve_limited), _FLAT, _FLAT.with_build()),
    "three levels with limits": (
        Solver("hierarchy3", lexicographic_least_squares, _levels, attrgetter("x")),
        _IN_LEVELS,
        _IN_LEVELS.with_build(),
    ),
}
"""Those that answer each question, the library first."""


def agreements(problems: list[LimitedProblem]) -> list[Agreement]:
    """How far apart all answers to each question are."""
    return [
        compare(question, {each.name: each.answers(problems) for each in solvers}, TOLERANCE)
        for question, solvers in QUESTIONS.items()
    ]


def contenders(problems: list[LimitedProblem]) -> list[Contender]:
    """Every solver of both questions."""
    return [
        each.contender(problems, each.name, samples=20)
        for solvers in QUESTIONS.values()
        for each in solvers
    ]


def active_limits(problems: list[LimitedProblem]) -> dict[str, list[int]]:
    """For each question, how many problems have 0, 1, ... n rates at a limit."""
    found = {}
    for question, (ours, *_) in QUESTIONS.items():
        at_limit = ~exceeds(1.0, np.abs(ours.answers(problems)))
        counts = np.bincount(at_limit.sum(axis=1), minlength=at_limit.shape[1] + 1)
        found[question] = counts.tolist()
    return found


def entry(problems: list[LimitedProblem]) -> Entry:
    """All of them."""
    return Entry(contenders(problems), agreements(problems), active_limits(problems))


def compared(seed: int) -> list[dict[str, Any]]:
    """Change and excess of the norm of the major residual, a row for each solver, as fractions.

    `change` is by the weights, of the former residual; `excess` is over the least residual within
    the limits, by scipy's bounded-variable least squares, for both weights. daqp has its default
    settings, which keep its limits to 1e-6; its levels are the limits, the major rows, and H. Its
    flat program is infeasible.
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
    flat = {"problems": len(flags), "infeasible": flags.count(_INFEASIBLE)}
    rows: list[dict[str, Any]] = [{"solver": "daqp", **flat}]
    for name, rates in answers.items():
        norm = np.array([_residual(*each) for each in zip(both, rates, strict=True)])
        before, after = norm.reshape(2, COUNT)
        row = {"solver": name, "problems": len(both)}
        changed = np.abs(after - before) / before
        for key, part in {"change": changed, "excess": norm / least - 1.0}.items():
            row |= {f"{key}_median": np.median(part), f"{key}_largest": part.max()}
        rows.append(row)
    return rows


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
