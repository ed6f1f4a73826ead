"""How contenders are compared: the same problems for all, answers first, then times by turns."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import cycle
from timeit import Timer
from typing import Any

import numpy as np

from experiments.rig.hexapod.columns import MAJOR, SECONDARY
from experiments.study.errors import Unsound
from experiments.study.terminal import OnProgress
from sim import Array


@dataclass(frozen=True)
class Problem:
    """Minimize |W1 (rates - joint)|^2 + |W2 (J_s rates - secondary)|^2, J_m rates = major.

    J_m and J_s are the rows `MAJOR` and `SECONDARY` of J, (..., 6, n). The weights, diagonals of W1
    (n,) and W2 (4,), are common to a batch; major is (..., 2), joint (..., n), secondary (..., 4).
    """

    J: Array
    joint_weight: Array
    secondary_weight: Array
    major: Array
    joint: Array
    secondary: Array

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

    def one(self, k: int) -> "Problem":
        """The k-th of a batch."""
        names = ("J", "major", "joint", "secondary")
        return replace(self, **{name: getattr(self, name)[k] for name in names})

    def with_unit_rows(self) -> "Problem":
        """The same with weights that make every row of A a unit vector."""
        return replace(
            self,
            joint_weight=np.ones_like(self.joint_weight),
            secondary_weight=1 / np.linalg.norm(self.J[SECONDARY], axis=1),
        )


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


@dataclass(frozen=True)
class Questions:
    """Random problems: of the hexapod's size, by number of actuators, by size of the batch."""

    problems: list[Problem]
    by_actuators: dict[int, list[Problem]]
    by_batch: dict[int, list[Problem]]


def questions(
    actuators: Sequence[int], batches: Sequence[int], rng: np.random.Generator
) -> Questions:
    """For ascending sizes; fewer problems where each takes longer.

    As many mappings are in the batches of each size as in the largest, but in 20 calls at most.
    """
    return Questions(
        [random_problem(6, rng) for _ in range(64)],
        {n: [random_problem(n, rng) for _ in range(max(2, 400 // n))] for n in actuators},
        {
            size: [random_problem(6, rng, (size,)) for _ in range(min(20, batches[-1] // size))]
            for size in batches
        },
    )


@dataclass(frozen=True)
class Agreement:
    """By contender, the largest distance of its answers from the others', as a fraction of them."""

    question: str
    tolerance: float
    distances: dict[str, float]

    def check(self) -> None:
        """Raise an `Unsound` that names the contenders which do not solve the same problem."""
        # NaN is no agreement either.
        apart = {name: d for name, d in self.distances.items() if not d <= self.tolerance}
        if apart:
            who = ", ".join(f"{name} by {distance:.1e}" for name, distance in apart.items())
            raise Unsound(
                f"the answers differ, so nothing was timed: {self.question}: {who} of the answer, "
                f"more than {self.tolerance:.0e}"
            )


def compare(question: str, answers: Mapping[str, Array], tolerance: float) -> Agreement:
    """How far each contender's answers (N, n) are from the median of all, entry by entry.

    With three contenders or more, one that is wrong does not move the median.
    """
    middle = np.median(list(answers.values()), axis=0)
    size = np.abs(middle).max(axis=-1)
    distances = {
        name: float((np.abs(each - middle).max(axis=-1) / size).max())
        for name, each in answers.items()
    }
    return Agreement(question, tolerance, distances)


@dataclass(frozen=True)
class Contender:
    """Something to be timed; nothing is wrapped around the `call`.

    `arguments` makes new ones before each sample, which calls once with each of them; this is not
    timed, and a result kept from former arguments is of no use. A sample is `units` of what is
    counted, control ticks or mappings. Each round takes so many `samples`.
    """

    name: str
    call: Callable[..., Any]
    arguments: Callable[[], Sequence[tuple[Any, ...]]]
    units: int = 1
    samples: int = 1

    def timer(self, clock_ns: Callable[[], int]) -> Timer:
        """Of one sample, in nanoseconds."""
        # timeit stops garbage collection unless the setup starts it again: users pay for it.
        setup = "import gc; gc.enable(); call, given = contender.call, contender.arguments()"
        calls = "for arguments in given: call(*arguments)"
        return Timer(calls, setup, clock_ns, {"contender": self})

    def single(self) -> Callable[[], Any]:
        """One call after the other, with the same arguments over and over."""
        call, given = self.call, cycle(self.arguments())
        return lambda: call(*next(given))


@dataclass(frozen=True)
class Entry:
    """Who is timed on some problems, and how far apart their answers are.

    `at_limits`: for each question with limits, how many problems have 0, 1, ... rates at one.
    """

    contenders: Sequence[Contender]
    agreements: Sequence[Agreement] = ()
    at_limits: Mapping[str, list[int]] = field(default_factory=dict)


def by_turns(
    contenders: Sequence[Contender],
    rounds: int,
    on_progress: OnProgress,
    clock_ns: Callable[[], int] = time.process_time_ns,
) -> dict[str, Array]:
    """Time of one unit by name, [us], shape (rounds, samples).

    Every contender has its turn in every round, so that disturbances affect all alike. A round
    before the first warms caches and is not kept. The clock is the processor's time for this
    process: on a busy machine long calls are interrupted and short ones are not, so that wall time
    would be unfair to the long.
    """
    timed = [(each, each.timer(clock_ns)) for each in contenders]
    taken_us = {each.name: np.empty((rounds, each.samples)) for each in contenders}
    for turn in range(rounds + 1):
        for k, (each, timer) in enumerate(timed, 1):
            sampled_ns = np.array(timer.repeat(each.samples, number=1))
            if turn > 0:
                taken_us[each.name][turn - 1] = sampled_ns / (1e3 * each.units)
            on_progress(turn * len(timed) + k, (rounds + 1) * len(timed))
    return taken_us


def spread(samples_us: Array) -> dict[str, float]:
    """Median and range of all samples."""
    p5, median, p95 = np.percentile(samples_us, [5, 50, 95])
    return {"median_us": float(median), "p5_us": float(p5), "p95_us": float(p95)}


def power_law(sizes: Sequence[int], time_us: Sequence[float] | Array) -> dict[str, float]:
    """Of times (k,) at sizes (k,): the slope of the line that fits best in the logarithms.

    `least` and `most` are the slopes of the flattest and the steepest piece between neighbours.
    """
    x, y = np.log(sizes), np.log(time_us)
    slopes = np.diff(y) / np.diff(x)
    exponent = np.polyfit(x, y, 1)[0]
    return {"exponent": float(exponent), "least": float(slopes.min()), "most": float(slopes.max())}
