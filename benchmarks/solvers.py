"""Problem 1, with limits, and in three levels, by each solver in its fastest documented way."""

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

from benchmarks.contender import Contender, agree
from prioritized import lexicographic_least_squares, velocity_mapping
from sim import Array

with warnings.catch_warnings():
    # Pinocchio, which PlaCo brings, imports another package by its former name.
    warnings.simplefilter("ignore", DeprecationWarning)
    # Not as statements: they are installed for the benchmark alone.
    daqp: Any = import_module("daqp")
    placo: Any = import_module("placo")

TOLERANCE = 1e-9  # of the answers, as a fraction of the rates
MAJOR, SECONDARY = [0, 1], [3, 4, 5, 2]
"""Rows of J, as the hexapod has them."""
EQUALITY = 5
"""daqp's mark of a constraint that holds with equality."""
STRICT = {"primal_tol": 1e-12, "rho_soft": 1e-14}
"""With daqp's defaults its levels are met to 6e-3 of these rates only; these cost no time."""
SECOND = SECONDARY[:2]
"""Rows of J in the second of three levels."""


@dataclass(frozen=True)
class Problem:
    """Minimize |W1 (rates - joint)|^2 + |W2 (J_s rates - secondary)|^2, J_m rates = major.

    J_m and J_s are the rows `MAJOR` and `SECONDARY` of J, (..., 6, n). The weights, diagonals of W1
    (n,) and W2 (4,), are common to a batch; major is (..., 2), joint (..., n), secondary (..., 4).
    Rates have limits of -1 and 1 where `limited`.
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
        """Of the rates, (n,) each."""
        most = np.ones(self.J.shape[-1])
        return (-most, most) if self.limited else None

    def parts(self) -> tuple[Array, Array, Array, Array]:
        """A (n + 4, n) and b of the objective |A rates - b|^2; J_m (2, n) and v_m."""
        W1, W2 = np.diag(self.joint_weight), self.secondary_weight
        A = np.vstack([W1, W2[:, None] * self.J[SECONDARY]])
        b = np.concatenate([self.joint_weight * self.joint, W2 * self.secondary])
        return A, b, self.J[MAJOR], self.major

    def objective(self) -> tuple[Array, Array]:
        """H (n, n) and f of the same objective, rates^T H rates / 2 + f^T rates, quickly."""
        squares = self.joint_weight * self.joint_weight
        A = self.secondary_weight[:, None] * self.J[SECONDARY]
        H = A.T @ A
        H.flat[:: len(H) + 1] += squares
        return H, -(squares * self.joint) - (self.secondary_weight * self.secondary) @ A

    def levels(self) -> list[tuple[Array, Array]]:
        """The major rows, two secondary rows, then the rest of the objective."""
        A, b, J_m, v_m = self.parts()
        second = self.J.shape[1] + np.arange(len(SECOND))
        rest = np.delete(A, second, axis=0), np.delete(b, second)
        return [(J_m, v_m), (self.J[SECOND], self.secondary[: len(SECOND)]), rest]


def random_problem(n: int, rng: np.random.Generator, batch: tuple[int, ...] = ()) -> Problem:
    """With n actuators: Gaussian J, which has full rank, and weights from 0.5 to 2."""
    return Problem(
        J=rng.normal(size=(*batch, 6, n)),
        joint_weight=rng.uniform(0.5, 2.0, size=n),
        secondary_weight=rng.uniform(0.5, 2.0, size=len(SECONDARY)),
        major=rng.normal(size=(*batch, len(MAJOR))),
        joint=rng.normal(size=(*batch, n)),
        secondary=rng.normal(size=(*batch, len(SECONDARY))),
    )


def random_limited(n: int, rng: np.random.Generator) -> Problem:
    """The task is that of rates within 0.7 of the limits; desired ones are beyond in 6 of 10 cases.

    Were it out of reach, daqp would call the flat program infeasible.
    """
    one, inside = random_problem(n, rng), rng.uniform(-0.7, 0.7, size=n)
    secondary = np.concatenate([one.J[SECOND] @ inside, one.secondary[len(SECOND) :]])
    major, joint = one.J[MAJOR] @ inside, 2.0 * one.joint
    return replace(one, major=major, joint=joint, secondary=secondary, limited=True)


@dataclass(frozen=True)
class Solver:
    """One way to solve a problem, of which only `solve` is timed.

    `prepare` makes its arguments of a problem, and `rates` reads the rates (n,) off what it
    returned.
    """

    solve: Callable[..., Any]
    prepare: Callable[[Problem], tuple[Any, ...]] = lambda problem: (problem,)
    rates: Callable[[Any], Array] = np.asarray

    def with_build(self) -> "Solver":
        """The same, its arguments made within the time."""
        solve, prepare = self.solve, self.prepare
        return Solver(lambda problem: solve(*prepare(problem)), rates=self.rates)

    def contender(self, problems: Sequence[Problem], size: int = 1) -> Contender:
        """To be timed on problems of `size` mappings each, in new arrays for each round."""

        def arguments() -> list[tuple[Any, ...]]:
            return [self.prepare(deepcopy(each)) for each in problems]

        return Contender(self.solve, arguments, size * len(problems))

    def answers(self, problems: Sequence[Problem]) -> Array:
        """Rates of each problem, shape (N, n)."""
        return np.array([self.rates(self.solve(*self.prepare(each))) for each in problems])


def _map(problem: Problem) -> Array:
    mapping = velocity_mapping(
        problem.J,
        major=MAJOR,
        secondary=SECONDARY,
        joint_weight=problem.joint_weight,
        secondary_weight=problem.secondary_weight,
        rate_limits=problem.limits,
    )
    return mapping(problem.major, problem.joint, problem.secondary)


def _flat(problem: Problem) -> tuple[Any, ...]:
    """H and f; limits, if there are, beside the major task as equations."""
    v_m, none = problem.major, np.zeros(0)
    least, most = problem.limits or (none, none)
    sense = np.zeros(len(most) + len(v_m), dtype=c_int)
    sense[len(most) :] = EQUALITY
    sides = np.concatenate([most, v_m]), np.concatenate([least, v_m])
    return (*problem.objective(), problem.J[MAJOR], *sides, sense)


def _in_levels(problem: Problem) -> tuple[Any, ...]:
    """H and f of the last level; limits and the first ones as levels of a hierarchy."""
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
    program.regularization = 0.0  # by default 1e-8, which is seen in the answers
    rates = program.add_variable(len(problem.joint)).expr()
    program.add_constraint(rates.left_multiply(J_m) == v_m).configure("hard", 1.0)
    program.add_constraint(rates.left_multiply(A) == b).configure("soft", 1.0)
    program.solve()
    return program.x


def _constrained_least_squares(problem: Problem) -> tuple[Any, ...]:
    A, b, J_m, v_m = problem.parts()
    return A, J_m, b, v_m


OURS = Solver(_map)
DAQP = Solver(daqp.solve, _flat, itemgetter(0))
PLACO = Solver(_by_placo)
LAPACK = Solver(dgglse, _constrained_least_squares, itemgetter(3))
LEVELS = Solver(lexicographic_least_squares, _levels, attrgetter("x"))
DAQP_LEVELS = Solver(lambda *given: daqp.solve(*given, **STRICT), _in_levels, itemgetter(0))


def _compared(problems: Sequence[Problem], **solvers: Solver) -> dict[str, Contender]:
    agree({name: each.answers(problems) for name, each in solvers.items()}, TOLERANCE)
    return {name: each.contender(problems) for name, each in solvers.items()}


def problem_1(rng: np.random.Generator) -> dict[str, Contender]:
    """One Problem 1 of the hexapod's size."""
    solvers = {"daqp": DAQP, "daqp_built": DAQP.with_build(), "placo": PLACO, "lapack": LAPACK}
    return _compared([random_problem(6, rng) for _ in range(64)], ours=OURS, **solvers)


def many_actuators(rng: np.random.Generator) -> dict[str, Contender]:
    """The same with 200 actuators."""
    return _compared([random_problem(200, rng) for _ in range(2)], ours=OURS, daqp=DAQP)


def batch(rng: np.random.Generator) -> dict[str, Contender]:
    """10,000 of them in one call, beside the first ones by daqp, one by one."""
    size, shown = 10_000, 64
    together = random_problem(6, rng, (size,))
    alone = [
        replace(
            together,
            J=together.J[k],
            major=together.major[k],
            joint=together.joint[k],
            secondary=together.secondary[k],
        )
        for k in range(shown)
    ]
    agree({"ours": _map(together)[:shown], "daqp": DAQP.answers(alone)}, TOLERANCE)
    return {"ours": OURS.contender([together], size), "daqp": DAQP.contender(alone)}


def limited(rng: np.random.Generator) -> dict[str, Contender]:
    """Problem 1 with limits that bind."""
    problems = [random_limited(6, rng) for _ in range(64)]
    return _compared(problems, ours=OURS, daqp=DAQP, daqp_built=DAQP.with_build())


def three_levels(rng: np.random.Generator) -> dict[str, Contender]:
    """Three levels with limits that bind."""
    problems, built = [random_limited(6, rng) for _ in range(64)], DAQP_LEVELS.with_build()
    return _compared(problems, ours=LEVELS, daqp=DAQP_LEVELS, daqp_built=built)
