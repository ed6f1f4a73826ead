"""What is tried: which strut is broken, what is asked for, and what is to be least."""

from dataclasses import dataclass

import numpy as np

from experiments.hexapod.columns import MAJOR, SECONDARY
from sim import Array, Failure, FailureKind

STRUTS = 6


@dataclass(frozen=True)
class Condition:
    """What is broken.

    Attributes:
        kind: How a strut fails; None: all are sound.
        strut: Which, 0..5.
    """

    kind: FailureKind | None = None
    strut: int = 0

    def __str__(self) -> str:
        return "sound" if self.kind is None else f"strut {self.strut + 1} {self.kind}"

    @property
    def failures(self) -> tuple[Failure, ...]:
        """What happens to the plant."""
        return () if self.kind is None else (Failure(self.strut, self.kind),)

    @property
    def locked(self) -> tuple[int, ...]:
        """Position failures, for the theory."""
        return (self.strut,) if self.kind == "locked" else ()

    @property
    def free(self) -> tuple[int, ...]:
        """Torque failures, for the rigid theory: it knows no suspension spring."""
        return (self.strut,) if self.kind in ("free", "loose") else ()


KINDS: tuple[FailureKind, ...] = ("locked", "free", "loose")


def conditions(struts: int) -> tuple[Condition, ...]:
    """Sound, and each of the first struts failed in each way."""
    failed = [Condition(kind, strut) for kind in KINDS for strut in range(struts)]
    return (Condition(), *failed)


@dataclass(frozen=True)
class ForceGoal:
    """One of the three cases of Problem 6.

    Attributes:
        theorem: Which theorem of the paper solves it without failures.
        torque_weight: W3, diagonal over the struts, [1]/[N]; None is zero.
        secondary_weight: W4, diagonal over [f_x, f_y, f_z, m_z], [1]/[N] and [1]/[N m]; None is
            zero.
    """

    theorem: int
    torque_weight: tuple[float, ...] | None
    secondary_weight: tuple[float, ...] | None

    def __str__(self) -> str:
        return f"theorem {self.theorem}"


SPARING = (2.0, 1.0, 2.0, 1.0, 2.0, 1.0)
"""W3: struts 1, 3 and 5 are hot, as under the paper's W_b. With W3 = I nothing would be traded: in
the orthogonal hexapod the least torque exerts no secondary force at all."""

LEVERED = (1.0, 1.0, 1.0, 3.0)
"""W4: a moment counts as the force that makes it at the nodes, 0.33 m from the axis."""

GOALS = (
    ForceGoal(7, SPARING, LEVERED),
    ForceGoal(8, SPARING, None),
    ForceGoal(9, None, LEVERED),
)
LEAST_TORQUE, PRESCRIBED = GOALS[1], GOALS[2]


@dataclass(frozen=True)
class Aims:
    """Forces asked for, one a row.

    Attributes:
        major: Moments about x_b and y_b, shape (D, 2), [N m].
        secondary: [f_x, f_y, f_z, m_z], shape (D, 4), [N] and [N m].
    """

    major: Array
    secondary: Array

    @property
    def wrench(self) -> Array:
        """All of it as [moment; force], shape (D, 6)."""
        return as_wrench(self.major, self.secondary)


def as_wrench(major: Array, secondary: Array) -> Array:
    """[moment; force] (D, 6) of its major and secondary parts."""
    wrench = np.empty((len(major), 6))
    wrench[:, MAJOR], wrench[:, SECONDARY] = major, secondary
    return wrench


MAJOR_N_M, FORCE_N, TWIST_N_M = 3.0, 20.0, 2.0
"""Sizes of the major moment, the secondary force, and (at most) the moment about z_b: together they
ask for up to some 20 N of a coil, which has 80."""


def draw_aims(rng: np.random.Generator, count: int) -> Aims:
    """Random directions."""
    angle = rng.uniform(0, 2 * np.pi, count)
    force = rng.normal(size=(count, 3))
    force *= FORCE_N / np.linalg.norm(force, axis=1, keepdims=True)
    twist = rng.uniform(-TWIST_N_M, TWIST_N_M, (count, 1))
    major = MAJOR_N_M * np.column_stack([np.cos(angle), np.sin(angle)])
    return Aims(major=major, secondary=np.hstack([force, twist]))
