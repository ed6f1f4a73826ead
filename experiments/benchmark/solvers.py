"""Problem 1 through every solver, each called in the fastest way that it documents."""

import warnings
from collections.abc import Callable, Sequence
from copy import deepcopy
from ctypes import c_int
from dataclasses import dataclass
from importlib import import_module
from operator import itemgetter
from typing import Any

import daqp
import numpy as np
import scipy.linalg
from scipy.linalg.lapack import dgglse

from experiments.benchmark.measurement import (
    Agreement,
    Contender,
    Entry,
    Problem,
    Questions,
    compare,
)
from experiments.rig.hexapod.columns import MAJOR, SECONDARY
from prioritized import velocity_mapping
from sim import Array

with warnings.catch_warnings():
    # Pinocchio, which PlaCo brings, imports another package by its former name.
    warnings.simplefilter("ignore", DeprecationWarning)
    placo: Any = import_module("placo")  # not as a statement: its type stubs are wrong

TOLERANCE = 1e-9  # of the answers, as a fraction of the rates
BATCHED = "batched"  # name of the largest batch
EQUALITY = 5
"""daqp's mark of a constraint that holds with equality."""
_STRICT = {"primal_tol": 1e-12, "rho_soft": 1e-8}
"""With daqp's defaults its hierarchy is exact to 1e-6 only; these cost no time."""


@dataclass(frozen=True)
class Solver:
    """One way to solve Problem 1, of which only `solve` is timed.

    `prepare` makes its arguments of a problem, and `rates` reads the rates (n,) off what it
    returned. Where `unit_rows`, it knows no weights: the objective's rows must be unit vectors.
    """

    name: str
    solve: Callable[..., Any]
    prepare: Callable[[Any], tuple[Any, ...]] = lambda problem: (problem,)
    rates: Callable[[Any], Array] = np.asarray
    unit_rows: bool = False

    def with_build(self) -> "Solver":
        """The same, its arguments made within the time."""
        solve, prepare = self.solve, self.prepare
        name = f"{self.name}_with_build"
        return Solver(name, lambda problem: solve(*prepare(problem)), rates=self.rates)

    def contender(
        self, problems: Sequence[Problem], name: str, size: int = 1, samples: int = 3
    ) -> Contender:
        """To be timed on problems of `size` mappings each, in new arrays for each sample."""
        given = [each.with_unit_rows() for each in problems] if self.unit_rows else problems

        def arguments() -> list[tuple[Any, ...]]:
            return [self.prepare(deepcopy(each)) for each in given]

        return Contender(name, self.solve, arguments, size * len(given), samples)

    def answers(self, problems: Sequence[Problem]) -> Array:
        """Rates of each problem as it is, shape (N, n)."""
        return np.array([self.rates(self.solve(*self.prepare(each))) for each in problems])


def _map(problem: Problem) -> Array:
    mapping = velocity_mapping(
        problem.J,
        major=MAJOR,
        secondary=SECONDARY,
        joint_weight=problem.joint_weight,
        secondary_weight=problem.secondary_weight,
    )
    return mapping(problem.major, problem.joint, problem.secondary)


def _quadratic_program(problem: Problem) -> tuple[Any, ...]:
    """H, f and the constraint."""
    v_m = problem.major
    return (
        *problem.objective(),
        problem.J[MAJOR],
        v_m,
        v_m,
        np.full(len(v_m), EQUALITY, dtype=c_int),
    )


def _levels(problem: Problem) -> tuple[Any, ...]:
    A, b, J_m, v_m = problem.parts()
    rows, target = np.vstack([J_m, A]), np.concatenate([v_m, b])
    ends = np.array([len(v_m), len(rows)], dtype=c_int)
    return rows, target, np.zeros(len(rows), dtype=c_int), ends


def _hierarchy(rows: Array, target: Array, sense: Array, ends: Array) -> Any:
    return daqp.solve(None, None, rows, target, target, sense, ends, **_STRICT)


def _empty_program(problem: Problem) -> tuple[Any, Problem]:
    program = placo.Problem()
    program.regularization = 0.0  # by default 1e-8, which is seen in the answers
    return program, problem


def _build(program: Any, problem: Problem) -> None:
    A, b, J_m, v_m = problem.parts()
    rates = program.add_variable(len(problem.joint)).expr()
    program.add_constraint(rates.left_multiply(J_m) == v_m).configure("hard", 1.0)
    program.add_constraint(rates.left_multiply(A) == b).configure("soft", 1.0)


def _built_program(problem: Problem) -> tuple[Any]:
    """Solved once, so that its memory is allocated: the first time takes 40 % longer."""
    program, _ = _empty_program(problem)
    _build_and_solve_program(program, problem)
    return (program,)


def _solve_program(program: Any) -> Array:
    program.solve()
    return program.x


def _build_and_solve_program(program: Any, problem: Problem) -> Array:
    _build(program, problem)
    return _solve_program(program)


def _formula(problem: Problem) -> Array:
    """Eq. (25), Theorem 3, as printed; without the rows of W2 it is Theorem 4."""
    J_m, J_s = problem.J[MAJOR], problem.J[SECONDARY]
    W1, W2 = np.diag(problem.joint_weight), np.diag(problem.secondary_weight)
    J_m_pinv, N = np.linalg.pinv(J_m), scipy.linalg.null_space(J_m)
    K = N @ np.linalg.pinv(np.vstack([W1 @ N, W2 @ J_s @ N]))
    gain = J_m_pinv - K @ np.vstack([W1 @ J_m_pinv, W2 @ J_s @ J_m_pinv])
    desired = np.concatenate([W1 @ problem.joint, W2 @ problem.secondary])
    return gain @ problem.major + K @ desired


def _constrained_least_squares(problem: Problem) -> tuple[Any, ...]:
    A, b, J_m, v_m = problem.parts()
    return A, J_m, b, v_m


OURS = Solver("prioritized", _map)
DAQP = Solver("daqp", daqp.solve, _quadratic_program, itemgetter(0))
PLACO = Solver("placo", _solve_program, _built_program)
FORMULA = Solver("pinv_formula", _formula)
LAPACK = Solver("dgglse", dgglse, _constrained_least_squares, itemgetter(3))
SOLVERS = (
    OURS,
    DAQP,
    DAQP.with_build(),
    Solver("daqp_hierarchy", _hierarchy, _levels, itemgetter(0), unit_rows=True),
    PLACO,
    Solver("placo_with_build", _build_and_solve_program, _empty_program),
    FORMULA,
    LAPACK,
)
GROWING = (OURS, DAQP, PLACO, FORMULA, LAPACK)
"""Those whose time is followed as the number of actuators grows."""


def agreements(asked: Questions) -> list[Agreement]:
    """How far apart all answers to each question are."""

    def among(question: str, solvers: Sequence[Solver], problems: list[Problem]) -> Agreement:
        return compare(question, {one.name: one.answers(problems) for one in solvers}, TOLERANCE)

    weighted = [each for each in SOLVERS if not each.unit_rows]
    unit = [each.with_unit_rows() for each in asked.problems]
    return [
        among("Problem 1", weighted, asked.problems),
        among("Problem 1 with unit rows", SOLVERS, unit),
        *(
            among(f"Problem 1 with {n} actuators", GROWING, problems)
            for n, problems in asked.by_actuators.items()
        ),
        batch_agreement(next(reversed(asked.by_batch.values()))[0]),
    ]


def batch_agreement(batch: Problem) -> Agreement:
    """The batch beside its first problems one by one."""
    alone = [batch.one(k) for k in range(min(64, len(batch.J)))]
    answers = {solver.name: solver.answers(alone) for solver in (OURS, DAQP, LAPACK)}
    together = {BATCHED: OURS.solve(batch)[: len(alone)]}
    return compare(f"a batch of {len(batch.J)}", answers | together, TOLERANCE)


def batch_names(batches: Sequence[int]) -> list[str]:
    """Of our samples, by size of the batch."""
    return [*(f"{OURS.name}_batch{size}" for size in batches[:-1]), BATCHED]


def contenders(asked: Questions) -> list[Contender]:
    """Every solver on one problem, those that can at every size, and ours on batches."""
    batches = zip(batch_names(list(asked.by_batch)), asked.by_batch.items(), strict=True)
    return [
        *(each.contender(asked.problems, each.name, samples=20) for each in SOLVERS),
        *(
            each.contender(problems, f"{each.name}_n{n}")
            for each in GROWING
            for n, problems in asked.by_actuators.items()
        ),
        *(OURS.contender(problems, name, size) for name, (size, problems) in batches),
    ]


def entry(asked: Questions) -> Entry:
    """All of them."""
    return Entry(contenders(asked), agreements(asked))
