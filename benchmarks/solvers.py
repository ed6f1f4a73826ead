"""Time Problem 1, with and without limits, and three levels, by each solver's fastest interface."""

import warnings
from collections.abc import Callable, Sequence
from copy import deepcopy
from ctypes import c_int
from dataclasses import dataclass, replace
from importlib import import_module
from operator import attrgetter, itemgetter
from typing import Any

import numpy as np
from scipy.linalg.lapack import dgglse

from benchmarks.candidate import Candidate, check_agreement
from prioritized import lexicographic_least_squares, velocity_mapping
from sim import Array

with warnings.catch_warnings():
    # Pinocchio, which PlaCo depends on, imports a package by its former name.
    warnings.simplefilter("ignore", DeprecationWarning)
    # No import statements: only the benchmark's environment has these packages.
    daqp: Any = import_module("daqp")
    placo: Any = import_module("placo")

TOLERANCE = 1e-9  # of the solutions, as a fraction of the rates
MAJOR, SECONDARY = [0, 1], [3, 4, 5, 2]
"""Rows of J in the major and the secondary task, as on the hexapod."""
EQUALITY = 5
"""Code of an equality constraint in daqp."""
STRICT = {"primal_tol": 1e-12, "rho_soft": 1e-14}
"""Settings of daqp; with its defaults the rates have errors of 0.6 % and take as long."""
SECOND = SECONDARY[:2]
"""Rows of J in the second of the three levels."""


@dataclass(frozen=True)
class Problem:
    """Problem 1, or a batch: minimize |W1 (rates - joint)|^2 + |W2 (J_s rates - secondary)|^2.

    The constraint is J_m rates = major. J_m and J_s are the rows `MAJOR` and `SECONDARY` of J,
    (..., 6, n). The weights, diagonals of W1 (n,) and W2 (4,), are common to a batch; major is
    (..., 2), joint (..., n), secondary (..., 4). If `limited`, rates have limits of -1 and 1.
    """

    J: Array
    joint_weight: Array
    secondary_weight: Array
    major: Array
    joint: Array
    secondary: Array
    limited: bool = False

    @property
    def limits(self) -> tuple[Array, Array] | None:
        """Lower and upper limits of the rates, (n,) each; None without limits."""
        most = np.ones(self.J.shape[-1])
        return (-most, most) if self.limited else None

    def parts(self) -> tuple[Array, Array, Array, Array]:
        """Return A (n + 4, n) and b of the objective |A rates - b|^2, J_m (2, n), and v_m."""
        W1, W2 = np.diag(self.joint_weight), self.secondary_weight
        A = np.vstack([W1, W2[:, None] * self.J[SECONDARY]])
        b = np.concatenate([self.joint_weight * self.joint, W2 * self.secondary])
        return A, b, self.J[MAJOR], self.major

    def objective(self) -> tuple[Array, Array]:
        """Return H (n, n) and f of the objective as rates^T H rates / 2 + f^T rates."""
        squares = self.joint_weight * self.joint_weight
        A = self.secondary_weight[:, None] * self.J[SECONDARY]
        H = A.T @ A
        H.flat[:: len(H) + 1] += squares
        return H, -(squares * self.joint) - (self.secondary_weight * self.secondary) @ A

    def levels(self) -> list[tuple[Array, Array]]:
        """Return three levels: the major rows, two secondary rows, the rest of the objective."""
        A, b, J_m, v_m = self.parts()
        second = self.J.shape[1] + np.arange(len(SECOND))
        remainder = np.delete(A, second, axis=0), np.delete(b, second)
        return [(J_m, v_m), (self.J[SECOND], self.secondary[: len(SECOND)]), remainder]


def random_problem(n: int, rng: np.random.Generator, batch: tuple[int, ...] = ()) -> Problem:
    """Sample a problem of n actuators with a Gaussian J of full rank and weights from 0.5 to 2."""
    return Problem(
        J=rng.normal(size=(*batch, 6, n)),
        joint_weight=rng.uniform(0.5, 2.0, size=n),
        secondary_weight=rng.uniform(0.5, 2.0, size=len(SECONDARY)),
        major=rng.normal(size=(*batch, len(MAJOR))),
        joint=rng.normal(size=(*batch, n)),
        secondary=rng.normal(size=(*batch, len(SECONDARY))),
    )


def random_limited(n: int, rng: np.random.Generator) -> Problem:
    """Sample a problem with limits that is feasible with rates within 0.7 of the limits.

    The desired rates exceed the limits in 6 of 10 cases. The task must be feasible for daqp's
    program without levels.
    """
    problem, inside = random_problem(n, rng), rng.uniform(-0.7, 0.7, size=n)
    secondary = np.concatenate([problem.J[SECOND] @ inside, problem.secondary[len(SECOND) :]])
    major, joint = problem.J[MAJOR] @ inside, 2.0 * problem.joint
    return replace(problem, major=major, joint=joint, secondary=secondary, limited=True)


@dataclass(frozen=True)
class Solver:
    """Solver of a problem, of which only `solve` is timed.

    `prepare` makes its arguments from a problem; `rates` takes the rates (n,) from its result.
    """

    solve: Callable[..., Any]
    prepare: Callable[[Problem], tuple[Any, ...]] = lambda problem: (problem,)
    rates: Callable[[Any], Array] = np.asarray

    def with_build(self) -> "Solver":
        """Return the same solver with the preparation of arguments in the timed part."""
        solve, prepare = self.solve, self.prepare
        return Solver(lambda problem: solve(*prepare(problem)), rates=self.rates)

    def candidate(self, problems: Sequence[Problem], size: int = 1) -> Candidate:
        """Return a candidate for problems of `size` mappings, in new arrays for each round."""

        def arguments() -> list[tuple[Any, ...]]:
            return [self.prepare(deepcopy(problem)) for problem in problems]

        return Candidate(self.solve, arguments, size * len(problems))

    def solutions(self, problems: Sequence[Problem]) -> Array:
        """Return the rates of all problems, shape (N, n)."""
        return np.array([self.rates(self.solve(*self.prepare(problem))) for problem in problems])


def _map(problem: Problem) -> Array:
    weights = problem.joint_weight, problem.secondary_weight
    mapping = velocity_mapping(problem.J, MAJOR, SECONDARY, *weights, rate_limits=problem.limits)
    return mapping(problem.major, problem.joint, problem.secondary)


def _flat(problem: Problem) -> tuple[Any, ...]:
    """Return daqp's arguments: H, f, and constraints by the major task and any limits."""
    v_m, none = problem.major, np.zeros(0)
    least, most = problem.limits or (none, none)
    sense = np.zeros(len(most) + len(v_m), dtype=c_int)
    sense[len(most) :] = EQUALITY
    sides = np.concatenate([most, v_m]), np.concatenate([least, v_m])
    return (*problem.objective(), problem.J[MAJOR], *sides, sense)


def _in_levels(problem: Problem) -> tuple[Any, ...]:
    """Return daqp's arguments: H and f of the last level, hierarchy of limits and first levels."""
    assert problem.limits is not None
    (least, most), (*first, (A, b)) = problem.limits, problem.levels()
    rows, targets = zip(*first, strict=True)
    upper, lower = (np.concatenate([side, *targets]) for side in (most, least))
    ends = np.cumsum([len(most), *map(len, targets)], dtype=c_int)
    sense = np.zeros(len(upper), dtype=c_int)
    return A.T @ A, -b @ A, np.concatenate(rows), upper, lower, sense, ends


def _levels(problem: Problem) -> tuple[Any, ...]:
    return problem.levels(), *(problem.limits or ())


def _by_placo(problem: Problem) -> Array:
    A, b, J_m, v_m = problem.parts()
    program = placo.Problem()
    program.regularization = 0.0  # the default, 1e-8, exceeds the tolerance
    rates = program.add_variable(len(problem.joint)).expr()
    program.add_constraint(rates.left_multiply(J_m) == v_m).configure("hard", 1.0)
    program.add_constraint(rates.left_multiply(A) == b).configure("soft", 1.0)
    program.solve()
    return program.x


def _constrained_least_squares(problem: Problem) -> tuple[Any, ...]:
    A, b, J_m, v_m = problem.parts()
    return A, J_m, b, v_m


PRIORITIZED = Solver(_map)
DAQP = Solver(daqp.solve, _flat, itemgetter(0))
PLACO = Solver(_by_placo)
LAPACK = Solver(dgglse, _constrained_least_squares, itemgetter(3))
LEVELS = Solver(lexicographic_least_squares, _levels, attrgetter("x"))
DAQP_LEVELS = Solver(lambda *arguments: daqp.solve(*arguments, **STRICT), _in_levels, itemgetter(0))


def _compared(problems: Sequence[Problem], **solvers: Solver) -> dict[str, Candidate]:
    check_agreement({name: s.solutions(problems) for name, s in solvers.items()}, TOLERANCE)
    return {name: solver.candidate(problems) for name, solver in solvers.items()}


def problem_1(rng: np.random.Generator) -> dict[str, Candidate]:
    """Return the candidates for one Problem 1 of the hexapod's size."""
    solvers = {"daqp": DAQP, "daqp_built": DAQP.with_build(), "placo": PLACO, "lapack": LAPACK}
    return _compared([random_problem(6, rng) for _ in range(64)], ours=PRIORITIZED, **solvers)


def many_actuators(rng: np.random.Generator) -> dict[str, Candidate]:
    """Return the candidates for one Problem 1 with 200 actuators."""
    return _compared([random_problem(200, rng) for _ in range(2)], ours=PRIORITIZED, daqp=DAQP)


def batch(rng: np.random.Generator) -> dict[str, Candidate]:
    """Return the candidates for 10,000 instances of Problem 1, which daqp solves one by one."""
    size, count = 10_000, 64
    batched = random_problem(6, rng, (size,))
    arrays = {name: getattr(batched, name) for name in ("J", "major", "joint", "secondary")}
    single = [replace(batched, **{name: A[k] for name, A in arrays.items()}) for k in range(count)]
    check_agreement({"ours": _map(batched)[:count], "daqp": DAQP.solutions(single)}, TOLERANCE)
    return {"ours": PRIORITIZED.candidate([batched], size), "daqp": DAQP.candidate(single)}


def limited(rng: np.random.Generator) -> dict[str, Candidate]:
    """Return the candidates for Problem 1 with active limits."""
    problems = [random_limited(6, rng) for _ in range(64)]
    return _compared(problems, ours=PRIORITIZED, daqp=DAQP, daqp_built=DAQP.with_build())


def three_levels(rng: np.random.Generator) -> dict[str, Candidate]:
    """Return the candidates for three levels with active limits."""
    problems, built = [random_limited(6, rng) for _ in range(64)], DAQP_LEVELS.with_build()
    return _compared(problems, ours=LEVELS, daqp=DAQP_LEVELS, daqp_built=built)
