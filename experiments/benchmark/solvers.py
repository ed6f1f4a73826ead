"""Problem 1 through every solver, each called in the fastest way that it documents."""

import warnings
from collections.abc import Callable
from copy import deepcopy
from ctypes import c_int
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import daqp
import numpy as np
import scipy.linalg
from scipy.linalg.lapack import dgglse

from experiments.benchmark.problem import Problem
from experiments.benchmark.stopwatch import Contender
from experiments.hexapod.goal import MAJOR, SECONDARY
from prioritized import velocity_mapping
from sim import Array

with warnings.catch_warnings():
    # Pinocchio, which PlaCo brings, imports another package by its former name.
    warnings.simplefilter("ignore", DeprecationWarning)
    placo: Any = import_module("placo")  # not as a statement: its type stubs are wrong

_EQUALITY = 5
"""daqp's mark of a constraint that holds with equality."""
_STRICT = {"primal_tol": 1e-12, "rho_soft": 1e-8}
"""With daqp's defaults its hierarchy is exact to 1e-6 only; these cost no time."""


@dataclass(frozen=True)
class Solver:
    """One way to solve Problem 1.

    Attributes:
        name: Of its median.
        prepare: From the problem to the arguments of `solve`; not timed.
        solve: What is timed.
        rates: Reads the rates (n,) off what `solve` returned; not timed.
        unit_rows: It knows no weights: the objective's rows must be unit vectors.
    """

    name: str
    prepare: Callable[[Problem], tuple[Any, ...]]
    solve: Callable[..., Any]
    rates: Callable[[Any], Array]
    unit_rows: bool = False

    def contender(
        self, problems: list[Problem], *, name: str = "", samples: int, units: int = 1
    ) -> Contender:
        """To be timed on the problems, in new arrays for each sample.

        Args:
            problems: The objective's rows are made unit vectors for a solver that needs them.
            name: Of the median; the solver's own by default.
            samples: Of each round.
            units: Mappings in one problem.
        """
        given = [each.with_unit_rows() for each in problems] if self.unit_rows else problems

        def arguments() -> list[tuple[Any, ...]]:
            return [self.prepare(deepcopy(each)) for each in given]

        return Contender(name or self.name, self.solve, arguments, units, samples)

    def answers(self, problems: list[Problem]) -> Array:
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
    (H, f), (J_m, v_m) = problem.quadratic(), problem.constraint()
    return H, f, J_m, v_m, v_m, np.full(len(v_m), _EQUALITY, dtype=c_int)


def _build_quadratic_program(problem: Problem) -> Any:
    return daqp.solve(*_quadratic_program(problem))


def _levels(problem: Problem) -> tuple[Any, ...]:
    (A, b), (J_m, v_m) = problem.least_squares(), problem.constraint()
    rows, wanted = np.vstack([J_m, A]), np.concatenate([v_m, b])
    ends = np.array([len(v_m), len(rows)], dtype=c_int)
    return rows, wanted, np.zeros(len(rows), dtype=c_int), ends


def _hierarchy(rows: Array, wanted: Array, sense: Array, ends: Array) -> Any:
    return daqp.solve(None, None, rows, wanted, wanted, sense, ends, **_STRICT)


def _empty_program(problem: Problem) -> tuple[Any, Problem]:
    program = placo.Problem()
    program.regularization = 0.0  # by default 1e-8, which is seen in the answers
    return program, problem


def _build(program: Any, problem: Problem) -> None:
    (A, b), (J_m, v_m) = problem.least_squares(), problem.constraint()
    rates = program.add_variable(len(problem.joint)).expr()
    program.add_constraint(rates.left_multiply(J_m) == v_m).configure("hard", 1.0)
    program.add_constraint(rates.left_multiply(A) == b).configure("soft", 1.0)


def _built_program(problem: Problem) -> tuple[Any]:
    """Solved once, so that its memory is there: the first time takes 40 % longer."""
    program, _ = _empty_program(problem)
    _build(program, problem)
    program.solve()
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
    (A, b), (J_m, v_m) = problem.least_squares(), problem.constraint()
    return A, J_m, b, v_m


def _as_it_is(problem: Problem) -> tuple[Problem]:
    return (problem,)


def _itself(answer: Array) -> Array:
    return answer


def _first(answer: tuple[Array, ...]) -> Array:
    return answer[0]


def _fourth(answer: tuple[Array, ...]) -> Array:
    return answer[3]


OURS = Solver("prioritized", _as_it_is, _map, _itself)
DAQP = Solver("daqp", _quadratic_program, daqp.solve, _first)
PLACO = Solver("placo", _built_program, _solve_program, _itself)
FORMULA = Solver("pinv_formula", _as_it_is, _formula, _itself)
LAPACK = Solver("dgglse", _constrained_least_squares, dgglse, _fourth)
SOLVERS = (
    OURS,
    DAQP,
    Solver("daqp_with_build", _as_it_is, _build_quadratic_program, _first),
    Solver("daqp_hierarchy", _levels, _hierarchy, _first, unit_rows=True),
    PLACO,
    Solver("placo_with_build", _empty_program, _build_and_solve_program, _itself),
    FORMULA,
    LAPACK,
)
GROWING = (OURS, DAQP, PLACO, FORMULA, LAPACK)
"""Those whose time is followed as the number of actuators grows."""
